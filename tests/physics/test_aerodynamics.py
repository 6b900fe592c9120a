"""Lift and drag: the CAV-H table and its spline, the Newtonian surrogate, the Lu polynomials."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ampi.physics.aerodynamics import (
    ModifiedNewtonian,
    PolynomialDragPolar,
    TabulatedAerodynamics,
)

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=100)
inside_mach = st.floats(2.0, 26.0)
inside_alpha = st.floats(5.0, 25.0)  # degrees; the held margins included
COMPONENTS = ("lift", "drag")


def padded(axis: tuple[float, ...]) -> Array:
    """The axis with its edge spacing halved once and again on either side."""
    left, right = axis[1] - axis[0], axis[-1] - axis[-2]
    return np.array(
        [axis[0] - left, axis[0] - left / 2, *axis, axis[-1] + right / 2, axis[-1] + right]
    )


def scipy_spline(
    table: TabulatedAerodynamics, name: str, alpha: Array, mach: Array, order: tuple[int, int]
) -> Array:
    """Derivative of the tensor-product clamped spline through the held table, by scipy."""
    values = np.pad(np.array(getattr(table, name)), 2, mode="edge")
    along_mach = CubicSpline(padded(table.mach), values, axis=1, bc_type="clamped")(mach, order[1])
    spline = CubicSpline(padded(table.angle_of_attack), along_mach, bc_type="clamped")
    return np.asarray(spline(alpha, order[0]))


def complex_step(
    table: TabulatedAerodynamics, alpha: Array, mach: Array, axis: int
) -> tuple[Array, Array]:
    """First derivatives of lift and drag along one axis."""
    shift = 1e-20j
    lift, drag = table.coefficients(
        alpha + shift if axis == 0 else alpha, mach + shift if axis == 1 else mach
    )
    return lift.imag / 1e-20, drag.imag / 1e-20


@laws
@given(alpha=inside_alpha, mach=inside_mach)
def test_table_is_the_clamped_spline_of_scipy(
    cavh_table: TabulatedAerodynamics, alpha: float, mach: float
) -> None:
    got = cavh_table.coefficients(np.radians(alpha), mach)
    for value, name in zip(got, COMPONENTS, strict=True):
        at = np.array([np.radians(alpha)]), np.array([mach])
        assert value == pytest.approx(scipy_spline(cavh_table, name, *at, (0, 0))[0, 0], abs=1e-10)


@laws
@given(alpha=st.floats(0.0, 14.0), mach=st.floats(4.0, 12.0), seed=st.integers(0, 2**32 - 1))
@pytest.mark.parametrize("shape", [(2, 2), (2, 3), (3, 2), (4, 5)])
def test_tables_of_any_size_are_splines_of_scipy(
    shape: tuple[int, int], alpha: float, mach: float, seed: int
) -> None:
    # Uneven axes; held out to 2 … 12 degrees or beyond, and to Mach 4.5 … 9.5 or beyond.
    rng = np.random.default_rng(seed)
    degrees = np.array([4.0, 10.0, 10.7, 12.0])[: shape[0]]
    random = TabulatedAerodynamics(
        angle_of_attack=tuple(np.radians(degrees).tolist()),
        mach=(5.0, 5.5, 8.0, 8.2, 9.0)[: shape[1]],
        lift=tuple(map(tuple, rng.uniform(0.0, 1.0, shape).tolist())),
        drag=tuple(map(tuple, rng.uniform(0.0, 1.0, shape).tolist())),
    )
    angles, machs = padded(random.angle_of_attack), padded(random.mach)
    got = random.coefficients(np.radians(alpha), mach)
    for value, name in zip(got, COMPONENTS, strict=True):
        held = (
            np.clip([np.radians(alpha)], angles[0], angles[-1]),
            np.clip([mach], machs[0], machs[-1]),
        )
        assert value == pytest.approx(scipy_spline(random, name, *held, (0, 0))[0, 0], abs=1e-9)


def test_first_derivatives_of_the_table(cavh_table: TabulatedAerodynamics) -> None:
    alpha, mach = np.radians(np.linspace(5.5, 24.5, 39)), np.linspace(2.1, 25.9, 57)
    for axis, order in ((0, (1, 0)), (1, (0, 1))):
        got = complex_step(cavh_table, alpha[:, None], mach[None, :], axis)
        for slope, name in zip(got, COMPONENTS, strict=True):
            exact = scipy_spline(cavh_table, name, alpha, mach, order)
            assert slope == pytest.approx(exact, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("axis", [0, 1])
def test_second_derivative_is_continuous_at_every_knot(
    cavh_table: TabulatedAerodynamics, axis: int
) -> None:
    # Differences of exact slopes on either side of a knot close up in proportion to the step.
    knots = padded(cavh_table.angle_of_attack if axis == 0 else cavh_table.mach)[1:-1]
    across = np.array([4.1, 9.0, 17.3]) if axis == 0 else np.radians([11.0, 14.2, 19.5])

    def slope(at: Array) -> Array:
        grid = (at[:, None], across[None, :]) if axis == 0 else (across[None, :], at[:, None])
        return np.stack(complex_step(cavh_table, *grid, axis))

    gaps = []
    for step in (1e-2 * np.diff(knots).min(), 1e-3 * np.diff(knots).min()):
        right = (slope(knots + step) - slope(knots)) / step
        left = (slope(knots) - slope(knots - step)) / step
        gaps.append(np.abs(right - left).max())
        curvature = np.abs(right).max()
    assert gaps[0] < 0.05 * curvature
    assert gaps[1] == pytest.approx(0.1 * gaps[0], rel=0.02)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("end", [0, -1])
def test_first_derivative_is_continuous_across_the_clamp(
    cavh_table: TabulatedAerodynamics, axis: int, end: int
) -> None:
    # Beyond the clamp the slope is zero; before it, it closes up in proportion to the distance.
    knots = padded(cavh_table.angle_of_attack if axis == 0 else cavh_table.mach)
    outward = -1.0 if end == 0 else 1.0
    width = abs(knots[end] - knots[1 if end == 0 else -2])
    across = np.array([4.1, 9.0, 17.3]) if axis == 0 else np.radians([11.0, 14.2, 19.5])

    def slope(at: Array) -> Array:
        grid = (at[:, None], across[None, :]) if axis == 0 else (across[None, :], at[:, None])
        return np.stack(complex_step(cavh_table, *grid, axis))  # (2, at, across)

    distance = width * np.array([1e-3, 1e-2, 1e-1, 1.0])
    assert np.all(slope(knots[end] + outward * distance) == 0.0)
    inside = np.abs(slope(knots[end] - outward * distance)).max(axis=(0, 2))
    steepest = np.abs(slope(np.linspace(knots[0], knots[-1], 201))).max()
    assert inside[0] < 1e-3 * steepest
    assert inside[0] == pytest.approx(0.1 * inside[1], rel=0.02)

    # The same without complex steps: one-sided differences over the clamp vanish linearly.
    def value(at: float) -> Array:
        pair = cavh_table.coefficients(*((at, across) if axis == 0 else (across, at)))
        return np.array(pair)

    secants = [
        np.abs(value(knots[end] - outward * step) - value(knots[end])).max() / step
        for step in distance[:2]
    ]
    assert np.array_equal(value(knots[end] + outward * width), value(knots[end]))
    assert secants[0] == pytest.approx(0.1 * secants[1], rel=0.02)


def test_table_at_its_grid_points(cavh_table: TabulatedAerodynamics) -> None:
    for i, alpha in enumerate(cavh_table.angle_of_attack):
        for j, mach in enumerate(cavh_table.mach):
            lift, drag = cavh_table.coefficients(alpha, mach)
            assert lift == pytest.approx(cavh_table.lift[i][j], abs=1e-9)
            assert drag == pytest.approx(cavh_table.drag[i][j], abs=1e-9)


@laws
@given(below=st.floats(0.0, 2.0), above=st.floats(26.0, 60.0), row=st.integers(0, 2))
def test_table_holds_its_mach_edges(
    cavh_table: TabulatedAerodynamics, below: float, above: float, row: int
) -> None:
    alpha = cavh_table.angle_of_attack[row]
    for mach, column in ((below, 0), (above, -1)):
        got = cavh_table.coefficients(alpha, mach)
        edge = cavh_table.lift[row][column], cavh_table.drag[row][column]
        assert got == pytest.approx(edge, abs=1e-9)


@laws
@given(below=st.floats(-30.0, 5.0), above=st.floats(25.0, 60.0), column=st.integers(0, 6))
def test_table_holds_its_angle_edges(
    cavh_table: TabulatedAerodynamics, below: float, above: float, column: int
) -> None:
    mach = cavh_table.mach[column]
    for alpha, row in ((below, 0), (above, -1)):
        got = cavh_table.coefficients(np.radians(alpha), mach)
        edge = cavh_table.lift[row][column], cavh_table.drag[row][column]
        assert got == pytest.approx(edge, abs=1e-9)


def test_table_barely_leaves_its_edge_on_the_way_to_the_held_value(
    cavh_table: TabulatedAerodynamics,
) -> None:
    mach = np.concatenate([np.linspace(2.0, 3.5, 40), np.linspace(23.0, 26.0, 40)])
    for row, alpha in enumerate(cavh_table.angle_of_attack):
        got = np.array(cavh_table.coefficients(alpha, mach))
        for values, name in zip(got, COMPONENTS, strict=True):
            line = getattr(cavh_table, name)[row]
            edge = np.where(mach < 10.0, line[0], line[-1])
            assert np.abs(values / edge - 1.0).max() < 0.01


def test_table_does_not_ring_between_its_points(cavh_table: TabulatedAerodynamics) -> None:
    alpha, mach = np.radians(np.linspace(10.0, 20.0, 41)), np.linspace(3.5, 23.0, 118)
    lift, drag = cavh_table.coefficients(alpha[:, None], mach[None, :])
    assert np.all(np.diff(lift, axis=0) > 0.0)
    assert np.all(np.diff(drag, axis=0) > 0.0)
    assert np.all(np.diff(lift, axis=1) < 5e-3)
    assert 0.34 < lift.min() < lift.max() < 1.06
    assert 0.10 < drag.min() < drag.max() < 0.48


@pytest.mark.parametrize("name", COMPONENTS)
def test_a_table_of_the_wrong_shape_is_refused(
    cavh_table: TabulatedAerodynamics, name: str
) -> None:
    tables = {n: getattr(cavh_table, n) for n in ("angle_of_attack", "mach", *COMPONENTS)}
    expected = f"aerodynamics.{name}: expected 3 rows (angle_of_attack) of 7 numbers (mach), "
    first, second, third = tables[name]
    for faulty, rows in (
        ((first, second), "[7, 7]"),
        ((first, second, third, third), "[7, 7, 7, 7]"),
        ((first, second[:6], third), "[7, 6, 7]"),  # ragged
        ((first[1:], second[1:], third[1:]), "[6, 6, 6]"),
        ((), "[]"),
    ):
        with pytest.raises(ValueError, match=re.escape(f"{expected}got rows of {rows}")):
            TabulatedAerodynamics(**{**tables, name: faulty})


@pytest.mark.parametrize("name", ["angle_of_attack", "mach"])
@pytest.mark.parametrize("axis", [(), (0.2,), (0.2, 0.2), (0.3, 0.2), (0.1, 0.3, 0.2)])
def test_an_axis_that_does_not_increase_is_refused(name: str, axis: tuple[float, ...]) -> None:
    axes = {"angle_of_attack": (0.1, 0.2), "mach": (5.0, 8.0), name: axis}
    rows = tuple((0.4,) * len(axes["mach"]) for _ in axes["angle_of_attack"])
    message = (
        f"aerodynamics.{name}: expected at least two strictly increasing values, got {list(axis)}"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        TabulatedAerodynamics(**axes, lift=rows, drag=rows)


@laws
@given(
    alpha=st.floats(-1.5, 1.5),
    quadratic=st.floats(0.0, 2.0),
    linear=st.floats(0.0, 1.0),
    axial=st.floats(0.0, 0.2),
)
def test_modified_newtonian_is_a_rotation_of_body_axes(
    alpha: float, quadratic: float, linear: float, axial: float
) -> None:
    surrogate = ModifiedNewtonian(normal_quadratic=quadratic, normal_linear=linear, axial=axial)
    lift, drag = surrogate.coefficients(alpha, None)
    normal = quadratic * np.sin(alpha) ** 2 + linear * np.sin(alpha)
    assert lift**2 + drag**2 == pytest.approx(normal**2 + axial**2, abs=1e-12)
    assert drag * np.cos(alpha) - lift * np.sin(alpha) == pytest.approx(axial, abs=1e-12)
    assert lift * np.cos(alpha) + drag * np.sin(alpha) == pytest.approx(normal, abs=1e-12)


@pytest.mark.parametrize(
    ("degrees", "lift", "drag"),
    [(0.0, 0.0, 0.045), (17.5, 0.187304, 0.106240), (42.0, 0.653379, 0.648859)],
)
def test_modified_newtonian_numbers_of_shefex3(degrees: float, lift: float, drag: float) -> None:
    # 42°: C_N = 1.83 · 0.447736 + 0.15 · 0.669131 = 0.919726, turned by 42° with C_A = 0.045.
    surrogate = ModifiedNewtonian(normal_quadratic=1.83, normal_linear=0.15, axial=0.045)
    assert surrogate.coefficients(np.radians(degrees), None) == pytest.approx(
        (lift, drag), abs=1e-6
    )


def test_polynomials_of_lu_at_40_degrees() -> None:
    # C_L = −0.041065 + 0.65168 + 0.41632 = 1.026935; C_D = 0.080505 − 0.031075 + 0.912175.
    polar = PolynomialDragPolar(
        lift=(-0.041065, 0.016292, 0.0002602), drag=(0.080505, -0.03026, 0.86495)
    )
    lift, drag = polar.coefficients(np.radians(40.0), None)
    assert lift == pytest.approx(1.026935, abs=1e-6)
    assert drag == pytest.approx(0.961605, abs=1e-5)
    assert lift / drag == pytest.approx(1.068, abs=1e-3)
