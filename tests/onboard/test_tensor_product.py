"""Tensor products against scipy, ndsplines and the Lagrange tensor product."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import ndsplines
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from ampi.onboard.interpolation import Interpolator
from ampi.onboard.subspace import Order

Array = NDArray[np.float64]

SMOOTH = [order for order in Order if order not in (Order.NEAREST, Order.HERMITE)]

laws = settings(deadline=None, max_examples=60)


@dataclass(frozen=True)
class Case:
    """A random table and a point inside its grid."""

    axes: tuple[Array, ...]
    values: Array
    point: Array


@st.composite
def cases(draw: st.DrawFn, least: int = 1, most: int = 4, highest_dimension: int = 6) -> Case:
    d = draw(st.integers(1, highest_dimension))
    sizes = draw(st.lists(st.integers(least, most), min_size=d, max_size=d))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    axes = tuple(rng.uniform(-9, 9) + np.cumsum(rng.uniform(0.1, 3.0, n)) for n in sizes)
    shares = draw(st.lists(st.floats(0.0, 1.0), min_size=d, max_size=d))
    point = [
        min(float(a[0] + s * (a[-1] - a[0])), float(a[-1]))
        for a, s in zip(axes, shares, strict=True)
    ]
    return Case(axes, rng.standard_normal((*sizes, draw(st.integers(1, 4)))), np.array(point))


def evaluate(axes: tuple[Array, ...], values: Array, point: Array, order: Order) -> Array:
    return Interpolator(axes, values, (order,) * len(axes))(point.tolist()).copy()


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(case=cases(), order=st.sampled_from(SMOOTH))
def test_supporting_values_are_met_exactly(case: Case, order: Order) -> None:
    """Eq. (18)."""
    vertices = list(np.ndindex(case.values.shape[:-1]))
    for index in vertices[:: max(1, len(vertices) // 12)]:
        point = np.array([axis[i] for axis, i in zip(case.axes, index, strict=True)])
        assert np.array_equal(evaluate(case.axes, case.values, point, order), case.values[index])


@laws
@given(case=cases(), order=st.sampled_from(SMOOTH), seed=st.integers(0, 2**32 - 1))
def test_multilinear_functions_are_reproduced(case: Case, order: Order, seed: int) -> None:
    """Σ over all subsets of the axes of c_S Π_{i∈S} x_i."""
    d = len(case.axes)
    coefficients = np.random.default_rng(seed).standard_normal((2,) * d)

    def multilinear(grid: list[Array]) -> Array:
        total = np.zeros(np.broadcast_shapes(*(g.shape for g in grid)))
        for power in product((0, 1), repeat=d):
            total = total + coefficients[power] * np.prod(
                np.broadcast_arrays(*[g**k for g, k in zip(grid, power, strict=True)]), axis=0
            )
        return total

    values = multilinear(list(np.meshgrid(*case.axes, indexing="ij")))[..., None]
    # an axis of one point knows its value there alone
    expected = multilinear([np.array(x) for x in case.point])
    scale = np.abs(values).max() * 2.0**d
    assert evaluate(case.axes, values, case.point, order)[0] == pytest.approx(
        float(expected), abs=1e-12 * scale
    )


@laws
@given(case=cases(least=3), data=st.data())
def test_multilinear_interpolation_is_continuous_over_cell_borders(
    case: Case, data: st.DataObject
) -> None:
    i = data.draw(st.integers(0, len(case.axes) - 1))
    axis = case.axes[i]
    border = float(axis[data.draw(st.integers(1, len(axis) - 2))])
    sides = []
    for x in (np.nextafter(border, -np.inf), border, np.nextafter(border, np.inf)):
        point = case.point.copy()
        point[i] = x
        sides.append(evaluate(case.axes, case.values, point, Order.LINEAR))
    slope = 2.0 * np.abs(case.values).max() / np.diff(axis).min()
    limit = 1e-13 + 2.0 * slope * np.spacing(abs(border))
    assert np.abs(sides[0] - sides[1]).max() <= limit
    assert np.abs(sides[2] - sides[1]).max() <= limit


@laws
@given(case=cases())
def test_multilinear_values_stay_between_those_of_the_cell(case: Case) -> None:
    interpolator = Interpolator(case.axes, case.values, (Order.LINEAR,) * len(case.axes))
    got = interpolator(case.point.tolist())
    cell = case.values[tuple(slice(f, f + 2) for f in interpolator.first)].reshape(
        -1, case.values.shape[-1]
    )
    assert np.all(got >= cell.min(axis=0) - 1e-13)
    assert np.all(got <= cell.max(axis=0) + 1e-13)


# --- witnesses ------------------------------------------------------------------------------------


@laws
@given(case=cases(least=2))
def test_order_2_agrees_with_scipy(case: Case) -> None:
    witness = RegularGridInterpolator(case.axes, case.values, method="linear")
    got = evaluate(case.axes, case.values, case.point, Order.LINEAR)
    assert got == pytest.approx(witness(case.point)[0], abs=1e-13)


@laws
@given(case=cases(least=2, highest_dimension=4))
def test_order_2_agrees_with_ndsplines(case: Case) -> None:
    grid = np.stack(np.meshgrid(*case.axes, indexing="ij"), axis=-1)
    witness = ndsplines.make_interp_spline(grid, case.values, degrees=1)
    got = evaluate(case.axes, case.values, case.point, Order.LINEAR)
    assert got == pytest.approx(np.ravel(witness(case.point[None])), abs=1e-11)


@laws
@given(case=cases(least=3, most=3, highest_dimension=4))
def test_order_3_agrees_with_ndsplines_on_three_points(case: Case) -> None:
    """The one quadratic through three points, whatever the knots."""
    grid = np.stack(np.meshgrid(*case.axes, indexing="ij"), axis=-1)
    witness = ndsplines.make_interp_spline(grid, case.values, degrees=2)
    got = evaluate(case.axes, case.values, case.point, Order.QUADRATIC)
    size = np.abs(case.values).max() * 100.0 ** len(case.axes)
    assert got == pytest.approx(np.ravel(witness(case.point[None])), abs=1e-12 * size)


@laws
@given(case=cases(most=6, highest_dimension=4), data=st.data())
def test_every_axis_has_an_order_of_its_own(case: Case, data: st.DataObject) -> None:
    """Weights from their moment equations; the sum of Eq. (19) over all points of the subspace."""
    points = {Order.LINEAR: 2, Order.QUADRATIC: 3, Order.CUBIC: 4}
    d = len(case.axes)
    orders = data.draw(st.lists(st.sampled_from(list(points)), min_size=d, max_size=d))
    interpolator = Interpolator(case.axes, case.values, orders)
    got = interpolator(case.point.tolist())
    expected, size = case.values, float(np.abs(case.values).max())
    for axis, order, f, x in zip(case.axes, orders, interpolator.first, case.point, strict=True):
        k = min(points[order], len(axis))
        moments = np.vander(axis[f : f + k] - x, k, increasing=True).T
        own = np.linalg.solve(moments, np.eye(k)[0])
        expected = np.tensordot(own, expected[f : f + k], axes=(0, 0))
        size *= float(np.abs(own).sum())
    assert got == pytest.approx(expected, abs=1e-10 * size)


# --- examples -------------------------------------------------------------------------------------


def test_bilinear_example() -> None:
    values = np.array([[[0.0], [1.0]], [[2.0], [7.0]]])
    axes = (np.array([0.0, 1.0]), np.array([0.0, 10.0]))
    got = evaluate(axes, values, np.array([0.5, 2.5]), Order.LINEAR)
    assert got.tolist() == [0.75 * 1.0 + 0.25 * 4.0]


def test_the_table_is_not_written_to() -> None:
    values = np.arange(27.0).reshape(3, 3, 3)
    before = values.copy()
    axes = (np.arange(3.0), np.arange(3.0))
    for order in (Order.NEAREST, *SMOOTH):
        evaluate(axes, values, np.array([0.4, 1.9]), order)
    assert np.array_equal(values, before)
