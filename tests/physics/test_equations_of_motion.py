"""Laws of motion: an inertial frame as independent witness, conservation, mirror symmetries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.missions import load_mission
from ampi.physics.atmosphere import ExponentialAtmosphere
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.planet import WGS84, Planet, gravity
from ampi.physics.state import STATE_UNITS, STATES
from ampi.physics.vehicle import air_loads

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=150)
VACUUM = ExponentialAtmosphere(surface_density=1e-200, scale_height=7e3, surface_gravity=9.8)

states = st.tuples(
    st.floats(5e3, 115e3),
    st.floats(-3.0, 3.0),
    st.floats(-1.4, 1.4),
    st.floats(300.0, 7500.0),
    st.floats(-1.2, 1.2),
    st.floats(-3.1, 3.1),
    st.floats(-3.1, 3.1),
)
times = st.floats(0.0, 700.0)


def in_vacuum(planet: Planet) -> FlightModel:
    """The SHEFEX-3 vehicle with nothing to fly in."""
    return FlightModel(planet, VACUUM, load_mission("shefex3").flight_model.vehicle)


SPHERE_AT_REST = replace(WGS84, rotation_rate=0.0, j2=0.0)
ROTATING_SPHERE = replace(WGS84, j2=0.0)


def local_axes(longitude: complex, latitude: complex) -> tuple[Array, Array, Array]:
    """East, north and up in equatorial Cartesian axes."""
    sin_lon, cos_lon = np.sin(longitude), np.cos(longitude)
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    east = np.array([-sin_lon, cos_lon, 0.0 * sin_lon])
    north = np.array([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat])
    up = np.array([cos_lat * cos_lon, cos_lat * sin_lon, sin_lat])
    return east, north, up


def inertial(planet: Planet, state: Array, time: complex) -> Array:
    """Inertial Cartesian position and velocity (6,) of a planet-relative state."""
    altitude, longitude, latitude, speed, fpa, azimuth = state[:6]
    east, north, up = local_axes(longitude + planet.rotation_rate * time, latitude)
    position = (planet.equatorial_radius + altitude) * up
    direction = np.sin(fpa) * up + np.cos(fpa) * (np.sin(azimuth) * east + np.cos(azimuth) * north)
    carried = planet.rotation_rate * np.array([-position[1], position[0], 0.0 * position[0]])
    return np.concatenate([position, speed * direction + carried])


def planet_relative(planet: Planet, flown: Array, time: float) -> Array:
    """h, θ, φ, V, γ, ψ of an inertial Cartesian position and velocity: the inverse."""
    position, velocity = flown[:3], flown[3:]
    radius = np.linalg.norm(position)
    latitude = np.arcsin(position[2] / radius)
    right_ascension = np.arctan2(position[1], position[0])
    relative = velocity - planet.rotation_rate * np.array([-position[1], position[0], 0.0])
    east, north, up = (axis @ relative for axis in local_axes(right_ascension, latitude))
    speed = np.linalg.norm(relative)
    longitude = right_ascension - planet.rotation_rate * time
    altitude = radius - planet.equatorial_radius
    return np.array(
        [altitude, longitude, latitude, speed, np.arcsin(up / speed), np.arctan2(east, north)]
    )


def flown(model: FlightModel, state: Array, duration: float) -> Callable[[Array], Array]:
    """Dense DOP853 flight (7, …) from `state` at constant bank angle."""
    solution = solve_ivp(
        lambda t, x: equations_of_motion(model, x, 0.0, t),
        (0.0, duration),
        state,
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
        dense_output=True,
    )
    assert solution.success
    return solution.sol


@laws
@given(state=states, time=times)
def test_newton_holds_in_the_inertial_frame(
    model: FlightModel, state: tuple[float, ...], time: float
) -> None:
    # The chain rule carries the rates to Cartesian axes that do not rotate: there the velocity is
    # the rate of position, and the acceleration is gravity, drag against and lift across the air.
    x = np.array(state)
    rates = np.array(equations_of_motion(model, x, 0.0, time))
    shift = 1e-20j
    moved = inertial(model.planet, x + shift * rates, time + shift).imag / 1e-20
    here = inertial(model.planet, x, time)
    assert moved[:3] == pytest.approx(here[3:], rel=1e-12, abs=1e-8)

    altitude, longitude, latitude, speed, fpa, azimuth, bank = x
    east, north, up = local_axes(longitude + model.planet.rotation_rate * time, latitude)
    forward = np.sin(fpa) * up + np.cos(fpa) * (np.sin(azimuth) * east + np.cos(azimuth) * north)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    air = air_loads(model.vehicle, model.atmosphere, altitude, speed, time)
    lift = np.cos(bank) * np.cross(right, forward) + np.sin(bank) * right
    weight = gravity(model.planet, model.planet.equatorial_radius + altitude, latitude)
    force = -weight * up - air.drag * forward + air.lift * lift
    scale = weight + air.drag + abs(air.lift)
    assert np.abs(moved[3:] - force).max() < 1e-11 * scale


@laws
@given(state=states, time=times)
def test_mirror_across_the_equator(
    model: FlightModel, state: tuple[float, ...], time: float
) -> None:
    # φ → −φ, ψ → π − ψ, σ → −σ; rotation and J2 have the equator as plane of symmetry.
    h, lon, lat, speed, fpa, azimuth, bank = state
    rates = np.array(equations_of_motion(model, state, 0.01, time))
    mirrored = (h, lon, -lat, speed, fpa, np.pi - azimuth, -bank)
    signs = np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0])
    got = np.array(equations_of_motion(model, mirrored, -0.01, time))
    assert got == pytest.approx(signs * rates, rel=1e-12, abs=1e-12)


@laws
@given(state=states, time=times)
def test_mirror_across_a_meridian_turns_the_planet_the_other_way(
    model: FlightModel, state: tuple[float, ...], time: float
) -> None:
    # θ → −θ, ψ → −ψ, σ → −σ, ω → −ω: without rotation, right and left banks are mirror images.
    h, lon, lat, speed, fpa, azimuth, bank = state
    backwards = replace(model.planet, rotation_rate=-model.planet.rotation_rate)
    other = FlightModel(backwards, model.atmosphere, model.vehicle)
    rates = np.array(equations_of_motion(model, state, 0.01, time))
    mirrored = (h, -lon, lat, speed, fpa, -azimuth, -bank)
    signs = np.array([1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
    got = np.array(equations_of_motion(other, mirrored, -0.01, time))
    assert got == pytest.approx(signs * rates, rel=1e-12, abs=1e-12)


@laws
@given(state=states, time=times, turn=st.floats(-6.0, 6.0))
def test_nothing_depends_on_longitude(
    model: FlightModel, state: tuple[float, ...], time: float, turn: float
) -> None:
    turned = (state[0], state[1] + turn, *state[2:])
    rates = equations_of_motion(model, state, 0.0, time)
    assert equations_of_motion(model, turned, 0.0, time) == rates


@settings(deadline=None, max_examples=8)
@given(
    altitude=st.floats(60e3, 110e3),
    latitude=st.floats(-1.0, 1.0),
    speed=st.floats(4000.0, 7500.0),
    fpa=st.floats(0.0, 0.2),
    azimuth=st.floats(-3.0, 3.0),
)
def test_energy_and_angular_momentum_are_conserved(
    altitude: float, latitude: float, speed: float, fpa: float, azimuth: float
) -> None:
    start = np.array([altitude, 0.3, latitude, speed, fpa, azimuth, 0.5])
    orbit = flown(in_vacuum(SPHERE_AT_REST), start, 300.0)
    energies, momenta = [], []
    for time in np.linspace(0.0, 300.0, 7):
        there = inertial(SPHERE_AT_REST, orbit(time), time)
        radius = np.linalg.norm(there[:3])
        energies.append(0.5 * there[3:] @ there[3:] - WGS84.gravitational_parameter / radius)
        momenta.append(np.cross(there[:3], there[3:]))
    assert energies == pytest.approx(np.full(7, energies[0]), rel=1e-10)
    size = np.linalg.norm(momenta[0])
    assert np.abs(np.array(momenta) - momenta[0]).max() < 1e-10 * size


@settings(deadline=None, max_examples=8)
@given(latitude=st.floats(-1.0, 1.0), speed=st.floats(3000.0, 7500.0), azimuth=st.floats(-3.0, 3.0))
def test_jacobi_integral_is_conserved_on_the_rotating_sphere(
    latitude: float, speed: float, azimuth: float
) -> None:
    start = np.array([90e3, 0.0, latitude, speed, 0.1, azimuth, 0.0])
    orbit = flown(in_vacuum(ROTATING_SPHERE), start, 300.0)
    h, _, lat, v = orbit(np.linspace(0.0, 300.0, 7))[:4]
    radius = WGS84.equatorial_radius + h
    jacobi = 0.5 * v**2 - WGS84.gravitational_parameter / radius
    jacobi -= 0.5 * (WGS84.rotation_rate * radius * np.cos(lat)) ** 2
    assert jacobi == pytest.approx(np.full(7, jacobi[0]), rel=1e-11)


@pytest.mark.parametrize("azimuth_deg", [-85.92, 10.0, 90.0, 200.0])
@pytest.mark.parametrize("latitude_deg", [71.89, 5.0, -40.0])
def test_flight_agrees_with_an_inertial_integration(
    azimuth_deg: float, latitude_deg: float
) -> None:
    # Signs of the Coriolis and centrifugal terms: they displace these flights by kilometres.
    start = np.array([100.1e3, -0.2, np.radians(latitude_deg), 4712.26, 0.1, 0.0, 0.0])
    start[5] = np.radians(azimuth_deg)
    duration = 500.0

    def point_mass(_: float, y: Array) -> Array:
        position = y[:3]
        pull = -WGS84.gravitational_parameter / np.linalg.norm(position) ** 3
        return np.concatenate([y[3:], pull * position])

    witness = solve_ivp(
        point_mass,
        (0.0, duration),
        inertial(ROTATING_SPHERE, start, 0.0),
        method="DOP853",
        rtol=1e-12,
        atol=1e-6,
    )
    expected = planet_relative(ROTATING_SPHERE, witness.y[:, -1], duration)
    got = flown(in_vacuum(ROTATING_SPHERE), start, duration)(duration)[:6]
    error = got - expected
    error[5] = np.angle(np.exp(1j * error[5]))
    assert np.abs(error / [1.0, 1e-7, 1e-7, 1e-3, 1e-7, 1e-6]).max() < 1e-2
    at_rest = flown(in_vacuum(SPHERE_AT_REST), start, duration)(duration)[:6]
    assert np.abs(at_rest[1:3] - expected[1:3]).max() > 1e-4


def test_air_takes_energy_and_lift_does_not() -> None:
    model = load_mission("shefex3").flight_model
    model = FlightModel(SPHERE_AT_REST, model.atmosphere, model.vehicle)
    flight = flown(model, np.append(load_mission("shefex3").entry_state, 0.4), 250.0)
    sample = np.linspace(0.0, 250.0, 6)
    x = flight(sample)
    radius = WGS84.equatorial_radius + x[0]
    energy = 0.5 * x[3] ** 2 - WGS84.gravitational_parameter / radius
    assert np.all(np.diff(energy) < 0.0)
    for k, time in enumerate(sample):
        rates = np.array(equations_of_motion(model, x[:, k], 0.0, time))
        power = x[3, k] * rates[3] + WGS84.gravitational_parameter / radius[k] ** 2 * rates[0]
        air = air_loads(model.vehicle, model.atmosphere, x[0, k], x[3, k], time)
        assert power == pytest.approx(-air.drag * x[3, k], rel=1e-9, abs=1e-8)


def test_a_bank_to_the_right_turns_to_the_right(model: FlightModel) -> None:
    state = np.array([40e3, 0.0, 0.1, 3000.0, 0.0, 1.0, 0.0])
    level = equations_of_motion(model, state, 0.0, 100.0)
    right = equations_of_motion(model, state + np.array([0, 0, 0, 0, 0, 0, 0.5]), 0.0, 100.0)
    assert right[5] > level[5]
    assert right[4] < level[4]
    assert equations_of_motion(model, state, 0.07, 100.0)[6] == 0.07


def test_flights_together_and_alone_are_the_same(model: FlightModel) -> None:
    rng = np.random.default_rng(5)
    low = np.array([10e3, -3.0, -1.0, 500.0, -1.0, -3.0, -1.0])
    high = np.array([110e3, 3.0, 1.0, 7000.0, 1.0, 3.0, 1.0])
    batch = low[:, None] + (high - low)[:, None] * rng.uniform(size=(7, 9))
    together = equations_of_motion(model, batch, np.zeros(9), 20.0)
    for k in range(9):
        alone = np.array(equations_of_motion(model, batch[:, k], 0.0, 20.0))
        assert np.array([row[k] for row in together]) == pytest.approx(alone, rel=1e-12, abs=1e-15)


def test_states_are_named_with_units() -> None:
    assert STATES[:4] == ("altitude", "longitude", "latitude", "speed")
    assert STATES[4:] == ("flight_path_angle", "azimuth", "bank_angle")
    assert STATE_UNITS == ("m", "rad", "rad", "m/s", "rad", "rad", "rad")
