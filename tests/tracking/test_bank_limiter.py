"""The limiter: whatever is asked, the flown bank angle keeps its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.tracking.bank_limiter import BankLimits, bank_on_turn, limited_rate

Array = NDArray[np.float64]

laws = settings(deadline=None, max_examples=200)
DEGREE = math.pi / 180.0
SHEFEX = BankLimits(60.0 * DEGREE, 5.0 * DEGREE, 4.0 * DEGREE)

limits = st.builds(
    BankLimits,
    angle=st.floats(0.2, 3.1),
    rate=st.floats(0.01, 1.0),
    acceleration=st.floats(0.01, 1.0),
)
cycles = st.sampled_from([0.1, 0.5, 1.0, 2.0])
commands = st.lists(
    st.one_of(
        st.floats(-1.5, 1.5), st.sampled_from([1e300, -1e300, 1e9, -1e9, math.inf, -math.inf, 0.0])
    ),
    min_size=1,
    max_size=80,
)


def stopping_angle(limits: BankLimits, rate: float, cycle: float) -> float:
    """Angle flown while stopping from `rate`, the last cycle used whole: at least r²/2a."""
    change = limits.acceleration * cycle
    whole = math.floor(abs(rate) / change)
    rest = abs(rate) - whole * change
    return cycle * (0.5 * whole * whole * change + whole * rest + 0.5 * rest)


@st.composite
def stoppable_states(draw: st.DrawFn) -> tuple[BankLimits, float, float, float]:
    """Limits, cycle, and a bank angle and rate within the limits that can still be stopped."""
    lim, cycle = draw(limits), draw(cycles)
    rate = draw(st.floats(-1.0, 1.0)) * lim.rate
    while stopping_angle(lim, rate, cycle) > 2.0 * lim.angle:
        rate *= 0.5
    room = stopping_angle(lim, rate, cycle)
    low = -lim.angle + (room if rate < 0 else 0.0)
    high = lim.angle - (room if rate > 0 else 0.0)
    bank = low + draw(st.floats(0.0, 1.0)) * (high - low)
    return lim, cycle, bank, rate


def flown(
    lim: BankLimits, bank: float, rate: float, command: list[float], cycle: float
) -> tuple[list[float], list[float]]:
    """Bank angles and rates at the cycle ends; the rate is linear between, so the angle exact."""
    banks, rates = [bank], [rate]
    for asked in command:
        new = float(limited_rate(lim, banks[-1], rates[-1], asked, cycle))
        banks.append(banks[-1] + 0.5 * (rates[-1] + new) * cycle)
        rates.append(new)
    return banks, rates


# --- laws -----------------------------------------------------------------------------------------


@laws
@given(start=stoppable_states(), command=commands)
def test_no_sequence_of_commands_breaks_a_limit(
    start: tuple[BankLimits, float, float, float], command: list[float]
) -> None:
    lim, cycle, bank, rate = start
    banks, rates = flown(lim, bank, rate, command, cycle)
    slack = 1e-12 * (1.0 + lim.angle)
    assert np.abs(banks).max() <= lim.angle + slack
    assert np.abs(rates).max() <= lim.rate + slack
    assert np.abs(np.diff(rates)).max() <= lim.acceleration * cycle + slack


@laws
@given(start=stoppable_states(), period=st.integers(1, 9), size=st.sampled_from([0.3, 5.0, 1e12]))
def test_alternating_commands_break_no_limit(
    start: tuple[BankLimits, float, float, float], period: int, size: float
) -> None:
    lim, cycle, bank, rate = start
    command = [size * (-1.0) ** (k // period) for k in range(150)]
    banks, rates = flown(lim, bank, rate, command, cycle)
    slack = 1e-12 * (1.0 + lim.angle)
    assert np.abs(banks).max() <= lim.angle + slack
    assert np.abs(rates).max() <= lim.rate + slack
    assert np.abs(np.diff(rates)).max() <= lim.acceleration * cycle + slack


@laws
@given(lim=limits, cycle=cycles, share=st.floats(-1.0, 1.0), ask=st.floats(-1.0, 1.0))
def test_a_command_within_reach_is_reached(
    lim: BankLimits, cycle: float, share: float, ask: float
) -> None:
    """Far enough from the bank limit, a rate within the rate and acceleration limits is flown."""
    rate = share * lim.rate
    asked = rate + ask * lim.acceleration * cycle
    asked = min(max(asked, -lim.rate), lim.rate)
    far = BankLimits(
        100.0 * (lim.rate * cycle + lim.rate**2 / lim.acceleration), lim.rate, lim.acceleration
    )
    assert limited_rate(far, 0.0, rate, asked, cycle) == pytest.approx(asked, abs=1e-15)


@laws
@given(lim=limits, cycle=cycles, share=st.floats(-1.0, 1.0), ask=st.floats(-3.0, 3.0))
def test_a_held_command_is_reached_as_fast_as_the_acceleration_allows(
    lim: BankLimits, cycle: float, share: float, ask: float
) -> None:
    rate, asked = share * lim.rate, min(max(ask, -1.0), 1.0) * lim.rate
    change = lim.acceleration * cycle
    needed = math.ceil(abs(asked - rate) / change)
    far = BankLimits(
        10.0 * (needed + 4) * lim.rate * cycle + lim.rate**2 / lim.acceleration,
        lim.rate,
        lim.acceleration,
    )
    _, rates = flown(far, 0.0, rate, [ask * lim.rate] * (needed + 1), cycle)
    assert rates[needed] == pytest.approx(asked, abs=1e-12)
    if needed > 1:
        assert abs(rates[1] - rate) == pytest.approx(change, rel=1e-9)


@laws
@given(start=stoppable_states(), ask=st.floats(-2.0, 2.0))
def test_left_and_right_are_alike(
    start: tuple[BankLimits, float, float, float], ask: float
) -> None:
    lim, cycle, bank, rate = start
    right = limited_rate(lim, bank, rate, ask, cycle)
    assert limited_rate(lim, -bank, -rate, -ask, cycle) == -right


@laws
@given(lim=limits, cycle=cycles, seed=st.integers(0, 2**32 - 1))
def test_a_batch_is_its_flights(lim: BankLimits, cycle: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    bank, rate = rng.uniform(-1.2, 1.2, (2, 20)) * [[lim.angle], [lim.rate]]
    asked = rng.standard_normal(20) * 10.0 ** rng.integers(-2, 6, 20)
    batch = limited_rate(lim, bank, rate, asked, cycle)
    single = [limited_rate(lim, b, r, c, cycle) for b, r, c in zip(bank, rate, asked, strict=True)]
    assert np.array_equal(batch, np.array(single))


@laws
@given(lim=limits, cycle=cycles, beyond=st.floats(0.01, 1.0), ask=st.floats(-2.0, 2.0))
def test_from_beyond_the_limit_the_vehicle_comes_back(
    lim: BankLimits, cycle: float, beyond: float, ask: float
) -> None:
    """A bank angle that a gust has pushed out is brought back, whatever is asked, and stays."""
    start = lim.angle * (1.0 + beyond)
    fall = lim.rate * cycle
    n = 10 + 3 * math.ceil(
        (beyond * lim.angle) / min(fall, lim.acceleration * cycle**2) + lim.rate / lim.acceleration
    )
    banks, _ = flown(lim, start, 0.0, [abs(ask)] * min(n, 4000), cycle)
    assert banks[1] < start
    assert banks[-1] <= lim.angle * (1.0 + 1e-9)


@laws
@given(
    lim=limits,
    cycle=cycles,
    beyond=st.floats(0.0, 3.0),
    share=st.floats(-1.0, 1.0),
    ask=st.floats(-1e6, 1e6),
)
def test_on_the_way_back_the_rate_limit_holds_too(
    lim: BankLimits, cycle: float, beyond: float, share: float, ask: float
) -> None:
    for side in (-1.0, 1.0):
        rate = share * lim.rate
        new = float(limited_rate(lim, side * lim.angle * (1.0 + beyond), rate, ask, cycle))
        assert abs(new) <= lim.rate * (1.0 + 1e-12)
        assert abs(new - rate) <= lim.acceleration * cycle * (1.0 + 1e-9)


@laws
@given(
    start=stoppable_states(), command=commands, share=st.floats(0.3, 1.0), seed=st.integers(0, 99)
)
def test_between_a_shortest_and_a_longest_cycle_no_limit_is_broken(
    start: tuple[BankLimits, float, float, float],
    command: list[float],
    share: float,
    seed: int,
) -> None:
    """From rest: whatever each cycle lasts, the bank angle and, over the shortest, the rates keep."""
    lim, longest, bank, _ = start
    shortest, rate, rng = share * longest, 0.0, np.random.default_rng(seed)
    for asked in command:
        new = float(limited_rate(lim, bank, rate, asked, longest, shortest))
        assert abs(new - rate) <= lim.acceleration * shortest * (1.0 + 1e-9)
        assert abs(new) <= lim.rate * (1.0 + 1e-12)
        bank += 0.5 * (rate + new) * float(rng.uniform(shortest, longest))
        rate = new
        assert abs(bank) <= lim.angle * (1.0 + 1e-9)


# --- examples -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bank", "rate", "command", "expected"),
    [
        (0.0, 0.0, 1.0, 1.0),  # within reach
        (0.0, 0.0, 9.0, 2.0),  # acceleration: 4 °/s² over 0.5 s
        (0.0, 4.5, 9.0, 5.0),  # rate
        (0.0, 5.0, -5.0, 3.0),
        (59.75, 1.0, 5.0, 0.0),  # one cycle left to stop in
        (-59.75, -1.0, -5.0, 0.0),
        (60.0, 0.0, 5.0, 0.0),  # at the limit
        (60.0, 0.0, -1.0, -1.0),
        (60.5, 0.0, 5.0, -2.0),  # beyond it: 0.5° back in one cycle
        (60.1, 0.0, 5.0, -0.4),  # beyond it by less: back in one cycle, no more
        (56.0, 4.0, 5.0, 4.0),  # 1° to reach 4 °/s, then 3° to stop in: braking by 2 °/s each cycle
        (56.5, 4.0, 5.0, 3.5),
        (57.0, 4.0, 5.0, 3.0),
    ],
)
def test_shefex_3_limits(bank: float, rate: float, command: float, expected: float) -> None:
    got = limited_rate(SHEFEX, bank * DEGREE, rate * DEGREE, command * DEGREE, 0.5)
    assert got / DEGREE == pytest.approx(expected, abs=1e-12)


def test_a_bank_reversal_takes_the_time_that_the_limits_dictate() -> None:
    """−40° to near +60° under a held command: 0.5 s cycles, 5 °/s, so about 20 s."""
    banks, rates = flown(SHEFEX, -40.0 * DEGREE, 0.0, [math.inf] * 60, 0.5)
    assert max(rates) == pytest.approx(5.0 * DEGREE, rel=1e-12)
    reached = next(k for k, b in enumerate(banks) if b > 59.0 * DEGREE)
    assert 20.0 <= 0.5 * reached <= 23.0


@laws
@given(start=stoppable_states(), command=commands)
def test_the_bank_angle_keeps_its_limit_between_the_cycles_too(
    start: tuple[BankLimits, float, float, float], command: list[float]
) -> None:
    lim, cycle, bank, rate = start
    banks, rates = flown(lim, bank, rate, command, cycle)
    for b, r, new in zip(banks, rates, rates[1:], strict=False):
        if r * new < 0.0:  # the parabola turns inside the cycle
            turn = r / (r - new) * cycle
            assert abs(b + 0.5 * r * turn) <= lim.angle * (1.0 + 1e-12)


def test_at_the_bank_limit_a_held_command_settles() -> None:
    _, rates = flown(SHEFEX, 0.0, 0.0, [5.0 * DEGREE] * 60, 0.5)
    assert np.abs(rates[40:]).max() < 1e-9


@pytest.mark.parametrize("what", range(3))
def test_what_is_no_number_stays_none(what: int) -> None:
    told = [0.1, 0.01, 0.02]
    told[what] = math.nan
    assert math.isnan(limited_rate(SHEFEX, *told, 0.5))
    assert math.isnan(bank_on_turn(SHEFEX, math.nan, 0.3))
