"""Angle-of-attack schedules, air loads and refusals."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.physics.aerodynamics import ModifiedNewtonian
from ampi.physics.atmosphere import ExponentialAtmosphere
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.vehicle import AngleOfAttackSchedule, Vehicle, air_loads

laws = settings(deadline=None, max_examples=100)
OVER_TIME = AngleOfAttackSchedule(
    variable="time", start=58.0, end=88.0, start_angle=np.radians(42), end_angle=np.radians(17.5)
)
OVER_SPEED = AngleOfAttackSchedule(
    variable="speed", start=1500.0, end=2700.0, start_angle=np.radians(13), end_angle=0.1
)


@laws
@given(time=st.floats(0.0, 2000.0), speed=st.floats(10.0, 8000.0))
def test_schedule_is_a_clipped_line_in_its_own_variable(time: float, speed: float) -> None:
    for schedule, at in ((OVER_TIME, time), (OVER_SPEED, speed)):
        ends = [schedule.start, schedule.end], [schedule.start_angle, schedule.end_angle]
        assert schedule(time, speed) == pytest.approx(np.interp(at, *ends), abs=1e-14)


def test_schedule_of_shefex3() -> None:
    # Table 2: 42° until 58 s, 17.5° from 88 s, half way at 73 s.
    angles = np.degrees(OVER_TIME(np.array([0.0, 58.0, 73.0, 88.0, 600.0]), None))
    assert angles == pytest.approx([42.0, 42.0, 29.75, 17.5, 17.5])


@laws
@given(speed=st.floats(10.0, 8000.0), smoothing=st.floats(1.0, 800.0))
def test_a_smoothed_schedule_is_the_line_between_two_hyperbolas(
    speed: float, smoothing: float
) -> None:
    # at a distance d from a kink a branch of √(d² + s²): Eq. (1), in the variable's own unit
    smooth = replace(OVER_SPEED, smoothing=smoothing)
    before, after = (np.hypot(speed - kink, smoothing) for kink in (1500.0, 2700.0))
    share = 0.5 + (before - after) / 2400.0
    expected = np.radians(13) + share * (0.1 - np.radians(13))
    assert smooth(None, speed) == pytest.approx(expected, rel=1e-12)


def test_smoothing_leaves_the_middle_and_rounds_the_ends() -> None:
    sharp, smooth = OVER_SPEED, replace(OVER_SPEED, smoothing=60.0)
    assert smooth(None, 2100.0) == pytest.approx(sharp(None, 2100.0), rel=1e-14)
    # a twentieth of the way: (1 + 0.05 − √1.0025) / 2 of it has been gone where it begins
    gone = (smooth(None, 1500.0) - np.radians(13)) / (0.1 - np.radians(13))
    assert gone == pytest.approx(0.5 * (1.05 - np.sqrt(1.0025)), rel=1e-9)


def test_a_parabola_has_its_vertex_at_the_end() -> None:
    bent = replace(OVER_TIME, shape="parabola")
    times = np.array([58.0, 65.5, 73.0, 80.5, 88.0, 600.0])
    gone = (42.0 - np.degrees(bent(times, None))) / 24.5
    assert gone == pytest.approx([0.0, 7 / 16, 3 / 4, 15 / 16, 1.0, 1.0])


@laws
@given(altitude=st.floats(0.0, 120e3), speed=st.floats(10.0, 8000.0), time=st.floats(0.0, 700.0))
def test_loads_scale_with_dynamic_pressure_and_ballistic_factor(
    model: FlightModel, altitude: float, speed: float, time: float
) -> None:
    air = air_loads(model.vehicle, model.atmosphere, altitude, speed, time)
    mach = speed / model.atmosphere.speed_of_sound(altitude)
    lift, drag = model.vehicle.aerodynamics.coefficients(air.angle_of_attack, mach)
    area = model.vehicle.reference_area / model.vehicle.mass
    pressure = 0.5 * model.atmosphere.density(altitude) * speed**2
    assert air.lift == pytest.approx(pressure * area * lift, rel=1e-12)
    assert air.drag == pytest.approx(pressure * area * drag, rel=1e-12)
    assert air.drag > 0.0
    heavy = replace(model.vehicle, mass=2.0 * model.vehicle.mass)
    halved = air_loads(heavy, model.atmosphere, altitude, speed, time)
    assert halved.lift == pytest.approx(0.5 * air.lift, rel=1e-12)


@pytest.mark.parametrize("name", ["mass", "reference_area", "heat_flux_constant"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_vehicle_without_mass_or_area_is_refused(name: str, value: float) -> None:
    fields = {
        "mass": 500.0,
        "reference_area": 2.0,
        "heat_flux_constant": 1e-4,
        "aerodynamics": ModifiedNewtonian(normal_quadratic=1.8, normal_linear=0.1, axial=0.05),
        "angle_of_attack": OVER_TIME,
    }
    with pytest.raises(ValueError, match=f"vehicle.{name}: must be positive, got {value}"):
        Vehicle(**{**fields, name: value})


def test_a_schedule_in_an_unknown_variable_is_refused() -> None:
    message = "angle_of_attack.variable: expected 'time' or 'speed', got 'mach'"
    with pytest.raises(ValueError, match=re.escape(message)):
        replace(OVER_TIME, variable="mach")


def test_a_schedule_that_ends_before_it_starts_is_refused() -> None:
    message = "angle_of_attack: end (58.0) must lie after start (58.0)"
    with pytest.raises(ValueError, match=re.escape(message)):
        replace(OVER_TIME, end=58.0)


def test_loads_are_ufuncs_over_flights(model: FlightModel) -> None:
    altitude, speed = np.array([30e3, 50e3, 80e3]), np.array([1000.0, 3000.0, 5000.0])
    together = air_loads(model.vehicle, model.atmosphere, altitude, speed, 100.0)
    alone = [
        air_loads(model.vehicle, model.atmosphere, h, v, 100.0)
        for h, v in zip(altitude, speed, strict=True)
    ]
    assert together.lift == pytest.approx([a.lift for a in alone], rel=1e-13)
    assert together.drag == pytest.approx([a.drag for a in alone], rel=1e-13)


def test_mach_number_is_left_out_where_it_is_not_needed() -> None:
    surrogate = ModifiedNewtonian(normal_quadratic=1.8, normal_linear=0.1, axial=0.05)
    assert not surrogate.needs_mach
    vehicle = Vehicle(
        mass=500.0,
        reference_area=2.0,
        heat_flux_constant=1e-4,
        aerodynamics=surrogate,
        angle_of_attack=OVER_TIME,
    )
    air = ExponentialAtmosphere(surface_density=1.2, scale_height=7e3, surface_gravity=9.8)
    loads = air_loads(vehicle, air, 0.0, 100.0, 73.0)
    lift, _ = surrogate.coefficients(np.radians(29.75), None)
    assert loads.lift == pytest.approx(0.5 * 1.2 * 100.0**2 * 2.0 / 500.0 * lift)
