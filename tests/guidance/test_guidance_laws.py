"""Guidance on a synthetic table: the command, its health, and what it never does."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.onboard.command import Command
from ampi.onboard.health import Health
from ampi.onboard.reference import Mode, Reference
from ampi.tracking.bank_limiter import limited_rate
from tests.support.references import asking, at_instant
from tests.support.steps import command

Array = NDArray[np.float64]
MODES = [mode for mode in Mode if mode is not Mode.HERMITE]  # no sensitivities in these tables

laws = settings(deadline=None, max_examples=200)
shares = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6)
seeds = st.integers(0, 2**32 - 1)
anything = st.floats(width=64)
sevens = st.lists(anything, min_size=7, max_size=7)
sixes = st.lists(anything, min_size=6, max_size=6)


def rows(reference: Reference) -> Array:
    return np.vstack([reference.states, reference.bank_rate, reference.gains])


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(entry=shares, share=st.floats(0.0, 0.999), seed=seeds)
def test_the_command_is_the_tracking_law_through_the_limiter(
    synthetic: Guidance, entry: list[float], share: float, seed: int
) -> None:
    reference = synthetic.reference(entry)
    time = share * reference.final_time
    looked_up = at_instant(synthetic.table, reference, time)
    at = looked_up[:7]
    rng = np.random.default_rng(seed)
    error = 0.05 * rng.standard_normal(7) * np.abs(at)
    state, rate = at + error, float(rng.uniform(-0.1, 0.1))
    state[6] = np.clip(state[6], -1.0, 1.0)
    error[6] = state[6] - at[6]
    wanted = looked_up[7] - looked_up[8:] @ error
    expected = float(limited_rate(synthetic.limits, state[6], rate, wanted, 0.5))
    synthetic.reset()
    got = command(synthetic, reference, time, state, rate)
    assert got.bank_rate == pytest.approx(expected, abs=1e-10)
    assert got.bank_angle == pytest.approx(state[6] + 0.25 * (rate + expected), abs=1e-10)
    assert got.health is Health.GOOD


@laws
@given(entry=shares, share=st.floats(0.0, 0.999), rate=st.floats(-0.1, 0.1))
def test_on_the_reference_its_own_bank_rate_is_commanded(
    synthetic: Guidance, entry: list[float], share: float, rate: float
) -> None:
    reference = synthetic.reference(entry)
    time = share * reference.final_time
    looked_up = at_instant(synthetic.table, reference, time)
    state, own = looked_up[:7], looked_up[7]
    limits = synthetic.limits  # a random reference may bank beyond them, and has to come back
    expected = np.clip(limited_rate(limits, state[6], rate, own, 0.5), -limits.rate, limits.rate)
    synthetic.reset()
    got = command(synthetic, reference, time, state, rate).bank_rate
    assert got == pytest.approx(expected, abs=1e-10)


@laws
@given(entry=sixes, time=anything, state=sevens, rate=anything, mode=st.sampled_from(MODES))
def test_no_numbers_raise(
    synthetic: Guidance,
    entry: list[float],
    time: float,
    state: list[float],
    rate: float,
    mode: Mode,
) -> None:
    guidance = synthetic.in_mode(mode)
    reference = guidance.reference(entry)
    got = command(guidance, reference, time, np.array(state), rate)
    assert isinstance(got, Command)
    assert np.isfinite([got.bank_rate, got.bank_angle]).all()
    assert np.all(np.isfinite(rows(reference)))
    if not np.abs(time) < 1e12:
        assert got.health is Health.BAD_TIME
    elif time >= reference.final_time:
        assert got.health is Health.AFTER_FINAL_TIME
    elif not np.all(np.abs([*state, rate]) < 1e12):
        assert got.health is Health.BAD_NAVIGATION
    elif not (plausible(guidance, state) and abs(rate) <= 0.2):
        assert got.health is Health.IMPLAUSIBLE_NAVIGATION
    else:
        assert got.health is reference.health


def plausible(guidance: Guidance, state: list[float]) -> bool:
    """Written out: half a width beyond what the table's states span; angles up to three turns off."""
    for row, x in enumerate(state):
        of_table = guidance.table.values[..., row, :]
        low, high = float(of_table.min()), float(of_table.max())
        width = max(high - low, 0.2) if row in (1, 2, 4, 5) else high - low
        if row in (1, 5, 6):  # these random latitudes reach over the poles: any direction will do
            if abs(x) > 7.0 * np.pi:
                return False
        elif not low - 0.5 * width <= x <= high + 0.5 * width:
            return False
    return True


