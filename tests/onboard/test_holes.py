"""A table with holes: as it would be without them outside their cells, flagged and bounded inside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.onboard.health import Health
from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.table import GuidanceTable, nearest_solved
from ampi.tracking.bank_limiter import BankLimits

Array = NDArray[np.float64]
TableMaker = Callable[..., GuidanceTable]

laws = settings(deadline=None, max_examples=60)
AXES = (np.array([-1.0, 0.0, 2.0, 3.0]), np.array([10.0, 11.0, 13.0]), np.array([5.0, 6.0, 7.0]))
shares = st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3)
holes = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 2), st.integers(0, 2)),
    min_size=1,
    max_size=6,
    unique=True,
)
CELL = {Mode.AMPI: 2, Mode.QUADRATIC: 3, Mode.CUBIC: 4, Mode.HERMITE: 2}


def point(share: list[float]) -> Array:
    return np.array(
        [min(a[0] + s * (a[-1] - a[0]), a[-1]) for a, s in zip(AXES, share, strict=True)]
    )


def rows(reference: Reference) -> Array:
    return np.vstack([reference.states, reference.bank_rate, reference.gains, reference.times])


def with_holes(table: GuidanceTable, at: list[tuple[int, ...]]) -> GuidanceTable:
    """As loading does it: the rows of the nearest solved case, and the truth about it."""
    solved = np.ones(table.final_time.shape, dtype=bool)
    for index in at:
        solved[index] = False
    nearest = np.unravel_index(nearest_solved(table.axes, solved), solved.shape)
    return replace(
        table,
        values=table.values[nearest],
        final_time=table.final_time[nearest],
        solved=solved,
    )


@pytest.fixture(scope="module")
def whole(make_table: TableMaker) -> GuidanceTable:
    return make_table(AXES)


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(share=shares, at=holes, mode=st.sampled_from(list(CELL)))
def test_outside_the_cells_of_a_hole_nothing_changes_and_inside_it_is_told(
    whole: GuidanceTable, share: list[float], at: list[tuple[int, ...]], mode: Mode
) -> None:
    expected = ReferenceGenerator(whole, mode).reference(point(share)).copy()
    assert not expected.hole
    got = ReferenceGenerator(with_holes(whole, at), mode).reference(point(share))
    used = [
        {first + j for j in range(min(CELL[mode], len(axis)))}
        if x not in axis
        else {int(np.searchsorted(axis, x))}
        for axis, first, x in zip(AXES, expected.cell, point(share), strict=True)
    ]
    touched = any(all(i in u for i, u in zip(index, used, strict=True)) for index in at)
    assert got.hole is touched
    if not touched:
        assert np.array_equal(rows(got), rows(expected))
        assert got.final_time == expected.final_time


@laws
@given(share=shares, beyond=st.floats(0.0, 1.0))
def test_a_face_without_solutions_is_the_boundary_of_what_was_solved(
    whole: GuidanceTable, share: list[float], beyond: float
) -> None:
    """All cases at the lowest value of an axis have failed: there p is clipped to the next."""
    face = [(0, j, k) for j in range(3) for k in range(3)]
    generator = ReferenceGenerator(with_holes(whole, face), Mode.AMPI)
    inside = point(share)
    inside[0] = AXES[0][1]
    expected = ReferenceGenerator(whole, Mode.AMPI).reference(inside).copy()
    outside = inside.copy()
    outside[0] -= beyond * (AXES[0][1] - AXES[0][0])
    got = generator.reference(outside)
    assert rows(got) == pytest.approx(rows(expected), rel=1e-12, abs=1e-12)
    assert got.hole is bool(outside[0] < AXES[0][1])


@laws
@given(share=shares, at=holes, mode=st.sampled_from(list(Mode)))
def test_a_reference_in_a_hole_is_finite_and_made_of_solved_cases(
    whole: GuidanceTable, share: list[float], at: list[tuple[int, ...]], mode: Mode
) -> None:
    table = with_holes(whole, at)
    generator = ReferenceGenerator(table, mode)
    reference = generator.reference(point(share))
    assert np.all(np.isfinite(rows(reference)))
    assert table.solved is not None
    if mode in (
        Mode.NOMINAL,
        Mode.MPI,
        Mode.NEAREST,
        Mode.AMPI,
    ):  # convex weights: between the optima that there are
        values = whole.values[table.solved]
        assert np.all(generator.nodal_values <= values.max(axis=0) + 1e-12)
        assert np.all(generator.nodal_values >= values.min(axis=0) - 1e-12)


@laws
@given(at=holes)
def test_nearest_in_shares_of_the_ranges_and_the_first_of_equals(
    at: list[tuple[int, ...]],
) -> None:
    solved = np.ones((4, 3, 3), dtype=bool)
    for index in at:
        solved[index] = False
    nearest = nearest_solved(AXES, solved)
    scaled = [(a - a[0]) / (a[-1] - a[0]) for a in AXES]
    places = np.stack(np.meshgrid(*scaled, indexing="ij"), axis=-1).reshape(-1, 3)
    for case in range(solved.size):
        if solved.ravel()[case]:
            assert nearest.ravel()[case] == case
            continue
        distance = ((places - places[case]) ** 2).sum(axis=1)
        distance[~solved.ravel()] = np.inf
        found = nearest.ravel()[case]
        assert distance[found] == pytest.approx(distance.min(), rel=1e-12)
        assert found == np.flatnonzero(distance <= distance.min() * (1.0 + 1e-12))[0]


# --- modes and health -----------------------------------------------------------------------------


def test_mpi_needs_its_corners_alone_and_nominal_the_centre_alone(whole: GuidanceTable) -> None:
    p = point([0.3, 0.4, 0.9])
    inner, corner = with_holes(whole, [(1, 1, 1)]), with_holes(whole, [(3, 0, 2)])
    centre = with_holes(whole, [whole.centre])
    assert not ReferenceGenerator(inner, Mode.MPI).reference(p).hole
    assert ReferenceGenerator(corner, Mode.MPI).reference(p).hole
    assert not ReferenceGenerator(corner, Mode.NOMINAL).reference(p).hole
    assert ReferenceGenerator(centre, Mode.NOMINAL).reference(p).hole


def test_the_command_tells_it_and_so_does_the_copy(whole: GuidanceTable) -> None:
    guidance = Guidance(with_holes(whole, [(3, 2, 2)]), BankLimits(1.0, 0.1, 0.07))
    for p, health in (([2.5, 12.0, 6.5], Health.HOLE_REFERENCE), ([0.5, 12.0, 6.5], Health.GOOD)):
        reference = guidance.reference(p)
        guidance.follow(reference)
        assert guidance.step(10.0, [*reference.states[:, 5], 0.0]).health is health
        assert bool(guidance.flown.hole[0]) is reference.hole is (health is Health.HOLE_REFERENCE)


def test_the_mask_is_checked_and_locked(whole: GuidanceTable) -> None:
    with pytest.raises(ValueError, match=r"solved has shape \(4, 3\), expected \(4, 3, 3\)"):
        replace(whole, solved=np.ones((4, 3), dtype=bool))
    table = with_holes(whole, [(0, 0, 0)])
    assert table.solved is not None
    with pytest.raises(ValueError, match="read-only"):
        table.solved[0, 0, 0] = True
