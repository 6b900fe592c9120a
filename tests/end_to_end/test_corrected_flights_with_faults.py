"""Corrected flights in the `everything` world, each with a fault of its own, flown to their ends.

All of a table fly in one batch, by `Guidance.step` as a user's loop would call it; what the logs name is
asked of the correctors' state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi import Mission, load_guidance, load_world
from ampi.correction.corrector import CorrectionOutcome
from ampi.correction.settings import CorrectorSettings
from ampi.guidance import Guidance
from ampi.onboard.health import Health, Steering
from ampi.onboard_model import correction_of
from ampi.physics.equations_of_motion import aerodynamic_acceleration
from ampi.physics.state import ALTITUDE, LATITUDE, LONGITUDE
from ampi.simulation.actuator import Actuator
from ampi.simulation.closed_loop import Entries
from ampi.simulation.plant import ANGLE, RATE, FlightStatus
from tests.support.databases import small_database
from tests.support.missions import small_mission

Array = NDArray[np.float64]
CYCLE = 0.5  # s
STUCK = (250.0, 260.0)  # s, of the bank actuator
EAST_NORTH = np.array([-0.8, -0.6])  # in which targets are moved: on along the track


@dataclass
class Fault:
    """What goes wrong in one flight; by time (s)."""

    told: Callable[[float, Array], Array] = lambda time, told: told
    sensed: Callable[[float, Array], Array] = lambda time, sensed: sensed
    aimed: dict[float, float] = field(default_factory=dict)  # m by which the target moves, by time
    is_stuck: bool = False  # its bank angle, for ten seconds
    air: float = 1.0  # factor on the density below 45 km


def lost_then_jumping(time: float, told: Array) -> Array:
    """Navigation is lost for 20 s and comes back 500 m off."""
    if 200.0 <= time < 220.0:
        return np.full_like(told, np.nan)
    off = np.zeros(len(told))
    off[ALTITUDE] = 500.0 if 220.0 <= time < 300.0 else 0.0
    return told + off


class Repeating:
    """Tells for ever what it has measured at its begin."""

    def __init__(self, begin: float) -> None:
        self._begin, self._held = begin, np.empty(0)

    def __call__(self, time: float, value: Array) -> Array:
        if time < self._begin:
            self._held = value.copy()
            return value
        return self._held


FAULTS = {
    "none": Fault(),
    "accelerometer tells no number": Fault(sensed=lambda t, a: a if t < 100.0 else a * np.nan),
    "accelerometer stuck": Fault(sensed=Repeating(100.0)),
    "accelerometer 5 % off": Fault(sensed=lambda t, a: 1.05 * a),
    "navigation lost, then jumping": Fault(told=lost_then_jumping),
    "target moved within reach": Fault(aimed={150.0: 50e3}),
    "target moved out of reach": Fault(aimed={550.0: 50e3}),
    "bank actuator stuck": Fault(is_stuck=True),
    "density jumps at 45 km": Fault(air=1.3),
}


@dataclass(frozen=True)
class Ends:
    """What came of the flights, by the names of their faults."""

    miss: dict[str, float]  # m, of the target as it was last
    status: dict[str, FlightStatus]
    healths: dict[str, set[Health]]
    steerings: dict[str, set[Steering]]
    outcomes: dict[str, dict[CorrectionOutcome, int]]
    learnt: dict[str, dict[str, int]]
    limits: dict[str, float]  # greatest use of any


def flown(mission: Mission, guidance: Guidance, faults: dict[str, Fault]) -> Ends:
    """All in one batch, to their ends."""
    own, n = list(faults.values()), len(faults)
    truth = load_world("everything").draw(mission, n, seed=5, pool="tuning")
    factors = np.array([fault.air for fault in own])[:, None]
    truth = replace(truth, density=truth.density * np.where(truth.altitudes < 45e3, factors, 1.0))
    entries = Entries.of(mission.family(truth.parameters), guidance, truth)
    flights, plant, step = entries.flights, entries.plant, 0
    actuator = Actuator(truth, CYCLE, entries.steering)
    healths: list[set[Health]] = [set() for _ in own]
    steerings: list[set[Steering]] = [set() for _ in own]
    at = mission.target
    targets = np.repeat([[at.altitude], [at.longitude], [at.latitude], [at.speed]], n, axis=1)
    radius = mission.flight_model.planet.equatorial_radius
    while flights.flying.any():
        time = step * CYCLE
        told = entries.sensors.navigation(flights.x, actuator.flown[RATE])
        model = plant.steered(actuator.flown[ANGLE])
        sensed = np.stack(aerodynamic_acceleration(model, flights.x, time))
        for i, fault in enumerate(own):
            told[:, i] = fault.told(time, told[:, i])
            sensed[:, i] = fault.sensed(time, sensed[:, i])
            if time in fault.aimed:
                east, north = fault.aimed[time] / radius * EAST_NORTH
                targets[1:3, i] += east / np.cos(at.latitude), north
                guidance.aim(targets)
        command = guidance.step(time, told, sensed)
        for i in np.flatnonzero(flights.flying):
            healths[i].add(Health(int(command.health[i])))
            steerings[i].add(Steering(int(command.steering[i])))
        actuator.command(np.array([command.bank_rate, command.angle_of_attack]))
        old, new = actuator.advance(0.0, 1.0)
        if STUCK[0] <= time < STUCK[1]:
            new[RATE, [fault.is_stuck for fault in own]] = 0.0
        flights.advance(plant, old, new, time, CYCLE)
        step += 1
    end, state = flights.final.T, guidance.correction_state
    east = np.cos(at.latitude) * (end[LONGITUDE] - targets[1])
    miss = radius * np.hypot(east, end[LATITUDE] - targets[2])
    peaks = flights.peak_at_the_end(plant)[:, :3].max(axis=1)
    named = partial(zip, faults, strict=True)
    return Ends(
        miss=dict(named(miss)),
        status={name: FlightStatus(int(s)) for name, s in named(flights.status)},
        healths=dict(named(healths)),
        steerings=dict(named(steerings)),
        outcomes={
            name: {CorrectionOutcome(k): int(c) for k, c in enumerate(counts) if c}
            for name, counts in named(state.counts.T)
        },
        learnt={
            name: {what: int(count[i]) for what, count in state.learnt.items()}
            for i, name in enumerate(faults)
        },
        limits=dict(named(peaks)),
    )


@pytest.fixture(scope="module")
def mission() -> Mission:
    return small_mission()


@pytest.fixture(scope="module")
def guidance(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Guidance:
    path = small_database(tmp_path_factory)
    return load_guidance(path, cycle=CYCLE, correction="bank_and_angle")


@pytest.fixture(scope="module")
def ends(mission: Mission, guidance: Guidance) -> Ends:
    return flown(mission, guidance, FAULTS)


def test_every_flight_reaches_the_speed_of_its_target_by_a_plan(ends: Ends) -> None:
    assert set(ends.status.values()) == {FlightStatus.REACHED_SPEED}
    assert all(
        Steering.PLANNED in seen and Steering.HELD not in seen for seen in ends.steerings.values()
    )


def test_what_can_be_reached_is_reached_and_the_limits_are_kept(ends: Ends) -> None:
    out_of_reach = ends.miss.pop("target moved out of reach")
    assert out_of_reach > 10e3
    blind = {"accelerometer tells no number", "accelerometer stuck", "accelerometer 5 % off"}
    for name, miss in ends.miss.items():
        assert miss < (1e3 if name in blind else 300.0), name
    kept = {name: use for name, use in ends.limits.items() if name != "density jumps at 45 km"}
    assert max(kept.values()) <= 1.02
    assert ends.limits["density jumps at 45 km"] < 1.15  # nobody can know of it before


def test_the_log_names_what_was_wrong(ends: Ends) -> None:
    outcomes, learnt = ends.outcomes, ends.learnt
    cycles = 900  # at the least, of those that are left of a flight from 100 s on
    assert learnt["accelerometer tells no number"]["unusable"] > cycles
    assert learnt["accelerometer stuck"]["stuck"] > cycles
    assert outcomes["navigation lost, then jumping"][CorrectionOutcome.NO_STATE] >= 1
    assert Health.BAD_NAVIGATION in ends.healths["navigation lost, then jumping"]
    assert outcomes["target moved out of reach"][CorrectionOutcome.OUT_OF_REACH] > 10
    assert CorrectionOutcome.OUT_OF_REACH not in outcomes["target moved within reach"]
    assert learnt["density jumps at 45 km"]["gated"] > learnt["none"]["gated"]


def test_a_budget_of_a_few_predictions_still_lands(mission: Mission, guidance: Guidance) -> None:
    """Every correction is stopped by its budget, with the best plan so far."""
    short = correction_of(mission, corrector=CorrectorSettings(propagations=20, iterations=1))
    ends = flown(mission, guidance.corrected(short), {"stopped by its budget": Fault()})
    outcomes = ends.outcomes["stopped by its budget"]
    assert outcomes[CorrectionOutcome.PLAN_BETTERED] > 10
    assert ends.miss["stopped by its budget"] < 500.0