@laws
@given(
    entry=sixes,
    time=st.floats(-1e6, 1e6),
    state=st.lists(
        st.one_of(st.floats(-1e12, 1e12), st.sampled_from([np.nan, np.inf, -np.inf])),
        min_size=6,
        max_size=6,
    ),
    bank=st.floats(-1.0, 1.0),
    rate=st.floats(-0.1, 0.1),
)
def test_whatever_navigation_says_the_command_can_be_flown(
    synthetic: Guidance,
    entry: list[float],
    time: float,
    state: list[float],
    bank: float,
    rate: float,
) -> None:
    """The bank angle, measured by the vehicle itself, apart."""
    synthetic.reset()  # the limits are of commands, and this is the first
    reference = synthetic.reference(entry)
    got = command(synthetic, reference, time, np.array([*state, bank]), rate)
    assert abs(got.bank_rate - rate) <= 0.07 * 0.5 * (1.0 + 1e-12)
    assert np.isfinite(got.bank_angle)


@laws
@given(entry=shares, mode=st.sampled_from(MODES))
def test_a_pickled_guidance_makes_the_same_references(
    synthetic: Guidance, entry: list[float], mode: Mode
) -> None:
    guidance = synthetic.in_mode(mode)
    restored = pickle.loads(pickle.dumps(guidance))
    assert (restored.mode, restored.cycle, restored.limits) == (mode, 0.5, guidance.limits)
    here, there = guidance.reference(entry), restored.reference(entry)
    assert np.array_equal(rows(here), rows(there))
    assert np.array_equal(here.times, there.times)
    assert (here.final_time, here.cell, here.clipped) == (
        there.final_time,
        there.cell,
        there.clipped,
    )
    assert not np.shares_memory(here.states, there.states)


# --- health ---------------------------------------------------------------------------------------


def test_good(synthetic: Guidance) -> None:
    reference = synthetic.reference([0.1] * 6)
    assert command(synthetic, reference, 10.0, reference.states[:, 5], 0.0).health is Health.GOOD


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize(
    ("value", "health"),
    [
        (1.001, Health.BOUNDARY_REFERENCE),
        (-1.399, Health.BOUNDARY_REFERENCE),  # 20 % of the range of 2
        (1.401, Health.FAR_OUTSIDE),
        (np.nan, Health.BAD_PARAMETERS),
        (np.inf, Health.BAD_PARAMETERS),
    ],
)
def test_a_boundary_reference_is_told(
    synthetic: Guidance, axis: int, value: float, health: Health
) -> None:
    entry = np.full(6, 0.1)
    entry[axis] = value
    reference = synthetic.reference(entry)
    assert reference.clipped == tuple(i == axis for i in range(6))
    got = command(synthetic, reference, 10.0, reference.states[:, 5], 0.0)
    assert got.health is reference.health is health


@pytest.mark.parametrize("row", range(6))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_bad_navigation_flies_the_references_own_bank_rate(
    synthetic: Guidance, row: int, value: float
) -> None:
    reference = synthetic.reference([0.1] * 6)
    state = np.zeros(7)
    state[row] = value
    got = command(synthetic, reference, 10.0, state, 0.0)
    own = at_instant(synthetic.table, reference, 10.0)[7]
    assert got.health is Health.BAD_NAVIGATION
    assert got.bank_rate == pytest.approx(
        float(limited_rate(synthetic.limits, 0.0, 0.0, own, 0.5)), abs=1e-14
    )


