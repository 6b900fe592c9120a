"""Algorithm 1, written out from Table 3 of Sagliano et al. 2016, against ours; weights on an axis."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.onboard.subspace import located, point_weights

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=300)
fractions = st.floats(0.0, 1.0)


@st.composite
def axes(draw: st.DrawFn, least: int = 2, most: int = 8) -> Array:
    """Strictly increasing points with uneven gaps over six decades, anywhere."""
    start = draw(st.floats(-1e4, 1e4))
    gaps = draw(st.lists(st.floats(1e-2, 1e4), min_size=least - 1, max_size=most - 1))
    return start + np.concatenate([[0.0], np.cumsum(gaps)])


@st.composite
def axes_and_inside(draw: st.DrawFn, least: int = 2, most: int = 8) -> tuple[Array, float]:
    """An axis and a parameter on it: between its points, or exactly one of them."""
    axis = draw(axes(least, most))
    if draw(st.booleans()):
        return axis, float(draw(st.sampled_from(axis.tolist())))
    x = float(axis[0] + draw(fractions) * (axis[-1] - axis[0]))
    return axis, min(max(x, float(axis[0])), float(axis[-1]))


def table_3(p: Array, x: float) -> list[int]:
    """First index h (counted from 1) of [h, h + 1]; two of them if x is an inner grid point."""
    n = len(p)
    eP = np.sign(p - np.ones(n) * x)
    delta = np.array([eP[j] - eP[j - 1] for j in range(1, n)])
    if eP.sum() == -n:
        return [n - 1]
    if eP.sum() == n:
        return [1]
    return [int(j) + 1 for j in np.flatnonzero(delta != 0)]


def selected(axis: Array, x: float, order: int, width: int = 4) -> tuple[int, bool, Array]:
    points, weights = axis.tolist(), np.zeros(width)
    inside, below, clipped = located(points, x)
    k = min(order, len(points))
    first = point_weights(points, inside, below, k, weights[:k])
    return first, clipped, weights


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(case=axes_and_inside())
def test_algorithm_1_of_the_paper_selects_the_same_cell(case: tuple[Array, float]) -> None:
    axis, x = case
    first, clipped, weights = selected(axis, x, 2)
    assert first + 1 in table_3(axis, x)
    assert axis[first] <= x <= axis[first + 1]
    assert not clipped
    assert np.all((weights >= 0.0) & (weights <= 1.0))


@laws
@given(axis=axes(), beyond=st.floats(1e-6, 1e9), above=st.booleans())
def test_algorithm_1_outside_selects_the_same_cell_and_its_boundary_trajectory(
    axis: Array, beyond: float, above: bool
) -> None:
    x = float(axis[-1]) + beyond if above else float(axis[0]) - beyond
    first, clipped, weights = selected(axis, x, 2)
    assert [first + 1] == table_3(axis, x)
    assert clipped
    assert weights.tolist() == ([0.0, 1.0, 0.0, 0.0] if above else [1.0, 0.0, 0.0, 0.0])


@laws
@given(case=axes_and_inside(), order=st.sampled_from([1, 2, 3, 4]))
def test_weights_are_a_partition_of_unity_and_reproduce_the_parameter(
    case: tuple[Array, float], order: int
) -> None:
    axis, x = case
    first, _, weights = selected(axis, x, order)
    k = min(order, len(axis))
    assert weights[:k].sum() == pytest.approx(1.0, abs=1e-12 * np.abs(weights).sum())
    assert np.all(weights[k:] == 0.0)
    if k > 1:
        offset = axis[first : first + k] - x
        size = float(np.abs(weights[:k] * offset).sum())
        assert weights[:k] @ offset == pytest.approx(0.0, abs=1e-9 * size)


@laws
@given(
    case=axes_and_inside(least=4),
    order=st.sampled_from([3, 4]),
    coefficients=st.tuples(*[st.floats(-5.0, 5.0)] * 4),
)
def test_order_k_reproduces_polynomials_of_degree_k_minus_1(
    case: tuple[Array, float], order: int, coefficients: tuple[float, float, float, float]
) -> None:
    axis, x = case
    first, clipped, weights = selected(axis, x, order, order)
    span = float(axis[first + order - 1] - axis[first])
    local = (axis[first : first + order] - x) / span  # centred on the parameter
    values = np.polyval(coefficients[4 - order :], local)
    size = float((np.abs(weights) * np.abs(values)).sum()) + 1.0
    assert weights @ values == pytest.approx(coefficients[3], abs=1e-9 * size)
    assert not clipped


@laws
@given(case=axes_and_inside())
def test_order_1_takes_the_nearer_point(case: tuple[Array, float]) -> None:
    axis, x = case
    first, _, weights = selected(axis, x, 1)
    assert abs(axis[first] - x) == np.abs(axis - x).min()
    assert weights.tolist() == [1.0, 0.0, 0.0, 0.0]


@laws
@given(case=axes_and_inside(least=3), order=st.sampled_from([2, 3, 4]))
def test_the_subspace_is_of_the_cell_not_of_the_place_in_it(
    case: tuple[Array, float], order: int
) -> None:
    """Pieces meet at points of the axis alone, where both have the value there: continuous."""
    axis, x = case
    n, k = len(axis), min(order, len(axis))
    first, _, _ = selected(axis, x, order)
    cell = min(int(np.searchsorted(axis, x, side="right")) - 1, n - 2)
    assert first <= cell <= first + k - 2
    centred = {2: cell, 3: 2 * (cell // 2), 4: max(cell - 1, 0)}[order]
    assert first == min(centred, n - k)


@laws
@given(axis=axes(), order=st.sampled_from([1, 2, 3, 4]), share=fractions)
def test_a_vertex_has_weight_one_at_itself(axis: Array, order: int, share: float) -> None:
    j = min(int(share * len(axis)), len(axis) - 1)
    first, clipped, weights = selected(axis, float(axis[j]), order)
    expected = np.zeros(4)
    expected[j - first] = 1.0
    assert weights.tolist() == expected.tolist()
    assert not clipped


@laws
@given(axis=axes(), order=st.sampled_from([1, 2, 3, 4]))
def test_not_a_number_falls_back_to_the_middle_and_is_flagged(axis: Array, order: int) -> None:
    first, clipped, weights = selected(axis, math.nan, order)
    assert clipped
    k = min(order, len(axis))
    at = float(weights[:k] @ axis[first : first + k])
    middle = float(axis[len(axis) // 2])
    assert at == pytest.approx(middle, rel=1e-15, abs=0.0)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize(("x", "value"), [(math.inf, 4.0), (-math.inf, -1.0)])
def test_infinity_falls_back_to_the_boundary_and_is_flagged(
    order: int, x: float, value: float
) -> None:
    axis = np.array([-1.0, 0.0, 1.5, 4.0])
    first, clipped, weights = selected(axis, x, order)
    assert clipped
    assert weights[:order] @ axis[first : first + order] == value


# --- examples -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "order", "first", "weights"),
    [
        (0.25, 2, 0, [0.75, 0.25, 0.0, 0.0]),
        (1.0, 2, 1, [1.0, 0.0, 0.0, 0.0]),
        (2.0, 2, 1, [0.0, 1.0, 0.0, 0.0]),
        (1.75, 2, 1, [0.25, 0.75, 0.0, 0.0]),
        (0.5, 3, 0, [0.375, 0.75, -0.125, 0.0]),
    ],
)
def test_three_points(x: float, order: int, first: int, weights: list[float]) -> None:
    found, clipped, got = selected(np.array([0.0, 1.0, 2.0]), x, order)
    assert (found, clipped, got.tolist()) == (first, False, weights)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_an_axis_of_one_point_has_weight_one_and_flags_everything_else(order: int) -> None:
    axis = np.array([5.0])
    for x, outside in [(5.0, False), (5.1, True), (-3.0, True), (math.nan, True)]:
        first, clipped, weights = selected(axis, x, order)
        assert (first, clipped, weights.tolist()) == (0, outside, [1.0, 0.0, 0.0, 0.0])


def test_order_3_on_two_points_is_linear() -> None:
    first, clipped, weights = selected(np.array([0.0, 4.0]), 1.0, 3)
    assert (first, clipped, weights.tolist()) == (0, False, [0.75, 0.25, 0.0, 0.0])
