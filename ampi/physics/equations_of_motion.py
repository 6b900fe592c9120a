"""Equations of motion over a rotating planet, Sagliano et al. 2016, Eq. (2).

    state    x = (h, θ, φ, V, γ, ψ, σ): altitude, longitude, latitude, planet-relative speed,
             flight-path angle, azimuth (0 = north, clockwise), bank angle
    control  u = σ̇

Written once, in numpy ufuncs: floats, arrays over flights, complex steps and CasADi symbols all
run through these lines.

References
----------
Vinh (1981), "Optimal Trajectories in Atmospheric Flight", Chapter 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ampi.physics.atmosphere import Atmosphere
from ampi.physics.planet import Planet, gravity
from ampi.physics.state import N_STATES
from ampi.physics.vehicle import Vehicle, air_loads


@dataclass(frozen=True)
class FlightModel:
    """Everything the right-hand side depends on besides state, control and time."""

    planet: Planet
    atmosphere: Atmosphere
    vehicle: Vehicle


def equations_of_motion(
    model: FlightModel, state: Any, bank_rate: Any, time: Any
) -> tuple[Any, ...]:
    """Time derivatives of the seven states, Eq. (2).

    Parameters
    ----------
    model
        Planet, atmosphere and vehicle.
    state
        Sequence of seven floats, equally shaped arrays, or symbols (SI, rad).
    bank_rate
        σ̇ (rad/s).
    time
        Time since the entry interface (s); the angle of attack may depend on it.
    """
    altitude, _, latitude, speed, flight_path_angle, azimuth, bank_angle = (
        state[i] for i in range(N_STATES)
    )
    radius = model.planet.equatorial_radius + altitude
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    sin_fpa, cos_fpa = np.sin(flight_path_angle), np.cos(flight_path_angle)
    sin_azi, cos_azi = np.sin(azimuth), np.cos(azimuth)
    tan_fpa, tan_lat = sin_fpa / cos_fpa, sin_lat / cos_lat

    air = air_loads(model.vehicle, model.atmosphere, altitude, speed, time)
    g = gravity(model.planet, radius, latitude)
    omega = model.planet.rotation_rate
    centrifugal = omega * omega * radius * cos_lat

    altitude_rate = speed * sin_fpa
    longitude_rate = speed * cos_fpa * sin_azi / (radius * cos_lat)
    latitude_rate = speed * cos_fpa * cos_azi / radius
    speed_rate = (
        -air.drag - g * sin_fpa + centrifugal * (sin_fpa * cos_lat - cos_fpa * sin_lat * cos_azi)
    )
    flight_path_rate = (
        air.lift * np.cos(bank_angle) / speed
        + (speed / radius - g / speed) * cos_fpa
        + 2.0 * omega * cos_lat * sin_azi
        + centrifugal / speed * (cos_fpa * cos_lat + sin_fpa * sin_lat * cos_azi)
    )
    azimuth_rate = (
        air.lift * np.sin(bank_angle) / (speed * cos_fpa)
        + speed / radius * cos_fpa * sin_azi * tan_lat
        - 2.0 * omega * (tan_fpa * cos_lat * cos_azi - sin_lat)
        + centrifugal / (speed * cos_fpa) * sin_lat * sin_azi
    )
    return (
        altitude_rate,
        longitude_rate,
        latitude_rate,
        speed_rate,
        flight_path_rate,
        azimuth_rate,
        bank_rate,
    )
