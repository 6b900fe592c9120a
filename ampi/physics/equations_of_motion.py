"""Equations of motion over a rotating planet, Sagliano et al. 2016, Eq. (2).

    state    x = (h, θ, φ, V, γ, ψ, σ): altitude, longitude, latitude, planet-relative speed,
             flight-path angle, azimuth (0 = north, clockwise), bank angle
    control  u = σ̇

A vehicle without a schedule of the angle of attack has an eighth state α and a second control α̇.

The paper's air moves with the planet; here it may also blow (wind). The bank angle is about the velocity
through the air.

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
from ampi.physics.state import ALTITUDE, ANGLE_OF_ATTACK, BANK, LATITUDE, N_STATES, SPEED
from ampi.physics.vehicle import AirLoads, Vehicle, air_loads_at_angle
from ampi.physics.wind import AirVelocity, Track, Wind


@dataclass(frozen=True)
class FlightModel:
    """Everything the right-hand side depends on besides state, control and time.

    The air loads follow from the speed through the air; the angle-of-attack schedule from the speed over
    the ground, which is what a vehicle without air data knows.
    """

    planet: Planet
    atmosphere: Atmosphere
    vehicle: Vehicle
    wind: Wind | None = None  # None: still air
    angle_of_attack_offset: Any = None  # rad, on the schedule's angle; None: flown as it stands

    @property
    def n_states(self) -> int:
        """Seven, or eight where the angle of attack is one of them."""
        return N_STATES + int(self.vehicle.angle_of_attack is None)

    def air_loads(self, state: Any, time: Any) -> AirLoads:
        """Lift and drag (m/s²), density, angle of attack and speed through the air at a state."""
        if self.wind is None:
            return self._air_loads(state, time, state[SPEED])
        through_air = AirVelocity.of(self.wind, state, Track.of(state))
        return self._air_loads(state, time, through_air.speed)

    def angle_of_attack(self, state: Any, time: Any) -> Any:
        """α (rad) at a state: the scheduled one, or the state's own. Without the offset."""
        schedule = self.vehicle.angle_of_attack
        return state[ANGLE_OF_ATTACK] if schedule is None else schedule(time, state[SPEED])

    def _air_loads(self, state: Any, time: Any, speed: Any) -> AirLoads:
        angle = self.angle_of_attack(state, time)
        if self.angle_of_attack_offset is not None:
            angle = angle + self.angle_of_attack_offset
        return air_loads_at_angle(self.vehicle, self.atmosphere, state[ALTITUDE], speed, angle)


def aerodynamic_acceleration(model: FlightModel, state: Any, time: Any) -> tuple[Any, Any, Any]:
    """What an ideal accelerometer senses (m/s²): the air's acceleration of the vehicle.

    Components along the velocity over the ground, normal to it in the vertical plane and upwards, and
    horizontally to its right; in still air (−D, L cos σ, L sin σ). Arguments of `equations_of_motion`.
    """
    return _acceleration(model, state, time, Track.of(state), None)


def _acceleration(
    model: FlightModel, state: Any, time: Any, track: Track, air: AirLoads | None
) -> tuple[Any, Any, Any]:
    if model.wind is None:
        air = air or model._air_loads(state, time, state[SPEED])
        return -air.drag, air.lift * np.cos(state[BANK]), air.lift * np.sin(state[BANK])
    through_air = AirVelocity.of(model.wind, state, track)
    air = air or model._air_loads(state, time, through_air.speed)
    lift_up, lift_right = air.lift * np.cos(state[BANK]), air.lift * np.sin(state[BANK])
    return through_air.along_the_track(air.drag, lift_up, lift_right, track)


def equations_of_motion(
    model: FlightModel,
    state: Any,
    bank_rate: Any,
    time: Any,
    air: AirLoads | None = None,
    *,
    angle_of_attack_rate: Any = 0.0,
) -> tuple[Any, ...]:
    """Time derivatives of the seven states, Eq. (2); of eight where the angle of attack is one.

    Parameters
    ----------
    model
        Planet, atmosphere, vehicle and wind.
    state
        Sequence of `model.n_states` floats, equally shaped arrays, or symbols (SI, rad).
    bank_rate, angle_of_attack_rate
        σ̇ and, where the angle of attack is a state, α̇ (rad/s).
    time
        Time since the entry interface (s); the angle of attack may depend on it.
    air
        `model.air_loads` there, if they are known.
    """
    altitude, latitude, speed = state[ALTITUDE], state[LATITUDE], state[SPEED]
    radius = model.planet.equatorial_radius + altitude
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    track = Track.of(state)
    sin_fpa, cos_fpa, sin_azi, cos_azi = track.sin_fpa, track.cos_fpa, track.sin_azi, track.cos_azi
    tan_fpa, tan_lat = sin_fpa / cos_fpa, sin_lat / cos_lat

    along, up, right = _acceleration(model, state, time, track, air)
    g = gravity(model.planet, radius, latitude)
    omega = model.planet.rotation_rate
    centrifugal = omega * omega * radius * cos_lat

    altitude_rate = speed * sin_fpa
    longitude_rate = speed * cos_fpa * sin_azi / (radius * cos_lat)
    latitude_rate = speed * cos_fpa * cos_azi / radius
    speed_rate = (
        along - g * sin_fpa + centrifugal * (sin_fpa * cos_lat - cos_fpa * sin_lat * cos_azi)
    )
    flight_path_rate = (
        up / speed
        + (speed / radius - g / speed) * cos_fpa
        + 2.0 * omega * cos_lat * sin_azi
        + centrifugal / speed * (cos_fpa * cos_lat + sin_fpa * sin_lat * cos_azi)
    )
    azimuth_rate = (
        right / (speed * cos_fpa)
        + speed / radius * cos_fpa * sin_azi * tan_lat
        - 2.0 * omega * (tan_fpa * cos_lat * cos_azi - sin_lat)
        + centrifugal / (speed * cos_fpa) * sin_lat * sin_azi
    )
    angles: tuple[Any, ...] = (bank_rate,)
    if model.vehicle.angle_of_attack is None:
        angles = (bank_rate, angle_of_attack_rate)
    position = (altitude_rate, longitude_rate, latitude_rate)
    return (*position, speed_rate, flight_path_rate, azimuth_rate, *angles)
