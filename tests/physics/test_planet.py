"""Gravity as the radial derivative of the J2 potential; great circles; refusals."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from ampi.physics.angles import wrapped
from ampi.physics.planet import (
    WGS84,
    Planet,
    bearing,
    cross_range_angle,
    destination,
    gravity,
    great_circle_distance,
)
from tests.support.witness import numpy_of_symbols

laws = settings(deadline=None, max_examples=200)
latitudes = st.floats(-0.5 * np.pi, 0.5 * np.pi)
longitudes = st.floats(-np.pi, np.pi)
RADIUS = 6_378_137.0


def potential(radius: complex, latitude: float) -> complex:
    """−μ/r [1 − J2 (R_e/r)² P₂(sin φ)]."""
    legendre = 0.5 * (3.0 * np.sin(latitude) ** 2 - 1.0)
    return (
        -WGS84.gravitational_parameter
        / radius
        * (1.0 - WGS84.j2 * (WGS84.equatorial_radius / radius) ** 2 * legendre)
    )


@laws
@given(altitude=st.floats(0.0, 2e6), latitude=latitudes)
def test_gravity_is_the_radial_derivative_of_the_potential(
    altitude: float, latitude: float
) -> None:
    radius = RADIUS + altitude
    slope = potential(radius + 1e-20j, latitude).imag / 1e-20
    assert gravity(WGS84, radius, latitude) == pytest.approx(slope, rel=1e-13)


def test_gravity_numbers() -> None:
    # μ/R_e² = 9.798285 m/s², times 1 + 3/2 J2 at the equator and 1 − 3 J2 at a pole.
    assert gravity(WGS84, RADIUS, 0.0) == pytest.approx(9.814197, abs=1e-6)
    assert gravity(WGS84, RADIUS, 0.5 * np.pi) == pytest.approx(9.766462, abs=1e-6)


def test_wgs84_constants() -> None:
    assert (WGS84.equatorial_radius, WGS84.gravitational_parameter) == (6_378_137.0, 3.986004418e14)
    assert (WGS84.j2, WGS84.rotation_rate) == (1.08262668e-3, 7.2921e-5)
    assert WGS84.load_factor_gravity == 9.782


@laws
@given(lon1=longitudes, lat1=latitudes, lon2=longitudes, lat2=latitudes)
def test_great_circle_by_the_law_of_cosines(
    lon1: float, lat1: float, lon2: float, lat2: float
) -> None:
    cosine = np.sin(lat1) * np.sin(lat2) + np.cos(lat1) * np.cos(lat2) * np.cos(lon2 - lon1)
    assume(abs(cosine) < 0.999)  # the law of cosines loses its digits at both ends
    distance = great_circle_distance(lon1, lat1, lon2, lat2, RADIUS)
    assert distance == pytest.approx(RADIUS * np.arccos(cosine), rel=1e-11)
    assert great_circle_distance(lon2, lat2, lon1, lat1, RADIUS) == pytest.approx(distance)


@laws
@given(
    lon=longitudes,
    lat=st.floats(-1.4, 1.4),
    size=st.floats(-12.0, -5.0),
    direction=longitudes,
)
def test_great_circle_at_small_distances_is_plane(
    lon: float, lat: float, size: float, direction: float
) -> None:
    # Coordinates near one carry 1e-16 themselves, so the offsets are read back.
    lat2 = lat + 10.0**size * np.cos(direction)
    lon2 = lon + 10.0**size * np.sin(direction)
    plane = np.hypot(lat2 - lat, np.cos(0.5 * (lat + lat2)) * (lon2 - lon))
    got = great_circle_distance(lon, lat, lon2, lat2, RADIUS)
    assert got == pytest.approx(RADIUS * plane, rel=1e-8)


@laws
@given(lon=longitudes, lat=latitudes, turn=longitudes)
def test_great_circle_along_meridians_and_to_itself(lon: float, lat: float, turn: float) -> None:
    assert great_circle_distance(lon, lat, lon, lat, RADIUS) == 0.0
    to_pole = great_circle_distance(lon, lat, lon + turn, 0.5 * np.pi, RADIUS)
    assert to_pole == pytest.approx(RADIUS * (0.5 * np.pi - lat), rel=1e-9, abs=1e-3)


@laws
@given(lon=longitudes, lat=latitudes, azimuth=longitudes, angle=st.floats(0.01, 3.1))
def test_a_destination_lies_at_its_distance_and_bearing(
    lon: float, lat: float, azimuth: float, angle: float
) -> None:
    assume(abs(lat) < 1.5)  # the bearing at a pole is any
    there = destination(lon, lat, azimuth, angle)
    assert great_circle_distance(lon, lat, *there, RADIUS) == pytest.approx(
        RADIUS * angle, rel=1e-9
    )
    assert wrapped(bearing(lon, lat, *there) - azimuth) == pytest.approx(0.0, abs=1e-7)
    assert abs(there[0] - lon) <= np.pi + 1e-12  # on the turn of where it starts


@laws
@example(lon=0.0, lat=1.12)  # whose haversine is rounded to more than one
@given(lon=longitudes, lat=latitudes)
def test_antipodes_are_half_a_circle_apart(lon: float, lat: float) -> None:
    away = great_circle_distance(lon, lat, lon + np.pi, -lat, RADIUS)
    assert away == pytest.approx(RADIUS * np.pi, rel=1e-7)  # and never NaN


def test_great_circle_from_the_entry_interface_to_greenland() -> None:
    # SHEFEX-3: about 1,400 km (Sagliano et al. 2016, Section IV.B).
    entry, target = np.radians([-11.60, 71.89]), np.radians([-45.75, 66.40])
    distance = great_circle_distance(*entry, *target, RADIUS)
    assert 1.35e6 < distance < 1.5e6


@pytest.mark.parametrize("name", ["equatorial_radius", "gravitational_parameter"])
def test_a_planet_without_size_or_mass_is_refused(name: str) -> None:
    constants = {
        "equatorial_radius": RADIUS,
        "gravitational_parameter": 3.986e14,
        "j2": 0.0,
        "rotation_rate": 0.0,
        "load_factor_gravity": 9.81,
    }
    with pytest.raises(ValueError, match="equatorial_radius and gravitational_parameter must be"):
        Planet(**{**constants, name: 0.0})


@laws
@given(
    lon=longitudes,
    lat=st.floats(-1.4, 1.4),
    azimuth=longitudes,
    ahead=st.floats(0.01, 3.0),
    aside=st.floats(-1.5, 1.5),
)
def test_cross_range_is_what_was_flown_at_right_angles_to_the_left(
    lon: float, lat: float, azimuth: float, ahead: float, aside: float
) -> None:
    there = destination(lon, lat, azimuth, ahead)
    assume(abs(there[1]) < 1.5)
    onward = bearing(*there, lon, lat) + np.pi
    final = destination(*there, onward - 0.5 * np.pi, aside)
    assert cross_range_angle(lon, lat, azimuth, *final) == pytest.approx(aside, abs=1e-9)


def test_cross_range_of_an_eastward_entry_on_the_equator_is_the_final_latitude() -> None:
    x = ca.SX.sym("x", 5)
    with numpy_of_symbols():
        traced = ca.Function("traced", [x], [cross_range_angle(*ca.vertsplit(x))])
    latitude = float(traced([0.0, 0.0, 0.5 * np.pi, 0.8, 0.6]))
    assert latitude == pytest.approx(0.6, abs=1e-15)
