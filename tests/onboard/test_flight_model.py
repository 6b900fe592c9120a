"""The model that flies against the physics it stands for: every shipped mission, every form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import ampi
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.flight_model import AltitudeCurve, Factors, Schedule
from ampi.onboard_model import flight_model_of
from ampi.physics.equations_of_motion import equations_of_motion

Array = NDArray[np.float64]

MISSIONS = sorted(p.stem for p in (Path(ampi.__file__).parent / "missions").glob("*.toml"))
# on board the angle of attack is scheduled
SHIPPED = [name for name in MISSIONS if load_mission(name).angle_of_attack is None]
AGREED = 1e-10


def flights(n: int) -> tuple[Array, Array, Array]:
    """States (7, n), bank rates and times: far beyond all that is flown, below the ground too."""
    rng = np.random.default_rng(17)
    low = (-500.0, -3.0, -1.4, 300.0, -1.2, -3.1, -2.9)
    high = (130e3, 3.0, 1.4, 8000.0, 0.6, 3.1, 2.9)
    state = rng.uniform(low, high, (n, 7)).T
    return np.ascontiguousarray(state), rng.uniform(-0.1, 0.1, n), rng.uniform(0.0, 900.0, n)


def physics(mission: Mission, state: Array, bank_rate: Array, time: Array) -> Array:
    return np.stack(
        np.broadcast_arrays(*equations_of_motion(mission.flight_model, state, bank_rate, time))
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_rates_are_those_of_the_physics(name: str) -> None:
    mission, flight = load_mission(name), flights(3000)
    expected = physics(mission, *flight)
    found = flight_model_of(mission).rates(*flight)
    # of the rates' sizes: a rate is a sum that may pass through zero
    size = np.abs(expected).mean(axis=1, keepdims=True)
    assert np.max(np.abs(found - expected) / (np.abs(expected) + size)) < AGREED


@pytest.mark.parametrize("name", SHIPPED)
def test_air_loads_and_uses_of_limits_are_those_of_the_physics(name: str) -> None:
    mission, (state, bank_rate, time) = load_mission(name), flights(3000)
    model, limits = flight_model_of(mission), PathLimits.of(mission)
    air, own = mission.flight_model.air_loads(state, time), model.air_loads(state, time)
    for expected, found in ((air.lift, own.lift), (air.drag, own.drag)):
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=AGREED)
    use = limits.use(mission.flight_model, state, bank_rate, time)
    assert model.limits.names == limits.names
    np.testing.assert_allclose(
        model.limit_use(state, bank_rate, time),
        np.stack(np.broadcast_arrays(*use)),
        rtol=AGREED,
        atol=AGREED,
    )


def test_factors_are_those_of_a_mission_with_other_numbers() -> None:
    mission, flight = load_mission("shefex3"), flights(200)
    factors = Factors(density=0.8, lift=1.1, drag=0.9, mass=1.05)
    air = mission.atmosphere.model_copy(update={"density_factor": 0.8})
    vehicle = mission.vehicle.model_copy(
        update={"lift_factor": 1.1, "drag_factor": 0.9, "mass": 1.05 * mission.vehicle.mass}
    )
    other = mission.model_copy(update={"atmosphere": air, "vehicle": vehicle})
    expected = flight_model_of(other).rates(*flight)
    found = flight_model_of(mission).rates(*flight, factors)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-14)
    assert np.any(np.abs(found - flight_model_of(mission).rates(*flight)) > 1e-6)


def test_flights_at_instants_are_flights_one_by_one() -> None:
    model, (state, bank_rate, time) = flight_model_of(load_mission("cavh_liu2015")), flights(24)
    shape = (4, 6)
    together = model.rates(
        state.reshape(7, *shape),
        bank_rate.reshape(shape),
        time.reshape(shape),
        Factors(density=np.linspace(0.9, 1.1, 4)[:, None]),
    )
    for i, density in enumerate(np.linspace(0.9, 1.1, 4)):
        part = slice(6 * i, 6 * i + 6)
        alone = model.rates(state[:, part], bank_rate[part], time[part], Factors(density=density))
        np.testing.assert_array_equal(together[:, i], alone)


def test_what_is_no_number_comes_out_as_none_and_touches_no_other_flight() -> None:
    model, (state, bank_rate, time) = flight_model_of(load_mission("cavh_wang2020")), flights(3)
    expected = model.rates(state, bank_rate, time)
    state[0, 1] = np.nan
    with np.errstate(all="ignore"):
        found = model.rates(state, bank_rate, time)
    assert np.all(np.isnan(found[[3, 4, 5], 1]))
    np.testing.assert_array_equal(found[:, [0, 2]], expected[:, [0, 2]])


def test_a_straight_curve_is_straight_within_its_top_and_beyond() -> None:
    curve = AltitudeCurve(10.0, np.array([[3.0 + 0.5 * 2.0 * 10.0, 10.0]]), (2.0, 2.0))
    altitude = np.array([-5.0, 0.0, 2.5, 10.0, 40.0])
    np.testing.assert_allclose(curve(altitude), 3.0 + 2.0 * altitude, rtol=1e-14)


def test_a_schedule_over_time_has_its_kinks_and_its_middle() -> None:
    schedule = Schedule(
        over_time=True,
        start=58.0,
        end=88.0,
        start_angle=0.7,
        end_angle=0.3,
        is_parabola=False,
        smoothing=0.0,
    )
    found = schedule(np.array([0.0, 58.0, 73.0, 88.0, 900.0]), 0.0)
    np.testing.assert_allclose(found, [0.7, 0.7, 0.5, 0.3, 0.3], rtol=1e-14)


def test_what_has_no_form_on_board_is_refused_on_the_ground() -> None:
    class StillAir:
        def components(self, altitude: Array) -> tuple[float, float]:
            return 0.0, 0.0

    class Vacuum:
        def density(self, altitude: Array) -> float:
            return 0.0

        def speed_of_sound(self, altitude: Array) -> float:
            return 300.0

    for change, told in (({"wind": StillAir()}, "still air"), ({"atmosphere": Vacuum()}, "Vacuum")):
        mission = load_mission("shefex3").model_copy()
        mission.__dict__["flight_model"] = replace(mission.flight_model, **change)
        with pytest.raises(ValueError, match=told):
            flight_model_of(mission)