@pytest.mark.parametrize("late", [0.0, 0.5, 1e9])
def test_after_the_final_time_the_bank_angle_is_held(synthetic: Guidance, late: float) -> None:
    reference = synthetic.reference([0.1] * 6)
    state, rate = 2.0 * SOME_STATE, 0.09
    for cycle in range(6):
        time = reference.final_time + late + 0.5 * cycle
        got = command(synthetic, reference, time, state, rate)
        assert got.health is Health.AFTER_FINAL_TIME
        assert got.bank_rate == pytest.approx(max(0.0, 0.09 - 0.035 * (cycle + 1)), abs=1e-12)
        state[6], rate = got.bank_angle, got.bank_rate
    assert rate == 0.0


SOME_STATE = np.array([3e4, 0.5, 1.1, 2e3, -0.1, 4.0, 0.1])


# --- modes ----------------------------------------------------------------------------------------


def test_modes_differ_between_the_vertices_and_agree_where_they_must(synthetic: Guidance) -> None:
    corner = np.array([1.0, -1.0, 1.0, 1.0, -1.0, -1.0])
    centre = [
        float(a[i]) for a, i in zip(synthetic.table.axes, synthetic.table.centre, strict=True)
    ]
    between = [0.3, 0.2, -0.7, 0.1, 0.6, -0.4]

    def final_time(mode: Mode, entry: object) -> float:
        return synthetic.in_mode(mode).reference(np.asarray(entry)).final_time

    at_corner = {m: final_time(m, corner) for m in MODES}
    assert at_corner[Mode.MPI] == at_corner[Mode.AMPI] == at_corner[Mode.QUADRATIC]
    assert at_corner[Mode.NOMINAL] == synthetic.table.final_time[synthetic.table.centre]
    at_centre = {m: final_time(m, centre) for m in MODES}
    assert at_centre[Mode.NOMINAL] == at_centre[Mode.AMPI] == at_centre[Mode.QUADRATIC]
    assert at_centre[Mode.MPI] != at_centre[Mode.AMPI]
    apart = set(MODES) - {Mode.CUBIC}  # which on three points is quadratic
    assert len({final_time(m, between) for m in apart}) == len(apart)
    assert final_time(Mode.CUBIC, between) == final_time(Mode.QUADRATIC, between)


def test_in_mode_keeps_everything_else(synthetic: Guidance) -> None:
    slow = Guidance(synthetic.table, synthetic.limits, cycle=2.0, mission_sha256="abc")
    other = slow.in_mode("mpi")
    assert (other.mode, other.cycle, other.limits) == (Mode.MPI, 2.0, synthetic.limits)
    assert other.mission_sha256 == "abc"
    assert other.table is synthetic.table
    assert slow.mode is Mode.AMPI


def test_the_cycle_scales_what_one_command_may_change(synthetic: Guidance) -> None:
    changes = []
    for cycle in (0.1, 0.5, 1.0):
        guidance = Guidance(synthetic.table, synthetic.limits, cycle=cycle)
        eager = asking(guidance.reference([0.1] * 6), 9.0)  # far more than the limits
        changes.append(command(guidance, eager, 10.0, np.zeros(7), 0.0).bank_rate)
    assert changes == pytest.approx([0.007, 0.035, 0.07], rel=1e-12)


@pytest.mark.parametrize("what", ["bank", "rate", "time"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_command_is_always_finite(synthetic: Guidance, what: str, value: float) -> None:
    reference = synthetic.reference([0.1] * 6)
    state, rate, time = SOME_STATE.copy(), 0.0, 10.0
    if what == "bank":
        state[6] = value
    rate, time = (value if what == "rate" else rate), (value if what == "time" else time)
    got = command(synthetic, reference, time, state, rate)
    assert got.health is (Health.BAD_TIME if what == "time" else Health.BAD_NAVIGATION)
    assert np.isfinite(got.bank_rate)
    assert np.isfinite(got.bank_angle)
    assert abs(got.bank_rate) <= synthetic.limits.rate
