"""The engine's integrator against DOP853, and what becomes of a batch that is interrupted."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.simulation import native_loop
from ampi.simulation.closed_loop import FlightBatch
from ampi.simulation.sensors import SensorNoise
from ampi.simulation.world_loading import load_world

Array = NDArray[np.float64]
KINKS = (58.0, 88.0)  # s, of SHEFEX-3's angle-of-attack schedule
METRES = np.array([1.0, 6.4e6, 6.4e6])
FLIGHTS, SECONDS = 20, 100.0


@pytest.fixture(scope="module")
def batch(mission: Mission, guidance: Guidance) -> FlightBatch:
    """A hundred seconds of flights, each cycle recorded."""
    target = mission.target.model_copy(update={"speed": 3400.0, "altitude": 40e3})
    short = mission.model_copy(update={"target": target})
    truth = load_world("entry").draw(short, FLIGHTS, 4)
    return native_loop.fly_batch(short.family(truth.parameters), guidance, truth, guidance.cycle)


@pytest.mark.slow
def test_it_agrees_with_dop853_under_the_flown_bank_rate(
    mission: Mission, batch: FlightBatch
) -> None:
    """The rate is linear over a cycle, so the bank angle a known parabola; six states are left."""
    errors = []
    for states, rates in zip(batch.states, batch.bank_rate, strict=True):
        n = min(int(np.isfinite(rates).sum()), int(SECONDS / batch.times[1]))
        times, cycle = batch.times[:n], batch.times[1]

        def bank_angle(t: float, rates: Array, banks: Array, n: int = n, c: float = cycle) -> float:
            k = min(int(t / c), n - 2)
            s = t - k * c
            return float(banks[k] + rates[k] * s + (rates[k + 1] - rates[k]) * s * s / (2.0 * c))

        def f(t: float, x: Array, rates: Array = rates, banks: Array = states[6]) -> Array:
            seven = [*x, bank_angle(t, rates, banks)]
            return np.array(equations_of_motion(mission.flight_model, seven, 0.0, t)[:6])

        x = states[:6, 0]
        for begin, end in pairwise([0.0, *(k for k in KINKS if k < times[-1]), float(times[-1])]):
            x = solve_ivp(f, (begin, end), x, "DOP853", rtol=1e-10, atol=1e-9, max_step=2.0).y[
                :, -1
            ]
        errors.append(np.abs(x[:3] - states[:3, n - 1]) * METRES)
    assert np.max(errors) < 0.01


def test_a_batch_can_be_interrupted_between_two_blocks(
    short: Mission, guidance: Guidance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python runs every few milliseconds of flying, and with it what a signal asks for."""
    truth = load_world("everything").draw(short, 2, 4)
    drawn = []

    def rest(self: SensorNoise) -> tuple[Array, Array]:
        drawn.append(1)
        raise KeyboardInterrupt

    monkeypatch.setattr(SensorNoise, "rest", rest)
    with pytest.raises(KeyboardInterrupt):
        native_loop.fly_batch(short.family(truth.parameters), guidance, truth)
    assert drawn == [1]
