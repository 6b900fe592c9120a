"""A recorded flight by scipy's integrators: how exact is the plant, and what would they cost."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.planet import great_circle_distance
from ampi.simulation.closed_loop import FlightBatch, plant_of
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]

TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-9}
CALLS = 50


def _rates(family: MissionFamily, guidance: Guidance, truth: Truth, flight: int) -> tuple[Any, Any]:
    """Rates of one flight, and its plant."""
    guidance.begin(truth.parameters)
    plant = plant_of(family, guidance, truth).take([flight])

    def rates(t: float, x: Array, steering: Array, slope: Array, begin: float) -> Array:
        now = steering + slope * (t - begin)
        model = plant.steered(now[1])
        return np.array(
            [float(np.squeeze(r)) for r in equations_of_motion(model, x[:, None], now[0], t)]
        )

    return rates, plant


def flown_by_dop853(
    family: MissionFamily, guidance: Guidance, truth: Truth, batch: FlightBatch, flight: int
) -> float:
    """Distance (m) of the recorded end from that of DOP853 under the steering as it was flown."""
    rates, _ = _rates(family, guidance, truth, flight)
    steering = np.stack([batch.bank_rate[flight], batch.angle_of_attack[flight]])
    x, times, end = batch.states[flight, :, 0].copy(), batch.times, batch.final_time[flight]
    cycle = guidance.cycle
    for k in np.flatnonzero(times < end).tolist():
        is_last = k + 1 == len(times) or not np.all(np.isfinite(steering[:, k + 1]))
        # in the cycle in which it ends the steering is held as it was: a hundredth of a degree of bank
        slope = np.zeros(2) if is_last else (steering[:, k + 1] - steering[:, k]) / cycle
        until = end if is_last else times[k + 1]
        done = solve_ivp(
            rates, (times[k], until), x, args=(steering[:, k], slope, times[k]), **TIGHT
        )
        x = done.y[:, -1]
    radius = family.flight_model().planet.equatorial_radius
    there = batch.final_states[flight]
    return float(
        np.hypot(great_circle_distance(x[1], x[2], there[1], there[2], radius), x[0] - there[0])
    )


def seconds_of_one_call(
    family: MissionFamily, guidance: Guidance, truth: Truth, batch: FlightBatch
) -> float:
    """CPU time (s) of solve_ivp over one guidance cycle, at its defaults, median of some."""
    rates, _ = _rates(family, guidance, truth, 0)
    samples, steering = [], np.zeros(2)
    for k in range(0, min(len(batch.times) - 2, 100 * CALLS), 100):
        begin, end, x = batch.times[k], batch.times[k + 1], batch.states[0, :, k]
        if not np.all(np.isfinite(x)):
            break
        began = time.process_time()
        solve_ivp(rates, (begin, end), x, args=(steering, steering, begin))
        samples.append(time.process_time() - began)
    return float(np.median(samples))
