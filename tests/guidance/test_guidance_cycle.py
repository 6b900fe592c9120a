"""Guidance measures its own cycle: own loops of any rate, jitter, silences and clocks that fail."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.onboard.clock import NOMINAL_CYCLE
from ampi.onboard.command import Command
from ampi.onboard.health import Health
from ampi.onboard.reference import Mode, Reference
from ampi.tracking.bank_limiter import BankLimits
from tests.support.references import asking
from tests.support.steps import command

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=40)
DEGREE = np.pi / 180.0
LIMITS = BankLimits(60.0 * DEGREE, 5.0 * DEGREE, 4.0 * DEGREE)
SLACK = 1.0 + 1e-9
MODES = ", ".join(mode.value for mode in Mode)
STATE = np.array([3e4, 0.5, 1.1, 2e3, -0.1, 4.0, 0.0])


@pytest.fixture
def guidance(synthetic: Guidance) -> Guidance:
    """As it is loaded: no cycle stated."""
    return Guidance(synthetic.table, LIMITS)


def eager(guidance: Guidance, ask: float = 9.0) -> Reference:
    """A reference that asks for `ask` rad/s all the time, and tracks nothing."""
    return asking(guidance.reference([0.1] * 6), ask)


def flown(
    guidance: Guidance, asks: list[float], times: Array
) -> tuple[list[Command], Array, Array]:
    """Commands, and the bank angles and rates at the calls; the rate is linear between them."""
    commands, banks, rates = [], [0.0], [0.0]
    references = {ask: eager(guidance, ask) for ask in set(asks)}
    for ask, step, time in zip(asks, np.diff(times, append=2 * times[-1]), times, strict=False):
        state = STATE.copy()
        state[6] = banks[-1]
        commands.append(command(guidance, references[ask], float(time), state, rates[-1]))
        banks.append(banks[-1] + 0.5 * (rates[-1] + commands[-1].bank_rate) * step)
        rates.append(commands[-1].bank_rate)
    return commands, np.array(banks[:-1]), np.array(rates)


def alternating(n: int, seed: int) -> list[float]:
    return np.random.default_rng(seed).choice([-9.0, 9.0], n, p=[0.3, 0.7]).tolist()


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(seed=st.integers(0, 2**32 - 1), hertz=st.sampled_from([2.0, 10.0, 50.0]))
def test_an_own_loop_of_any_rate_keeps_every_limit_from_the_first_command_on(
    synthetic: Guidance, seed: int, hertz: float
) -> None:
    guidance, n = Guidance(synthetic.table, LIMITS), 150
    times = np.arange(n + 1) / hertz
    held = [9.0] * (n // 2)
    commands, banks, rates = flown(guidance, held + alternating(n - n // 2, seed), times)
    assert np.abs(np.diff(rates)).max() <= LIMITS.acceleration / hertz * SLACK
    assert np.abs(rates).max() <= LIMITS.rate * SLACK
    assert np.abs(banks).max() <= LIMITS.angle * SLACK
    assert {c.health for c in commands} <= {Health.GOOD, Health.AFTER_FINAL_TIME}
    # it is no slower than it may be: the limits of the vehicle, not of a shorter cycle
    assert np.abs(np.diff(rates[1 : n // 2])).max() == pytest.approx(
        LIMITS.acceleration / hertz, rel=1e-6
    )


@laws
@given(seed=st.integers(0, 2**32 - 1), jitter=st.floats(0.01, 0.2))
def test_with_jitter_no_command_changes_by_more_than_the_time_since_the_last_allows(
    synthetic: Guidance, seed: int, jitter: float
) -> None:
    guidance, n = Guidance(synthetic.table, LIMITS), 300
    steps = 0.1 * (1.0 + jitter * np.random.default_rng(seed).uniform(-1.0, 1.0, n))
    commands, banks, rates = flown(guidance, [9.0] * n, np.concatenate([[0.0], np.cumsum(steps)]))
    since_last = steps[: n - 1]
    assert np.all(np.abs(np.diff(rates)[1:n]) <= LIMITS.acceleration * since_last * SLACK)
    assert abs(np.diff(rates)[0]) <= LIMITS.acceleration * 0.08
    # the longest cycle is learnt: what the bank angle overshoots is a tenth of a cycle's turn
    assert np.abs(banks).max() <= LIMITS.angle + 0.1 * LIMITS.rate * 0.1 * (1.0 + 10.0 * jitter)
    assert np.abs(banks).max() >= 59.0 * DEGREE
    assert {c.health for c in commands} <= {Health.GOOD, Health.AFTER_FINAL_TIME}


@laws
@given(silence=st.floats(0.15, 5.0), after=st.integers(3, 60), seed=st.integers(0, 2**32 - 1))
def test_after_a_silence_the_command_is_that_of_a_cycle_not_of_the_silence(
    synthetic: Guidance, silence: float, after: int, seed: int
) -> None:
    guidance, n = Guidance(synthetic.table, LIMITS), 100
    steps = np.full(n, 0.1)
    steps[after] = silence
    asks = alternating(n, seed)
    commands, banks, rates = flown(guidance, asks, np.concatenate([[0.0], np.cumsum(steps)]))
    assert np.abs(np.diff(rates)).max() <= LIMITS.acceleration * 0.1 * SLACK
    assert {c.health for c in commands} <= {Health.GOOD, Health.AFTER_FINAL_TIME}
    # nobody steers in a silence: beyond the limit by no more than it turned then
    assert np.abs(banks).max() <= LIMITS.angle + silence * LIMITS.rate


@pytest.mark.parametrize("cycle", [0.02, 0.1, 0.5, 2.0])
def test_a_stated_cycle_is_that_of_the_first_command(guidance: Guidance, cycle: float) -> None:
    stated = guidance.at_cycle(cycle)
    assert stated.cycle == cycle
    first = command(stated, eager(stated), 0.0, STATE, 0.0)
    assert first.bank_rate == pytest.approx(min(LIMITS.acceleration * cycle, LIMITS.rate))
    assert first.bank_angle == pytest.approx(0.5 * first.bank_rate * cycle)


def test_without_a_stated_cycle_the_first_command_changes_next_to_nothing(
    guidance: Guidance,
) -> None:
    assert guidance.cycle == NOMINAL_CYCLE == 0.5
    got = command(guidance, eager(guidance), 0.0, STATE, 0.03)
    assert got.bank_rate == pytest.approx(0.03, abs=1.01e-3 * LIMITS.acceleration)
    assert got.bank_angle == pytest.approx(0.015, abs=1e-4)
    assert got.health is Health.GOOD


def test_a_silence_right_after_the_first_command_is_none_of_a_stated_cycle(
    guidance: Guidance,
) -> None:
    stated = guidance.at_cycle(0.1)
    reference = eager(stated)
    rate = command(stated, reference, 0.0, STATE, 0.0).bank_rate
    change = command(stated, reference, 1.5, STATE, rate).bank_rate - rate
    assert change == pytest.approx(0.1 * LIMITS.acceleration)


def test_what_is_lost_at_the_first_command_is_the_references(guidance: Guidance) -> None:
    stated = guidance.at_cycle(0.5)
    reference = eager(stated, 0.02)
    reference.nodal[6] = 0.3
    for _ in range(2):  # the last command of another flight is none of this
        stated.reset()
        got = command(stated, reference, 1.0, np.full(7, np.nan), np.nan)
        assert got.bank_rate == pytest.approx(0.02, abs=1e-12)
        assert got.bank_angle == pytest.approx(0.3 + 0.01, abs=1e-12)
        command(stated, reference, 1.1, STATE, 0.05)


def test_a_loop_that_gets_slower_or_faster_is_followed(guidance: Guidance) -> None:
    times = np.concatenate(
        [np.arange(20) * 0.1, 2.0 + np.arange(40) * 0.4, 18.0 + np.arange(20) / 50]
    )
    _, banks, rates = flown(guidance, alternating(len(times) - 1, 3), times)
    steps = np.diff(times)
    changes = np.abs(np.diff(rates))
    assert np.all(changes[1:] <= LIMITS.acceleration * steps[:-1] * SLACK)
    assert changes[40:59].max() > 0.7 * LIMITS.acceleration * 0.4
    assert np.abs(banks).max() <= LIMITS.angle * SLACK


@pytest.mark.parametrize("lag", [0.2, 0.5, 1.0])
def test_behind_a_lag_the_acceleration_is_all_there(guidance: Guidance, lag: float) -> None:
    """Limited from the measured rate, half a second of lag at 10 Hz would leave a fifth of it."""
    flying, reference = guidance.at_cycle(0.1), eager(guidance)
    flying.follow(reference)
    bank, rate, commands, banks = 0.0, 0.0, [0.0], []
    for k in range(600):
        told = flying.step(0.1 * k, [*STATE[:6], bank, rate])
        commands.append(told.bank_rate)
        before, rate = rate, told.bank_rate + (rate - told.bank_rate) * np.exp(-0.1 / lag)
        bank += 0.05 * (before + rate)
        banks.append(bank)
    changes = np.diff(commands)
    assert changes.max() == pytest.approx(0.1 * LIMITS.acceleration, rel=1e-9)
    assert np.abs(changes).max() <= 0.1 * LIMITS.acceleration * SLACK
    assert LIMITS.angle <= max(banks) <= LIMITS.angle + lag * LIMITS.rate
    assert np.abs(np.array(banks[300:]) - LIMITS.angle).max() <= lag * LIMITS.rate


# --- clocks that fail -----------------------------------------------------------------------------


def ramp(guidance: Guidance) -> Reference:
    """A reference whose bank rate tells the time: t/10,000 rad/s."""
    reference = guidance.reference([0.1] * 6)
    return asking(reference, 1e-4 * reference.final_time * np.linspace(0.0, 1.0, 5))


def looked_up(guidance: Guidance, reference: Reference, time: float) -> tuple[float, Health]:
    """The time at which the reference was looked up, read from what is commanded."""
    got = command(guidance, reference, time, STATE, 1e-4 * 10.0)
    return 1e4 * got.bank_rate, got.health


@pytest.mark.parametrize(
    "wrong",
    [10.4, 10.4004, 10.0, -3.0, -np.inf, np.nan, np.inf, 25.0, 1e9, None, "noon", [1.0, 2.0]],
)
def test_a_time_that_does_not_go_on_is_told_and_counted_on(
    guidance: Guidance, wrong: float
) -> None:
    reference = ramp(guidance)
    for time in (10.0, 10.1, 10.2, 10.3, 10.4):
        read, health = looked_up(guidance, reference, time)
        assert health is Health.GOOD
        assert read == pytest.approx(time, abs=0.1 if time == 10.0 else 1e-9)
    read, health = looked_up(guidance, reference, wrong)
    assert health is Health.BAD_TIME
    assert read == pytest.approx(10.5, abs=1e-9)
    glitch = [] if wrong in (10.4, 10.4004) or not np.isfinite(_float(wrong)) else [10.6]
    for time in glitch:  # the clock has come back, which is no going on either
        read, health = looked_up(guidance, reference, time)
        if _float(wrong) > time or time - _float(wrong) > 10.0:
            assert health is Health.BAD_TIME
        assert read == pytest.approx(10.6, abs=1e-9)
    read, health = looked_up(guidance, reference, 10.7)
    assert (read, health) == (pytest.approx(10.7, abs=1e-9), Health.GOOD)


def _float(value: object) -> float:
    return float(value) if isinstance(value, float) else float("nan")


def test_a_clock_that_is_set_anew_is_believed_at_its_second_word(guidance: Guidance) -> None:
    reference = ramp(guidance)
    told = [looked_up(guidance, reference, t) for t in (50.0, 50.1, 50.2, 7.0, 7.1, 7.2)]
    assert [h for _, h in told] == [Health.GOOD] * 3 + [Health.BAD_TIME] + [Health.GOOD] * 2
    assert [t for t, _ in told[1:]] == pytest.approx([50.1, 50.2, 50.3, 7.1, 7.2], abs=0.5)


def test_a_dead_clock_is_counted_on_to_the_end(guidance: Guidance) -> None:
    reference = ramp(guidance)
    begin = reference.final_time - 3.0
    for time in (begin - 0.1, begin):
        looked_up(guidance, reference, time)
    read = []
    for _ in range(40):
        got = command(guidance, reference, np.nan, STATE, 1e-4 * begin)
        read.append((1e4 * got.bank_rate, got.health))
    assert [t for t, _ in read[:3]] == pytest.approx([begin + 0.1 * k for k in (1, 2, 3)], abs=1e-9)
    assert {h for _, h in read[:28]} == {Health.BAD_TIME}
    assert {h for _, h in read[31:]} == {Health.AFTER_FINAL_TIME}


def test_without_any_time_the_bank_angle_is_held(guidance: Guidance) -> None:
    for _ in range(3):
        got = command(guidance, eager(guidance), np.nan, STATE, 0.0)
        assert (got.bank_rate, got.health) == (0.0, Health.BAD_TIME)
    assert command(guidance, eager(guidance), 3.0, STATE, 0.0).health is Health.GOOD


# --- flights --------------------------------------------------------------------------------------


def test_a_new_reference_or_a_reset_begins_a_flight_at_any_time(guidance: Guidance) -> None:
    for again in (guidance.reset, lambda: guidance.reference([0.2] * 6)):
        reference = eager(guidance)
        for time in (40.0, 40.1):
            assert command(guidance, reference, time, STATE, 0.0).health is Health.GOOD
        again()
        got = command(guidance, reference, 0.0, STATE, 0.0)
        assert got.health is Health.GOOD
        assert abs(got.bank_rate) <= 1.01e-3 * LIMITS.acceleration
    assert command(guidance, reference, 0.0, STATE, 0.0).health is Health.BAD_TIME


def test_a_reference_made_anew_in_flight_keeps_the_cycle(guidance: Guidance) -> None:
    rates = [0.0]
    for k in range(10):
        reference = eager(guidance)  # at every cycle, as with a density that is estimated
        got = command(guidance, reference, 0.1 * k, STATE, rates[-1])
        assert got.health is Health.GOOD
        rates.append(got.bank_rate)
    assert np.diff(rates)[1:] == pytest.approx(np.full(9, 0.1 * LIMITS.acceleration), rel=1e-9)


def test_copies_fly_their_own_flight(guidance: Guidance) -> None:
    command(guidance, eager(guidance), 40.0, STATE, 0.0)
    copies = [pickle.loads(pickle.dumps(guidance)), guidance.in_mode("mpi"), guidance.at_cycle(0.1)]
    for other in copies:
        assert command(other, eager(other), 0.0, STATE, 0.0).health is Health.GOOD
    assert [c.cycle for c in copies] == [0.5, 0.5, 0.1]
    assert pickle.loads(pickle.dumps(copies[2])).cycle == 0.1
    assert copies[1].mode is Mode.MPI


@pytest.mark.parametrize("lost", [np.nan, np.inf, 3.0, None, [0.1, 0.2]])
def test_a_bank_rate_that_is_lost_is_that_of_the_last_command(
    guidance: Guidance, lost: float
) -> None:
    reference, rate = eager(guidance), 0.0
    for k in range(8):
        got = command(guidance, reference, 0.1 * k, STATE, rate if k < 4 else lost)
        assert abs(got.bank_rate - rate) <= LIMITS.acceleration * 0.1 * SLACK
        rate = got.bank_rate
    assert rate == pytest.approx(0.7 * LIMITS.acceleration, rel=1e-2)
    unknown = Health.IMPLAUSIBLE_NAVIGATION if lost == 3.0 else Health.BAD_NAVIGATION
    assert got.health is unknown


def test_a_bank_angle_that_is_lost_is_counted_on_to_the_limit(guidance: Guidance) -> None:
    reference, rate, bank = eager(guidance), 0.0, 0.0
    state = STATE.copy()
    for k in range(400):
        state[6] = bank if k < 5 else np.nan
        got = command(guidance, reference, 0.1 * k, state, rate)
        if k > 0:
            bank += 0.05 * (rate + got.bank_rate)
        rate = got.bank_rate
        assert bank <= LIMITS.angle * SLACK + 1e-4
    assert got.health is Health.BAD_NAVIGATION
    assert bank == pytest.approx(LIMITS.angle, abs=1e-3)


# --- at birth -------------------------------------------------------------------------------------


@pytest.mark.parametrize("cycle", [0.0, -0.5, np.nan, np.inf, 1e-4, "fast", [0.5, 0.5]])
def test_a_cycle_that_is_none_is_refused(guidance: Guidance, cycle: float) -> None:
    with pytest.raises(ValueError, match=r"cycle: expected at least 0\.001 s, got"):
        Guidance(guidance.table, LIMITS, cycle=cycle)
    with pytest.raises(ValueError, match="cycle: expected at least"):
        guidance.at_cycle(cycle)


@pytest.mark.parametrize("name", ["angle", "rate", "acceleration"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, np.array([1.0, -1.0])])
def test_limits_are_positive(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"bank limits: {name}: expected positive numbers"):
        replace(LIMITS, **{name: value})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mode": "quartic"}, f"mode: expected one of {MODES}, got 'quartic'"),
        ({"mode": None}, f"mode: expected one of {MODES}, got None"),
        ({"table": "a.h5"}, "table: expected a GuidanceTable, got str"),
        ({"limits": (1.0, 0.1, 0.1)}, "limits: expected the BankLimits of one vehicle, got"),
        (
            {"limits": BankLimits(np.array([1.0, 1.1]), 0.1, 0.1)},
            "limits: expected the BankLimits of one vehicle, got",
        ),
        ({"limit_axes": {"bank": 0}}, "limit_axes: expected angle, rate or acceleration .* 'bank'"),
        ({"limit_axes": {"angle": 6}}, "limit_axes: expected .* an axis, 0 to 5, got 'angle': 6"),
        ({"limit_axes": {"angle": 0}}, "limit_axes: angle: expected an axis of positive numbers"),
    ],
)
def test_what_a_guidance_is_made_of_is_checked(
    guidance: Guidance, change: dict[str, object], message: str
) -> None:
    arguments = {"table": guidance.table, "limits": LIMITS, **change}
    with pytest.raises(ValueError, match=message):
        Guidance(**arguments)  # type: ignore[arg-type]
