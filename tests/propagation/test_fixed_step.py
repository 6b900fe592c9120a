"""The classical method of order four: its order, and flights that do not know of each other."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.propagation.fixed_step import rk4_step

Array = NDArray[np.float64]


def forced(state: Array, control: Any, time: Any) -> Array:
    return np.asarray(-state + control * np.cos(time))


def flown(steps: int) -> float:
    """x(2) of x' = −x + cos t · (1 + t), x(0) = 1; the control is linear over each step."""
    times = np.linspace(0.0, 2.0, steps + 1)
    state = np.ones(1)
    for begin, end in pairwise(times):
        state = rk4_step(forced, state, 1.0 + begin, 1.0 + end, begin, end - begin)
    return float(state[0])


def test_the_error_falls_by_sixteen_where_the_step_is_halved() -> None:
    truth = flown(4000)
    errors = [abs(flown(steps) - truth) for steps in (10, 20, 40)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.15)


def test_a_cubic_is_integrated_exactly() -> None:
    """A control linear over the step times the time, twice: x' = t³."""
    after = rk4_step(lambda x, u, t: u * t * t, np.zeros(1), 1.0, 3.0, 1.0, 2.0)
    assert after[0] == pytest.approx((3.0**4 - 1.0) / 4.0, rel=1e-14)


def test_each_flight_of_a_batch_is_the_flight_alone() -> None:
    rng = np.random.default_rng(3)
    states, controls, times = rng.standard_normal((3, 5, 1)), rng.standard_normal((2, 5, 1)), [0.3]
    steps = rng.uniform(0.1, 1.0, (5, 1))
    together = rk4_step(forced, states[0], controls[0], controls[1], times[0], steps)
    for i in range(5):
        alone = rk4_step(forced, states[0, i], controls[0, i], controls[1, i], times[0], steps[i])
        assert np.array_equal(together[i], alone)
