"""US76 against its printed table and the package ussa1976; smoothness; the exponential law."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import ussa1976
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from ampi.physics.atmosphere import ExponentialAtmosphere, StandardAtmosphere1976

Array = NDArray[np.float64]
ALTITUDES = np.linspace(0.0, 120e3, 481)
laws = settings(deadline=None, max_examples=100)

# US Standard Atmosphere 1976: km, kg/m³ (shared/missions.md)
PRINTED = {
    0: 1.2250,
    20: 8.891e-2,
    40: 3.9957e-3,
    60: 3.0968e-4,
    80: 1.8458e-5,
    86: 6.958e-6,
    90: 3.416e-6,
    100: 5.61e-7,
    110: 9.75e-8,
    120: 2.24e-8,
}


@pytest.fixture(scope="module")
def us76() -> StandardAtmosphere1976:
    return StandardAtmosphere1976()


@pytest.fixture(scope="module")
def oracle() -> dict[str, Array]:
    data = ussa1976.compute(z=ALTITUDES, variables=["t", "rho", "cs"])
    return {name: np.asarray(data[name].values) for name in ("t", "rho", "cs")}


def log_slope(density: Callable, altitude: Array) -> Array:
    """d ln ρ / dh by complex step."""
    return np.log(density(altitude + 1e-20j)).imag / 1e-20


def jumps_like_its_neighbours(curvature: Array) -> bool:
    """Whether no difference of successive samples stands out among those beside it."""
    jump = np.abs(np.diff(curvature))
    beside = np.maximum(jump[:-2], jump[2:])
    return bool(np.all(jump[1:-1] < 2.0 * beside + 0.02 * jump.max()))


def test_density_has_no_jump_in_its_second_derivative(us76: StandardAtmosphere1976) -> None:
    step = 50.0
    altitude = np.arange(step, 120e3, step)
    slope = log_slope(us76.density, altitude)
    assert jumps_like_its_neighbours(np.diff(slope) / step)
    # The same judgement refuses a once differentiable interpolant of the table.
    knots = np.arange(0.0, 121e3, 1e3)
    rough = PchipInterpolator(knots, np.log(us76.density(knots)))
    assert not jumps_like_its_neighbours(np.diff(rough(altitude, 1)) / step)


@laws
@given(altitude=st.floats(0.0, 119.9e3))
def test_density_decreases(us76: StandardAtmosphere1976, altitude: float) -> None:
    assert us76.density(altitude + 100.0) < us76.density(altitude)


@laws
@given(altitude=st.floats(0.0, 120e3))
def test_density_is_nearly_hydrostatic(us76: StandardAtmosphere1976, altitude: float) -> None:
    # d ln ρ/dh = −g/(R T) − d ln T/dh; below 80 km, where the air is mixed.
    altitude = altitude * 2.0 / 3.0
    ratio = 6_356_766.0 / (6_356_766.0 + altitude)
    temperature = us76.temperature(altitude + 1e-20j)
    expected = -9.80665 * ratio**2 / (287.053 * temperature.real)
    expected -= temperature.imag / 1e-20 / temperature.real
    got = log_slope(us76.density, np.array([altitude]))[0]
    assert got == pytest.approx(expected, abs=0.25 * abs(expected))


@pytest.mark.parametrize("edge", [0.0, 120e3])
def test_density_continues_with_value_and_slope_of_the_edge(
    us76: StandardAtmosphere1976, edge: float
) -> None:
    inside, outside = (edge + 1e-3, edge - 1e-3) if edge == 0.0 else (edge - 1e-3, edge + 1e-3)
    assert us76.density(outside) == pytest.approx(us76.density(inside), rel=1e-6)
    slopes = log_slope(us76.density, np.array([inside, outside]))
    assert slopes[1] == pytest.approx(slopes[0], rel=1e-6)
    far = log_slope(us76.density, np.array([edge + np.sign(edge - 60e3) * 5e3]))
    assert far[0] == pytest.approx(slopes[1], rel=1e-9)


@pytest.mark.parametrize(("altitude_km", "density"), PRINTED.items())
def test_density_of_the_printed_table(
    us76: StandardAtmosphere1976, altitude_km: float, density: float
) -> None:
    assert us76.density(altitude_km * 1e3) == pytest.approx(density, rel=0.015)


def test_density_against_ussa1976(us76: StandardAtmosphere1976, oracle: dict[str, Array]) -> None:
    error = us76.density(ALTITUDES) / oracle["rho"] - 1.0
    assert np.sqrt(np.mean(error**2)) < 0.0035
    assert np.abs(error).max() < 0.015


def test_temperature_and_sound_against_ussa1976(
    us76: StandardAtmosphere1976, oracle: dict[str, Array]
) -> None:
    assert np.abs(us76.temperature(ALTITUDES) - oracle["t"]).max() < 3.0
    known = np.isfinite(oracle["cs"])  # the standard gives none above 86 km
    assert known.sum() > 300
    error = us76.speed_of_sound(ALTITUDES[known]) / oracle["cs"][known] - 1.0
    assert np.abs(error).max() < 0.01


def test_scalars_and_arrays_agree(us76: StandardAtmosphere1976) -> None:
    altitude = np.array([-500.0, 0.0, 31_400.0, 120e3, 130e3])
    one_by_one = [float(us76.density(h)) for h in altitude]
    assert us76.density(altitude) == pytest.approx(one_by_one, rel=1e-14)


@laws
@given(altitude=st.floats(-1e3, 150e3), rise=st.floats(-2e4, 2e4))
def test_exponential_atmosphere(altitude: float, rise: float) -> None:
    air = ExponentialAtmosphere(surface_density=1.225, scale_height=7110.0, surface_gravity=9.80665)
    ratio = air.density(altitude + rise) / air.density(altitude)
    assert ratio == pytest.approx(np.exp(-rise / 7110.0), rel=1e-12)
    assert air.density(0.0) == 1.225
    # isothermal: c² = κ g₀ H
    assert air.speed_of_sound(altitude) ** 2 == pytest.approx(1.4 * 9.80665 * 7110.0, rel=1e-14)


def test_an_isothermal_atmosphere_of_another_planet() -> None:
    # Mars: 210 K of CO₂, R = 188.9 J/(kg K): H = R T / g, c = √(κ R T) = 226 m/s
    air = ExponentialAtmosphere(
        surface_density=0.02,
        scale_height=188.9 * 210.0 / 3.71,
        surface_gravity=3.71,
        specific_heat_ratio=1.29,
    )
    assert air.speed_of_sound(5e3) == pytest.approx(np.sqrt(1.29 * 188.9 * 210.0), rel=1e-12)
