"""The model that flies in wind and at another angle of attack, against the physics: every mission."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import ampi
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.flight_model import BANK, SPEED, Factors
from ampi.onboard_model import flight_model_of
from ampi.physics.equations_of_motion import (
    FlightModel,
    aerodynamic_acceleration,
    equations_of_motion,
)

Array = NDArray[np.float64]

MISSIONS = sorted(p.stem for p in (Path(ampi.__file__).parent / "missions").glob("*.toml"))
# on board the angle of attack is scheduled
SHIPPED = [name for name in MISSIONS if load_mission(name).angle_of_attack is None]
AGREED = 1e-10
N = 2000


@dataclass(frozen=True, eq=False)
class ConstantWind:
    east: Array
    north: Array

    def components(self, altitude: Array) -> tuple[Array, Array]:
        return self.east, self.north


def flights() -> tuple[Array, Array, Array]:
    """States (7, n), bank rates and times, far beyond all that is flown."""
    rng = np.random.default_rng(18)
    low = (-500.0, -3.0, -1.4, 300.0, -1.2, -3.1, -2.9)
    high = (130e3, 3.0, 1.4, 8000.0, 0.6, 3.1, 2.9)
    state = np.ascontiguousarray(rng.uniform(low, high, (N, 7)).T)
    return state, rng.uniform(-0.1, 0.1, N), rng.uniform(0.0, 900.0, N)


def differing(mission: Mission) -> tuple[FlightModel, Factors]:
    """The physics of n flights in winds and at angles of their own, and the same as factors."""
    rng = np.random.default_rng(19)
    east, north = rng.uniform(-150.0, 150.0, (2, N))
    angle, lift, drag = rng.uniform(-0.05, 0.05, N), *rng.uniform(0.8, 1.2, (2, N))
    model = mission.flight_model
    vehicle = replace(
        model.vehicle,
        lift_factor=model.vehicle.lift_factor * lift,
        drag_factor=model.vehicle.drag_factor * drag,
    )
    physics = replace(
        model, vehicle=vehicle, wind=ConstantWind(east, north), angle_of_attack_offset=angle
    )
    winds = {"wind_east": east, "wind_north": north}
    return physics, Factors(lift=lift, drag=drag, angle_of_attack=angle, **winds)


@pytest.mark.parametrize("name", SHIPPED)
def test_rates_and_what_is_sensed_are_those_of_the_physics(name: str) -> None:
    mission, (state, bank_rate, time) = load_mission(name), flights()
    (physics, factors), model = differing(mission), flight_model_of(mission)
    for expected, found in (
        (
            equations_of_motion(physics, state, bank_rate, time),
            model.rates(state, bank_rate, time, factors),
        ),
        (aerodynamic_acceleration(physics, state, time), model.sensed(state, time, factors)),
    ):
        wanted = np.stack(np.broadcast_arrays(*expected))
        # of the components' sizes: a component is a sum that may pass through zero
        size = np.abs(wanted).mean(axis=1, keepdims=True)
        assert np.max(np.abs(np.stack(found) - wanted) / (np.abs(wanted) + size)) < AGREED


@pytest.mark.parametrize("name", SHIPPED)
def test_loads_and_uses_of_limits_are_those_of_the_physics(name: str) -> None:
    mission, (state, bank_rate, time) = load_mission(name), flights()
    (physics, factors), model = differing(mission), flight_model_of(mission)
    air, own = physics.air_loads(state, time), model.air_loads(state, time, factors)
    for expected, found in zip(air, own, strict=True):
        np.testing.assert_allclose(found, np.broadcast_to(expected, N), rtol=AGREED)
    use = PathLimits.of(mission).use(physics, state, bank_rate, time)
    np.testing.assert_allclose(
        model.limit_use(state, bank_rate, time, factors),
        np.stack(np.broadcast_arrays(*use)),
        rtol=AGREED,
        atol=AGREED,
    )


def test_in_still_air_drag_is_sensed_along_and_lift_across() -> None:
    model, (state, bank_rate, time) = flight_model_of(load_mission("shefex3")), flights()
    still, zero = Factors(density=1.1), np.zeros(N)
    along, up, right = model.sensed(state, time, still)
    air = model.air_loads(state, time, still)
    np.testing.assert_array_equal(along, -air.drag)
    np.testing.assert_allclose(np.hypot(up, right), np.abs(air.lift), rtol=1e-14)
    np.testing.assert_allclose(up, air.lift * np.cos(state[BANK]), rtol=1e-14)
    # arrays of zeros take the way of a wind, to the same flight
    blowing = still._replace(wind_east=zero, wind_north=zero)
    for one, other in (
        ((along, up, right), model.sensed(state, time, blowing)),
        (model.rates(state, bank_rate, time, still), model.rates(state, bank_rate, time, blowing)),
    ):
        np.testing.assert_allclose(np.stack(other), np.stack(one), rtol=1e-11, atol=1e-9)


def test_no_flight_depends_on_the_wind_of_another() -> None:
    model, (state, bank_rate, time) = flight_model_of(load_mission("shefex3")), flights()
    east = np.where(np.arange(N) < 3, 0.0, 50.0)
    together = model.rates(state, bank_rate, time, Factors(wind_east=east))
    alone = model.rates(state[:, :3], bank_rate[:3], time[:3], Factors(wind_east=east[:3]))
    np.testing.assert_array_equal(together[:, :3], alone)


def test_head_wind_adds_to_the_speed_through_the_air() -> None:
    """A level flight due north against 100 m/s: the loads of one 100 m/s faster."""
    model = flight_model_of(load_mission("shefex3"))
    slow = np.array([50e3, 0.0, 1.2, 3000.0, 0.0, 0.0, 0.3])
    fast = slow.copy()
    fast[SPEED] += 100.0
    windy = model.air_loads(slow, 200.0, Factors(wind_north=-100.0))
    np.testing.assert_allclose(windy, model.air_loads(fast, 200.0), rtol=1e-14)
    np.testing.assert_allclose(
        model.sensed(slow, 200.0, Factors(wind_north=-100.0)), model.sensed(fast, 200.0), rtol=1e-12
    )


def test_the_angle_of_attack_is_added_to_the_schedule_s() -> None:
    model = flight_model_of(load_mission("shefex3"))
    state = flights()[0][:, :4]
    found = model.air_loads(state, 200.0, Factors(angle_of_attack=0.05)).angle_of_attack
    np.testing.assert_allclose(found, model.air_loads(state, 200.0).angle_of_attack + 0.05)
