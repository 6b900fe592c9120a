"""References that are being flown: n look-ups at once are each numpy's interpolation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.onboard.flown_references import FlownReferences
from ampi.onboard.health import Health
from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=200)


def drawn(n: int, points: int, seed: int) -> FlownReferences:
    """Random rows at times of their own."""
    rng = np.random.default_rng(seed)
    flown = FlownReferences(n, points, LINEAR_TRACKING)
    flown.times[...] = np.cumsum(rng.uniform(0.1, 2.0, (n, points)), axis=1)
    flown.rows[...] = rng.standard_normal(flown.rows.shape)
    return flown


@laws
@given(
    n=st.integers(1, 5),
    points=st.integers(2, 40),
    shares=st.lists(st.floats(-0.5, 1.5), min_size=1, max_size=6),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_look_up_is_numpys_interpolation_held_at_both_ends(
    n: int, points: int, shares: list[float], seed: int
) -> None:
    """In any order of the look-ups: forwards, back, and from one end to the other."""
    flown = drawn(n, points, seed)
    begin, length = flown.times[:, 0], np.ptp(flown.times, axis=1)
    for share in (0.0, *shares, 1.0, 0.0):
        value = begin + (share + 0.01 * np.arange(n)) * length
        at = flown.at(flown.times, value)
        assert at.shape == (len(LINEAR_TRACKING), n)
        for i in range(n):
            for row in (0, 7, 14):
                expected = np.interp(value[i], flown.times[i], flown.rows[i, :, row])
                assert at[row, i] == pytest.approx(expected, abs=1e-12)


@laws
@given(seed=st.integers(0, 2**32 - 1), points=st.integers(2, 40))
def test_a_flight_looks_up_the_same_bits_alone_and_in_company(seed: int, points: int) -> None:
    many = drawn(7, points, seed)
    rng = np.random.default_rng(seed)
    alone = []
    for i in range(7):
        one = FlownReferences(1, points, LINEAR_TRACKING)
        one.times[0], one.rows[0] = many.times[i], many.rows[i]
        alone.append(one)
    for value in rng.uniform(0.0, many.times.max(), (4, 7)):
        together = many.at(many.times, value)
        for i, one in enumerate(alone):
            assert np.array_equal(one.at(one.times, value[i : i + 1])[:, 0], together[:, i])


def test_what_increases_along_a_reference_may_be_something_else_than_time() -> None:
    flown = drawn(3, 20, 5)
    spent = flown.times**2 + 3.0
    at = flown.at(spent, spent[:, 4] + 0.25 * (spent[:, 5] - spent[:, 4]))
    expected = 0.75 * flown.rows[:, 4] + 0.25 * flown.rows[:, 5]
    assert np.abs(at.T - expected).max() < 1e-12


def test_a_reference_is_flown_with_what_is_told_of_it_and_keeps_its_numbers(
    table: GuidanceTable,
) -> None:
    generator = ReferenceGenerator(table, Mode.AMPI)
    flown = FlownReferences(2, table.conversion.shape[1], table.layout)
    centre = np.array([axis[i] for axis, i in zip(table.axes, table.centre, strict=True)])
    kept: list[Reference] = []
    for i, p in enumerate((centre, centre + 100.0)):
        reference = generator.reference(p)
        flown.set(i, reference)
        kept.append(reference.copy())
    generator.reference(centre + 0.1)  # overwrites what it has made
    for i, reference in enumerate(kept):
        assert np.array_equal(flown.times[i], reference.times)
        assert np.array_equal(flown.rows[i], reference.rows.T)
    assert flown.final_time.tolist() == [reference.final_time for reference in kept]
    assert flown.health.tolist() == [int(Health.GOOD), int(Health.FAR_OUTSIDE)]
    assert flown.clipped.tolist() == [False, True]
    flown.set(0, replace(kept[0], hole=True))
    assert flown.hole.tolist() == [True, False]
    assert len(flown) == 2
