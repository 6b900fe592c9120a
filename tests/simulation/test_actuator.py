"""What becomes of a command: delay and lag against scipy, and what neither of them may do."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from ampi.simulation.actuator import Actuator
from tests.support.truths import nominal_truth

Array = NDArray[np.float64]

CYCLE, RATE, ACCELERATION = 0.5, 0.09, 0.07  # s, rad/s, rad/s²
laws = settings(deadline=None, max_examples=40)
seeds = st.integers(0, 2**32 - 1)


def actuator(n: int, first: Array, lag: ArrayLike = 0.0, delay: ArrayLike = 0.0) -> Actuator:
    truth = nominal_truth(np.zeros((n, 0)), actuator_lag=lag, actuator_delay=delay)
    return Actuator(truth, CYCLE, first)


def commands(n: int, seed: int, cycles: int = 40) -> Array:
    """(cycles + 1, 2, n), within rate and acceleration limit; the first is that of long ago."""
    changes = np.random.default_rng(seed).uniform(-1.0, 1.0, (cycles, 2, n))
    asked = [np.zeros((2, n))]
    for change in changes * ACCELERATION * CYCLE:
        asked.append(np.clip(asked[-1] + change, -RATE, RATE))
    return np.array(asked)


def flown(unit: Actuator, asked: Array, parts: int) -> Array:
    """At the ends of the parts: (cycles · parts + 1, 2, n)."""
    ends = [unit.flown]
    for command in asked[1:]:
        unit.command(command)
        for part in range(parts):
            old, new = unit.advance(part / parts, (part + 1) / parts)
            assert np.array_equal(old, ends[-1])
            ends.append(new)
    return np.array(ends)


def witness(asked: Sequence[float], lag: float, delay: float, times: Array) -> Array:
    """τ ṙ = c(t − d) − r by an adaptive method from kink to kink; c is reached at its cycle's end."""
    knots = CYCLE * np.arange(len(asked))

    def rate(t: float, r: Array) -> Array:
        return (np.interp(t - delay, knots, asked) - r) / lag

    kinks = np.unique(np.concatenate([knots + delay, times]))
    kinks = kinks[kinks <= times[-1]]
    found, r = {0.0: asked[0]}, np.array([asked[0]])
    for begin, end in pairwise(kinks.tolist()):
        r = solve_ivp(rate, (begin, end), r, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        found[end] = float(r[0])
    return np.array([found[t] for t in times])


@pytest.mark.parametrize("lag", [0.05, 0.5, 3.0])
@pytest.mark.parametrize(("delay", "parts"), [(0.0, 1), (0.0, 5), (0.25, 2), (0.5, 1), (1.3, 5)])
def test_it_is_the_first_order_lag_of_the_delayed_command(
    lag: float, delay: float, parts: int
) -> None:
    """Exact to rounding where the delay is of whole parts: a step sees no kink."""
    asked = commands(1, seed=3, cycles=20)
    got = flown(actuator(1, asked[0], lag, delay), asked, parts)
    times = CYCLE / parts * np.arange(len(got))
    for row in (0, 1):
        expected = witness(asked[:, row, 0], lag, delay, times)
        assert got[:, row, 0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("delay", [0.1, 0.37, 0.8])
def test_a_kink_within_a_step_costs_little(delay: float) -> None:
    """Of a command that turns by its limit within the step: less than a tenth of that."""
    asked = commands(1, seed=4, cycles=20)
    got = flown(actuator(1, asked[0], 0.5, delay), asked, 1)
    expected = witness(asked[:, 0, 0], 0.5, delay, CYCLE * np.arange(len(got)))
    assert np.abs(got[:, 0, 0] - expected).max() < 0.1 * ACCELERATION * CYCLE


@pytest.mark.parametrize("parts", [1, 3])
def test_without_lag_and_delay_the_command_is_reached_to_the_bit(parts: int) -> None:
    asked = commands(4, seed=1)
    got = flown(actuator(4, asked[0]), asked, parts)
    assert np.array_equal(got[::parts], asked)
    within = got[1::parts][: len(asked) - 1]
    expected = asked[:-1] + (asked[1:] - asked[:-1]) / parts
    assert within == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("delay", [0.5, 1.5])
def test_a_delay_of_whole_cycles_alone_gives_the_earlier_commands(delay: float) -> None:
    asked, back = commands(3, seed=2), round(delay / CYCLE)
    got = flown(actuator(3, asked[0], delay=delay), asked, 1)
    assert np.array_equal(got[back:], asked[: len(asked) - back])
    assert np.all(got[: back + 1] == asked[0])


@laws
@given(
    lag=st.just(0.0) | st.floats(1e-6, 3.0),
    delay=st.floats(0.0, 2.0),
    parts=st.integers(1, 4),
    seed=seeds,
)
def test_limits_of_rate_and_acceleration_are_kept(
    lag: float, delay: float, parts: int, seed: int
) -> None:
    asked = commands(2, seed)
    got = flown(actuator(2, asked[0], lag, delay), asked, parts)
    assert np.abs(got).max() <= RATE * (1.0 + 1e-12)
    changes = np.abs(np.diff(got, axis=0)).max()
    assert changes <= ACCELERATION * CYCLE / parts * (1.0 + 1e-9)


@laws
@given(seed=seeds, parts=st.integers(1, 4))
def test_each_flight_has_its_own_to_the_bit(seed: int, parts: int) -> None:
    """Some of them without any lag or delay."""
    rng = np.random.default_rng(seed)
    lag, delay = rng.choice([0.0, 0.3, 1.0], 5), rng.choice([0.0, 0.2, 0.7], 5)
    asked = commands(5, seed)
    together = flown(actuator(5, asked[0], lag, delay), asked, parts)
    for i in range(5):
        one = slice(i, i + 1)
        alone = flown(actuator(1, asked[0, :, one], lag[one], delay[one]), asked[..., one], parts)
        assert np.array_equal(alone[..., 0], together[..., i])


def test_a_command_that_stands_is_reached_and_a_ramp_is_followed_a_lag_and_a_delay_behind() -> None:
    unit, ramp = actuator(1, np.zeros((2, 1)), lag=0.4, delay=0.7), 0.01
    asked = np.repeat((ramp * CYCLE * np.arange(41.0))[:, None, None], 2, axis=1)
    got = flown(unit, asked, 1)
    assert asked[-1, 0, 0] - got[-1, 0, 0] == pytest.approx(ramp * (0.4 + 0.7), rel=1e-6)
    stands = flown(unit, np.repeat(asked[-1:], 41, axis=0), 1)
    assert stands[-1] == pytest.approx(asked[-1], rel=1e-9)
