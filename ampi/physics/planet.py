"""Rotating planet with a central field and J2.

    g(r, φ) = μ/r² · [1 + 3/2 J2 (R_e/r)² (1 − 3 sin²φ)]                        (1)

Eq. (1) is the radial component only: the one g of Sagliano et al. 2016, Eq. (2).

References
----------
Sagliano, Mooij, Theil (2016), AIAA 2016-2115, Section III. WGS84: NIMA TR8350.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Planet:
    """Constants of a planet (SI). `load_factor_gravity` is the g₀ in which load factors are counted."""

    equatorial_radius: float  # m
    gravitational_parameter: float  # m³/s²
    j2: float  # –
    rotation_rate: float  # rad/s
    load_factor_gravity: float  # m/s²

    def __post_init__(self) -> None:
        if np.any(self.equatorial_radius <= 0) or np.any(self.gravitational_parameter <= 0):
            raise ValueError(
                "planet: equatorial_radius and gravitational_parameter must be positive, got "
                f"{self.equatorial_radius} m and {self.gravitational_parameter} m³/s²"
            )

    @property
    def surface_gravity(self) -> float:
        """μ/R_e² (m/s²)."""
        return self.gravitational_parameter / (self.equatorial_radius * self.equatorial_radius)

    @property
    def load_factor_unit(self) -> str:
        """The g of this planet's load factors as it is printed."""
        return f"g of {self.load_factor_gravity:.4g} m/s²"


WGS84 = Planet(
    equatorial_radius=6_378_137.0,
    gravitational_parameter=3.986004418e14,
    j2=1.08262668e-3,
    rotation_rate=7.2921e-5,
    load_factor_gravity=9.782,
)


def gravity(planet: Planet, radius: Any, latitude: Any) -> Any:
    """Radial gravity acceleration (m/s²) at `radius` (m) and `latitude` (rad), Eq. (1)."""
    sin_latitude = np.sin(latitude)
    oblateness = (
        1.5
        * planet.j2
        * (planet.equatorial_radius / radius) ** 2
        * (1.0 - 3.0 * sin_latitude * sin_latitude)
    )
    return planet.gravitational_parameter / (radius * radius) * (1.0 + oblateness)


def haversine(longitude_1: Any, latitude_1: Any, longitude_2: Any, latitude_2: Any) -> Any:
    """sin²(d/2) of the angle d between two points (rad): smooth, at any latitude, on any turn."""
    return (
        np.sin(0.5 * (latitude_2 - latitude_1)) ** 2
        + np.cos(latitude_1) * np.cos(latitude_2) * np.sin(0.5 * (longitude_2 - longitude_1)) ** 2
    )


def great_circle_distance(
    longitude_1: Any, latitude_1: Any, longitude_2: Any, latitude_2: Any, radius: float
) -> Any:
    """Distance over a sphere of `radius` (m) between two points (rad): haversine, exact near zero."""
    half_chord_squared = haversine(longitude_1, latitude_1, longitude_2, latitude_2)
    return 2.0 * radius * np.arcsin(np.sqrt(half_chord_squared))


def destination(longitude: Any, latitude: Any, azimuth: Any, angle: Any) -> tuple[Any, Any]:
    """Longitude and latitude (rad) at `angle` (rad) from a point on the great circle along `azimuth`.

    The longitude goes on from that of the point: it may lie on another turn than [−π, π).
    """
    ahead, aside = np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth)
    outward = np.cos(latitude) * np.cos(angle) - np.sin(latitude) * ahead
    north = np.sin(latitude) * np.cos(angle) + np.cos(latitude) * ahead
    return longitude + np.arctan2(aside, outward), np.arctan2(north, np.hypot(outward, aside))


def bearing(longitude_1: Any, latitude_1: Any, longitude_2: Any, latitude_2: Any) -> Any:
    """Azimuth (rad; 0 = north, clockwise) at the first point of the great circle to the second."""
    east = longitude_2 - longitude_1
    return np.arctan2(
        np.sin(east) * np.cos(latitude_2),
        np.cos(latitude_1) * np.sin(latitude_2)
        - np.sin(latitude_1) * np.cos(latitude_2) * np.cos(east),
    )


def cross_range_angle(
    longitude: Any, latitude: Any, azimuth: Any, final_longitude: Any, final_latitude: Any
) -> Any:
    """Angle (rad) of a final point out of the plane of the great circle along `azimuth` (rad).

    Positive to the left of the heading at the first point; on the pole of that circle ± π/2.
    """
    east = final_longitude - longitude
    to_the_east = np.cos(final_latitude) * np.sin(east)
    to_the_north = np.cos(latitude) * np.sin(final_latitude) - np.sin(latitude) * np.cos(
        final_latitude
    ) * np.cos(east)
    outward = np.sin(latitude) * np.sin(final_latitude) + np.cos(latitude) * np.cos(
        final_latitude
    ) * np.cos(east)
    ahead = np.cos(azimuth) * to_the_north + np.sin(azimuth) * to_the_east
    aside = np.sin(azimuth) * to_the_north - np.cos(azimuth) * to_the_east
    return np.arctan2(aside, np.sqrt(ahead * ahead + outward * outward))
