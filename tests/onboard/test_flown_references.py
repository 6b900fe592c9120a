"""References that are being flown: n look-ups at once are each the polynomial at its instant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator

from ampi.onboard.flown_references import FlownReferences
from ampi.onboard.health import Health
from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.table import GuidanceTable
from tests.onboard.conftest import MESH

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=100)
# a time of 1e-310 s is beyond the library that is the witness: it divides by it
some_shares = st.lists(st.floats(-0.5, 1.5, allow_subnormal=False), min_size=1, max_size=6)


def drawn(table: GuidanceTable, n: int, seed: int) -> FlownReferences:
    """Random rows with final times of their own."""
    rng = np.random.default_rng(seed)
    flown = FlownReferences(n, table)
    flown.nodal[...] = rng.standard_normal(flown.nodal.shape)
    flown.final_time[...] = rng.uniform(90.0, 110.0, n)
    return flown


def by_energy(times: Array, rows: Array) -> Array:
    """Something else than time that increases, and of which time is a quadratic function."""
    return np.sqrt(times + 25.0)


def by_two(times: Array, rows: Array) -> Array:
    """At first the time, then, a long way off, the energy."""
    return np.where(times < 40.0, times - 1e9, by_energy(times, rows))


@laws
@given(
    n=st.integers(1, 5),
    shares=some_shares,
    seed=st.integers(0, 2**32 - 1),
)
def test_a_look_up_is_scipys_polynomial_of_the_segment_held_at_both_ends(
    table: GuidanceTable, n: int, shares: list[float], seed: int
) -> None:
    flown = drawn(table, n, seed)
    for share in (0.0, *shares, 1.0):
        time = (share + 0.01 * np.arange(n)) * flown.final_time
        at = flown.at(time)
        assert at.shape == (len(table.layout), n)
        for i in range(n):
            held = np.clip(time[i], 0.0, flown.final_time[i])
            begins = [s.start[0] + s.start[1] * flown.final_time[i] for s in MESH.segments]
            segment = MESH.segments[int(np.searchsorted(begins[1:], held, side="right"))]
            nodes = MESH.times(flown.final_time[i])[segment.nodes]
            expected = BarycentricInterpolator(nodes, flown.nodal[i, segment.nodes])(held)
            assert at[:, i] == pytest.approx(expected, abs=1e-11)


def test_at_a_node_it_is_the_nodes_row_to_the_bit(table: GuidanceTable) -> None:
    flown = drawn(table, 1, 3)
    flown.final_time[:] = 84.0  # begins and halves of lengths are whole numbers: τ is exact at ends
    for segment in MESH.segments:
        begin = segment.start[0] + segment.start[1] * 84.0
        at = flown.at(np.array([begin]))[:, 0]
        assert at == pytest.approx(flown.nodal[0, segment.first_node], rel=1e-13, abs=1e-13)
    assert flown.at(np.array([84.0]))[:, 0] == pytest.approx(flown.nodal[0, -1], rel=1e-13)


@laws
@given(seed=st.integers(0, 2**32 - 1), is_by_time=st.booleans())
def test_a_flight_looks_up_the_same_bits_alone_and_in_company(
    table: GuidanceTable, seed: int, is_by_time: bool
) -> None:
    many = drawn(table, 7, seed)
    rng = np.random.default_rng(seed)
    alone = []
    for i in range(7):
        one = FlownReferences(1, table)
        one.nodal[0], one.final_time[0] = many.nodal[i], many.final_time[i]
        alone.append(one)
    if not is_by_time:
        for flown in (many, *alone):
            flown.look_up_by(by_energy)
    for value in rng.uniform(0.0, many.end.max(), (4, 7)):
        together = many.at(value)
        for i, one in enumerate(alone):
            assert np.array_equal(one.at(value[i : i + 1])[:, 0], together[:, i])


@laws
@given(shares=some_shares)
def test_what_increases_along_a_reference_may_be_something_else_than_time(
    table: GuidanceTable, shares: list[float]
) -> None:
    """In any order of the look-ups: forwards, back, and from one end to the other."""
    flown = drawn(table, 3, 5)
    by_time, ends = drawn(table, 3, 5), by_energy(flown.final_time, flown.final_time)
    flown.look_up_by(by_energy)
    assert flown.end == pytest.approx(ends, rel=1e-15)
    for share in (0.0, *shares, 1.0, 0.0):
        value = 5.0 + share * (ends - 5.0)
        instant = np.clip(value**2 - 25.0, 0.0, flown.final_time)  # held at both ends
        assert flown.at(value) == pytest.approx(by_time.at(instant), abs=1e-9)


@laws
@given(share=st.floats(0.0, 1.0))
def test_where_the_look_up_changes_neither_side_bends_the_other(
    table: GuidanceTable, share: float
) -> None:
    flown, by_time = drawn(table, 3, 5), drawn(table, 3, 5)
    flown.look_up_by(by_two)
    instant = share * flown.final_time
    found = flown.at(by_two(instant, instant))
    fixed, free = table.high_density_time
    times = fixed + free * flown.final_time[:, None]
    changes = [t[np.searchsorted(t, 40.0) - 1 :][:2] for t in times]  # in no other interval
    for i, (last, first) in enumerate(changes):
        if not last < instant[i] < first:
            assert found[:, i] == pytest.approx(by_time.at(instant)[:, i], abs=1e-5)


def test_a_reference_is_flown_with_what_is_told_of_it_and_keeps_its_numbers(
    table: GuidanceTable,
) -> None:
    generator = ReferenceGenerator(table, Mode.AMPI)
    flown = FlownReferences(2, table)
    centre = np.array([axis[i] for axis, i in zip(table.axes, table.centre, strict=True)])
    kept: list[Reference] = []
    for i, p in enumerate((centre, centre + 100.0)):
        reference = generator.reference(p)
        flown.set(i, reference)
        kept.append(reference.copy())
    generator.reference(centre + 0.1)  # overwrites what it has made
    for i, reference in enumerate(kept):
        assert np.array_equal(flown.nodal[i], reference.nodal.T)
        assert np.array_equal(flown.first[:, i], reference.nodal[:, 0])
    times = np.stack([reference.times for reference in kept])
    for k in range(0, times.shape[1], 7):  # the high-density points lie on the polynomials
        expected = np.stack([reference.rows[:, k] for reference in kept], axis=1)
        assert flown.at(times[:, k]) == pytest.approx(expected, abs=1e-11)
    assert flown.final_time.tolist() == [reference.final_time for reference in kept]
    assert flown.health.tolist() == [int(Health.GOOD), int(Health.FAR_OUTSIDE)]
    assert flown.clipped.tolist() == [False, True]
    flown.set(0, replace(kept[0], hole=True))
    assert flown.hole.tolist() == [True, False]
    assert len(flown) == 2
