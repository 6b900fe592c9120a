"""Orders of interpolation: what they reproduce, where they are continuous, how they sum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import ndsplines
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator, CubicHermiteSpline, RegularGridInterpolator

from ampi.onboard.interpolation import Interpolator
from ampi.onboard.reference import Mode, ReferenceGenerator
from ampi.onboard.subspace import (
    Order,
    hermite_weights,
    located,
    point_weights,
    second_difference_weights,
)
from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]
TableMaker = Callable[..., GuidanceTable]

laws = settings(deadline=None, max_examples=60)
seeds = st.integers(0, 2**32 - 1)
CONTINUOUS = [order for order in Order if order is not Order.NEAREST]


@dataclass(frozen=True)
class Case:
    """A random table, slopes that have nothing to do with it, a point inside."""

    axes: tuple[Array, ...]
    values: Array
    slopes: Array
    point: Array


@st.composite
def cases(
    draw: st.DrawFn, least: int = 1, most: int = 5, highest_dimension: int = 3, columns: int = 2
) -> Case:
    sizes = draw(st.lists(st.integers(least, most), min_size=1, max_size=highest_dimension))
    rng = np.random.default_rng(draw(seeds))
    axes = tuple(rng.uniform(-3, 3) + np.cumsum(rng.uniform(0.3, 2.0, n)) for n in sizes)
    values = rng.standard_normal((*sizes, columns))
    slopes = rng.standard_normal((*sizes, len(sizes), columns))
    return Case(axes, values, slopes, np.array([rng.uniform(a[0], a[-1]) for a in axes]))


def evaluate(case: Case, orders: Order | list[Order], point: Array | None = None) -> Array:
    each = [orders] * len(case.axes) if isinstance(orders, Order) else orders
    interpolator = Interpolator(case.axes, case.values, each, case.slopes)
    return interpolator((case.point if point is None else point).tolist()).copy()


def function(case: Case, degree: int, seed: int) -> tuple[Callable[[list[Array]], Array], Case]:
    """Σ_i (polynomial in x_i) · (multilinear in the others), and the case of its values and slopes."""
    d = len(case.axes)
    rng = np.random.default_rng(seed)
    multilinear = rng.standard_normal((d, *(2,) * d))
    degrees = [degree if len(axis) > 2 or degree == 3 else 1 for axis in case.axes]
    polynomials = [np.polynomial.Polynomial(rng.standard_normal(k + 1)) for k in degrees]

    def at(grid: list[Array], along: int | None = None) -> Array:
        total = np.zeros(np.broadcast_shapes(*(g.shape for g in grid)))
        for i in range(d):
            for power in product((0, 1), repeat=d):
                if power[i]:
                    continue
                term = np.array(multilinear[i][power])
                for k, x in enumerate(grid):
                    own = polynomials[i] if k == i else np.polynomial.Polynomial([0, 1]) ** power[k]
                    term = term * (own.deriv() if k == along else own)(x)
                total = total + term
        return total

    grid = list(np.meshgrid(*case.axes, indexing="ij"))
    slopes = np.stack([at(grid, k) for k in range(d)], axis=-1)
    return at, replace(case, values=at(grid)[..., None], slopes=slopes[..., None])


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(case=cases(least=2), seed=seeds, kind=st.sampled_from([(2, "second"), (3, "hermite")]))
def test_a_correction_reproduces_what_bends_along_one_axis_at_a_time(
    case: Case, seed: int, kind: tuple[int, str]
) -> None:
    """Quadratics by second differences, cubics by Hermite, each times what is linear in the others."""
    degree, name = kind
    at, known = function(case, degree, seed)
    order = Order.SECOND_DIFFERENCES if name == "second" else Order.HERMITE
    expected = at([np.array(x) for x in case.point])
    size = 1e-11 * np.abs(known.values).max() * 10.0 ** len(case.axes)
    assert evaluate(known, order)[0] == pytest.approx(float(expected), abs=size)


@laws
@given(
    case=cases(least=4), seed=seeds, order=st.sampled_from([(Order.QUADRATIC, 2), (Order.CUBIC, 3)])
)
def test_a_tensor_product_reproduces_all_products_of_its_polynomials(
    case: Case, seed: int, order: tuple[Order, int]
) -> None:
    rng = np.random.default_rng(seed)
    own = [np.polynomial.Polynomial(rng.standard_normal(order[1] + 1)) for _ in case.axes]
    values = np.ones(())
    for polynomial, axis in zip(own, case.axes, strict=True):
        values = np.multiply.outer(values, polynomial(axis))
    expected = np.prod([float(p(x)) for p, x in zip(own, case.point, strict=True)])
    got = evaluate(replace(case, values=values[..., None].copy()), order[0])[0]
    assert got == pytest.approx(float(expected), abs=1e-10 * np.abs(values).max())


@laws
@given(case=cases(least=1), index=seeds, order=st.sampled_from(list(Order)))
def test_at_a_grid_point_the_value_is_that_of_the_table(
    case: Case, index: int, order: Order
) -> None:
    at = np.unravel_index(index % case.values[..., 0].size, case.values.shape[:-1])
    point = np.array([axis[i] for axis, i in zip(case.axes, at, strict=True)])
    assert np.array_equal(evaluate(case, order, point), case.values[at])


@laws
@given(case=cases(least=3), data=st.data())
def test_all_orders_but_nearest_are_continuous_over_every_kind_of_face(
    case: Case, data: st.DataObject
) -> None:
    d = len(case.axes)
    orders = data.draw(st.lists(st.sampled_from(CONTINUOUS), min_size=d, max_size=d))
    i = data.draw(st.integers(0, d - 1))
    for border in case.axes[i][1:-1]:
        sides = []
        for x in (border - 1e-9, border, border + 1e-9):
            point = case.point.copy()
            point[i] = x
            sides.append(evaluate(case, orders, point))
        assert np.abs(sides[0] - sides[1]).max() < 1e-5
        assert np.abs(sides[2] - sides[1]).max() < 1e-5


@laws
@given(case=cases(least=3, highest_dimension=1), order=st.sampled_from(CONTINUOUS))
def test_no_order_jumps_within_a_cell(case: Case, order: Order) -> None:
    """As quadratic did in the middle of one, when it took the nearer of the outer neighbours."""
    (axis,) = case.axes
    interpolator = Interpolator(case.axes, case.values, [order], case.slopes)
    fine = np.linspace(axis[0], axis[-1], 400).tolist()
    along = np.array([interpolator([x]).copy() for x in fine])
    steps = np.abs(np.diff(along, axis=0)).max(axis=0)
    assert np.all(steps < 0.1 * (1.0 + np.abs(case.values).max() + np.abs(case.slopes).max()))


@laws
@given(case=cases(least=2), seed=seeds)
def test_without_what_it_needs_a_correction_is_none(case: Case, seed: int) -> None:
    """Axes of two points have no second differences; the slopes of the chords correct nothing."""
    short = replace(
        case,
        axes=tuple(axis[:2] for axis in case.axes),
        values=case.values[(slice(2),) * len(case.axes)].copy(),
    )
    d = len(case.axes)
    chords = [
        np.broadcast_to(
            np.diff(short.values, axis=i) / np.diff(short.axes[i])[0], short.values.shape
        )
        for i in range(d)
    ]
    rng = np.random.default_rng(seed)
    short = replace(
        short,
        slopes=np.stack(chords, axis=-2).copy(),
        point=np.array([rng.uniform(*axis) for axis in short.axes]),
    )
    linear = evaluate(short, Order.LINEAR)
    assert np.array_equal(evaluate(short, Order.SECOND_DIFFERENCES), linear)
    assert evaluate(short, Order.HERMITE) == pytest.approx(linear, abs=1e-12)


@laws
@given(case=cases(most=6, columns=40), data=st.data())
def test_the_row_is_one_running_sum_over_vertices_in_order(case: Case, data: st.DataObject) -> None:
    """The bits of a loop in C: products from the first axis on, then added one after the other."""
    d = len(case.axes)
    orders = data.draw(st.lists(st.sampled_from(list(Order)), min_size=d, max_size=d))
    base, corrected, slopes = [], [], []
    for axis, order, x in zip(case.axes, orders, case.point, strict=True):
        points, n = axis.tolist(), len(axis)
        inside, below, _ = located(points, float(x))
        own = np.zeros(min(order.points, n))
        base.append((point_weights(points, inside, below, len(own), own), own))
        second, of_slopes = np.zeros(min(4, n)), np.zeros(2)
        if order is Order.SECOND_DIFFERENCES and n > 2:
            corrected.append((second_difference_weights(points, inside, below, second), second))
        elif order is Order.HERMITE and n > 1:
            of_values = np.zeros(2)
            first = hermite_weights(points, inside, below, of_values, of_slopes)
            corrected.append((first, of_values))
        else:
            corrected.append(None)
        slopes.append((below, of_slopes) if order is Order.HERMITE and n > 1 else None)
    terms = [(case.values, base)]
    for i in range(d):
        if corrected[i] is not None:
            terms.append((case.values, [*base[:i], corrected[i], *base[i + 1 :]]))
    for i in range(d):
        if slopes[i] is not None:
            terms.append((case.slopes[..., i, :], [*base[:i], slopes[i], *base[i + 1 :]]))
    total = None
    for rows, factors in terms:
        for local in product(*(range(len(w)) for _, w in factors)):
            weight = 1.0
            for (_, w), k in zip(factors, local, strict=True):
                weight *= float(w[k])
            row = weight * rows[tuple(f + k for (f, _), k in zip(factors, local, strict=True))]
            total = row if total is None else total + row
    assert np.array_equal(evaluate(case, orders), total)


# --- witnesses ------------------------------------------------------------------------------------


@laws
@given(case=cases(least=2))
def test_nearest_agrees_with_scipy(case: Case) -> None:
    witness = RegularGridInterpolator(case.axes, case.values, method="nearest")
    assert np.array_equal(evaluate(case, Order.NEAREST), witness(case.point)[0])


@laws
@given(case=cases(least=4, most=4))
def test_cubic_agrees_with_ndsplines_on_four_points(case: Case) -> None:
    grid = np.stack(np.meshgrid(*case.axes, indexing="ij"), axis=-1)
    witness = ndsplines.make_interp_spline(grid, case.values, degrees=3)
    expected = np.ravel(witness(case.point[None]))
    assert evaluate(case, Order.CUBIC) == pytest.approx(expected, abs=1e-8)


@laws
@given(case=cases(least=2, highest_dimension=1))
def test_hermite_agrees_with_scipy_on_one_axis(case: Case) -> None:
    witness = CubicHermiteSpline(case.axes[0], case.values, case.slopes[:, 0])
    expected = witness(float(case.point[0]))
    assert evaluate(case, Order.HERMITE) == pytest.approx(expected, abs=1e-11)


@laws
@given(case=cases(least=3, highest_dimension=1))
def test_second_differences_blend_the_parabolas_of_both_points(case: Case) -> None:
    """On one axis Eq. (1) is (1 − s) q_j + s q_{j+1}, with q_j through j − 1, j, j + 1."""
    (axis,), x = case.axes, float(case.point[0])
    n = len(axis)
    below = min(int(np.searchsorted(axis, x, side="right")) - 1, n - 2)
    s = (x - axis[below]) / (axis[below + 1] - axis[below])
    parts = []
    for node in (below, below + 1):
        j = min(max(node, 1), n - 2)
        own = slice(j - 1, j + 2)
        parts.append(BarycentricInterpolator(axis[own], case.values[own])(x))
    expected = (1.0 - s) * parts[0] + s * parts[1]
    assert evaluate(case, Order.SECOND_DIFFERENCES) == pytest.approx(expected, abs=1e-11)


# --- of references --------------------------------------------------------------------------------

AXES = (np.array([-1.0, 0.0, 2.0, 3.0, 4.0]), np.array([10.0, 11.0, 13.0]))


def nodal(table: GuidanceTable, mode: Mode, orders: tuple[Order, ...] | None = None) -> Array:
    generator = ReferenceGenerator(table, mode, orders)
    reference = generator.reference([1.2, 11.3])
    return np.append(generator.nodal_values.ravel(), reference.final_time)


def test_an_order_for_each_axis_or_that_of_the_mode(make_table: TableMaker) -> None:
    table = make_table(AXES)
    same = nodal(table, Mode.AMPI, (Order.CUBIC, Order.CUBIC))
    assert np.array_equal(same, nodal(table, Mode.CUBIC))
    mixed = nodal(table, Mode.AMPI, (Order.CUBIC, Order.LINEAR))
    assert not np.array_equal(mixed, same)
    assert ReferenceGenerator(table, Mode.AMPI).orders == (Order.LINEAR,) * 2


def test_hermite_reads_the_sensitivities_of_its_parameter_and_mpi_those_of_the_corners(
    make_table: TableMaker,
) -> None:
    table = make_table(AXES)
    assert table.sensitivities is not None
    zeros = replace(table, sensitivities=np.zeros_like(table.sensitivities))
    change = nodal(table, Mode.HERMITE) - nodal(zeros, Mode.HERMITE)
    s, t = 1.2 / 2.0, (11.3 - 11.0) / 2.0
    cell = table.sensitivities[1:3, 1:3]
    first = 2.0 * s * (1 - s) * ((1 - s) * cell[0, :, 0] - s * cell[1, :, 0])
    second = 2.0 * t * (1 - t) * ((1 - t) * cell[:, 0, 1] - t * cell[:, 1, 1])
    expected = (1 - t) * first[0] + t * first[1] + (1 - s) * second[0] + s * second[1]
    assert change == pytest.approx(expected, abs=1e-11)
    corners = table.corners().sensitivities
    assert corners is not None
    assert np.array_equal(corners, table.sensitivities[::4, ::2])
    own = (Order.HERMITE, Order.HERMITE)
    assert not np.array_equal(nodal(table, Mode.MPI, own), nodal(zeros, Mode.MPI, own))


def test_a_table_without_sensitivities_refuses_hermite_on_the_ground(
    make_table: TableMaker,
) -> None:
    table = replace(make_table(AXES), sensitivities=None)
    for mode, orders in ((Mode.HERMITE, None), (Mode.AMPI, (Order.LINEAR, Order.HERMITE))):
        with pytest.raises(ValueError, match="orders: hermite needs a table with sensitivities"):
            ReferenceGenerator(table, mode, orders)
    with pytest.raises(ValueError, match="orders: expected 2, one an axis, got 1"):
        ReferenceGenerator(table, Mode.AMPI, (Order.LINEAR,))


def test_sensitivities_are_checked_and_locked(make_table: TableMaker) -> None:
    table = make_table(AXES)
    assert table.sensitivities is not None
    with pytest.raises(ValueError, match="sensitivities has shape"):
        replace(table, sensitivities=table.sensitivities[..., :-1])
    wrong = table.sensitivities.copy()
    wrong[1, 1, 0, 5] = np.nan
    with pytest.raises(ValueError, match="sensitivities must be finite"):
        replace(table, sensitivities=wrong)
    with pytest.raises(ValueError, match="read-only"):
        table.sensitivities[0, 0, 0, 0] = 1.0


def test_a_hole_beyond_the_cell_is_told_where_its_second_difference_counts(
    make_table: TableMaker,
) -> None:
    solved = np.ones((5, 3), dtype=bool)
    solved[3, 1] = False
    table = replace(make_table(AXES), solved=solved)
    second = ReferenceGenerator(table, Mode.SECOND_DIFFERENCES)
    assert second.reference([1.2, 11.3]).hole
    assert not second.reference([-0.5, 11.3]).hole  # of the first cell 3 is no neighbour
    assert not second.reference([1.2, 13.0]).hole  # in no plane of it
    assert not ReferenceGenerator(table, Mode.AMPI).reference([1.2, 11.3]).hole
