"""Dynamic pressure, heat flux and load factor: their laws and the SHEFEX-3 orders of magnitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.missions import load_mission
from ampi.physics.aerodynamics import ModifiedNewtonian
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.path_constraints import no_fly_zone, path_constraints
from ampi.physics.planet import destination
from ampi.physics.state import LOADS
from ampi.physics.vehicle import air_loads

laws = settings(deadline=None, max_examples=100)
altitudes, speeds = st.floats(5e3, 115e3), st.floats(100.0, 7500.0)
times = st.floats(0.0, 700.0)


def at(altitude: float, speed: float) -> np.ndarray:
    """A state at `altitude` and `speed`, the rest of no influence."""
    return np.array([altitude, 0.1, 0.2, speed, -0.3, 0.4, 0.5])


@laws
@given(altitude=altitudes, speed=speeds, factor=st.floats(1.01, 3.0), time=times)
def test_powers_of_speed(
    model: FlightModel, altitude: float, speed: float, factor: float, time: float
) -> None:
    slow = path_constraints(model, at(altitude, speed), time)
    fast = path_constraints(model, at(altitude, factor * speed), time)
    exponent = model.vehicle.heat_flux_speed_exponent
    assert fast[0] / slow[0] == pytest.approx(factor**2, rel=1e-12)
    assert fast[1] / slow[1] == pytest.approx(factor**exponent, rel=1e-12)


@laws
@given(altitude=altitudes, speed=speeds, time=times)
def test_heat_flux_and_pressure_share_the_density(
    model: FlightModel, altitude: float, speed: float, time: float
) -> None:
    pressure, heat_flux, _ = path_constraints(model, at(altitude, speed), time)
    density = model.atmosphere.density(altitude)
    assert pressure == pytest.approx(0.5 * density * speed**2, rel=1e-13)
    vehicle = model.vehicle
    known = vehicle.heat_flux_constant * np.sqrt(density)
    known *= speed**vehicle.heat_flux_speed_exponent
    assert heat_flux == pytest.approx(known, rel=1e-13)


@laws
@given(altitude=altitudes, speed=speeds, time=times)
def test_load_factor_is_the_body_normal_force(altitude: float, speed: float, time: float) -> None:
    # L cos α + D sin α is q S C_N, and the surrogate is given by C_N itself.
    model = load_mission("shefex3").flight_model
    pressure, _, load_factor = path_constraints(model, at(altitude, speed), time)
    vehicle = model.vehicle
    sin_alpha = np.sin(vehicle.angle_of_attack(time, speed))
    normal = 1.83 * sin_alpha**2 + 0.15 * sin_alpha
    force = pressure * vehicle.reference_area * normal
    assert load_factor == pytest.approx(force / (vehicle.mass * 9.782), rel=1e-12)


@laws
@given(altitude=altitudes, speed=speeds, time=times)
def test_the_total_load_factor_is_the_whole_force(
    model: FlightModel, altitude: float, speed: float, time: float
) -> None:
    whole = replace(model, vehicle=replace(model.vehicle, load_factor="total"))
    air = air_loads(model.vehicle, model.atmosphere, altitude, speed, time)
    force = np.hypot(air.lift, air.drag) / model.planet.load_factor_gravity
    values = path_constraints(whole, at(altitude, speed), time)
    assert values[2] == pytest.approx(force, rel=1e-12)
    assert values[:2] == path_constraints(model, at(altitude, speed), time)[:2]


def test_load_factor_is_positive_at_negative_lift() -> None:
    model = load_mission("shefex3").flight_model
    upside_down = ModifiedNewtonian(normal_quadratic=-1.83, normal_linear=-0.15, axial=0.045)
    other = FlightModel(
        model.planet, model.atmosphere, replace(model.vehicle, aerodynamics=upside_down)
    )
    for time in (0.0, 100.0):
        loads = [path_constraints(m, at(40e3, 3000.0), time)[2] for m in (model, other)]
        assert loads[1] == pytest.approx(loads[0], rel=1e-12)
        assert loads[1] > 0.0


def test_bank_angle_and_position_have_no_influence(model: FlightModel) -> None:
    state = at(45e3, 4000.0)
    moved = state + np.array([0.0, 1.0, 0.5, 0.0, 0.2, 1.0, -1.0])
    assert path_constraints(model, moved, 100.0) == path_constraints(model, state, 100.0)


def test_shefex3_at_40_km() -> None:
    # Missions file: at 4,200 m/s under 40 km, about 35 kPa; ρ = 3.9957e-3 kg/m³ there.
    model = load_mission("shefex3").flight_model
    pressure, heat_flux, load_factor = path_constraints(model, at(40e3, 4200.0), 70.0)
    assert pressure == pytest.approx(35.24e3, rel=1e-3)
    assert heat_flux == pytest.approx(1.2444e-3 * np.sqrt(3.9957e-3) * 4200.0**3, rel=1e-3)
    # α(70 s) = 32.2°: C_N = 1.83 sin² + 0.15 sin = 0.59956
    assert load_factor == pytest.approx(35.24e3 * 2.0 * 0.59956 / (500.0 * 9.782), rel=1e-3)
    assert LOADS == ("dynamic_pressure", "heat_flux", "load_factor")


@laws
@given(
    centre=st.tuples(st.floats(-7.0, 7.0), st.floats(-1.55, 1.55)),
    radius=st.floats(1e-3, 1.5),
    azimuth=st.floats(0.0, 6.3),
    turns=st.integers(-2, 2),
)
def test_a_no_fly_zone_is_a_circle_on_the_sphere(
    centre: tuple[float, float], radius: float, azimuth: float, turns: int
) -> None:
    zone = (*centre, radius)
    for share, sign in ((0.9, 1.0), (1.0, 0.0), (1.1, -1.0)):
        longitude, latitude = destination(*centre, azimuth, share * radius)
        g = no_fly_zone(longitude + 2.0 * np.pi * turns, latitude, zone)
        inside = 2.0 - np.sin(0.5 * share * radius) ** 2 / np.sin(0.5 * radius) ** 2
        assert g == pytest.approx(inside, abs=1e-8)
        assert np.sign(round(float(g) - 1.0, 8)) == sign
    assert no_fly_zone(*centre, zone) == 2.0
