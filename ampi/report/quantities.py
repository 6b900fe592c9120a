"""The quantities on the axes, each with its conversion from SI and radians to what is printed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREES = float(np.degrees(1.0))  # per radian
KILO = 1e-3
MEGA = 1e-6


@dataclass(frozen=True)
class Quantity:
    """A name, the unit it is printed in, and the factor from SI to that unit."""

    name: str
    unit: str
    per_si: float

    @property
    def label(self) -> str:
        """Axis label."""
        return f"{self.name} ({self.unit})"

    def error_label(self) -> str:
        """Axis label of a deviation from the reference."""
        return f"{self.name} error ({self.unit})"

    def shown(self, values: Array) -> Array:
        """`values` (SI, rad) in the printed unit."""
        return np.asarray(values * self.per_si)


def load_factor(gravity: float) -> Quantity:
    """The load factor in units of `gravity` (m/s²), which is the planet's or the mission's own."""
    return Quantity("Load factor", f"g₀ = {gravity:.4g} m/s²", 1.0)


def use_of(limit: str) -> Quantity:
    """The use of a limit: 1 where it is reached."""
    return Quantity(f"{limit.replace('_', ' ').capitalize()}, use", "–", 1.0)


TIME = Quantity("Time since entry interface", "s", 1.0)
ALTITUDE = Quantity("Altitude", "km", KILO)
LONGITUDE = Quantity("Longitude", "deg", DEGREES)
LATITUDE = Quantity("Latitude", "deg", DEGREES)
SPEED = Quantity("Speed", "m/s", 1.0)
FLIGHT_PATH_ANGLE = Quantity("Flight-path angle", "deg", DEGREES)
AZIMUTH = Quantity("Azimuth", "deg", DEGREES)
BANK_ANGLE = Quantity("Bank angle", "deg", DEGREES)
BANK_RATE = Quantity("Bank rate", "deg/s", DEGREES)
ANGLE_OF_ATTACK = Quantity("Angle of attack", "deg", DEGREES)
ANGLE_OF_ATTACK_RATE = Quantity("Angle-of-attack rate", "deg/s", DEGREES)

ENTRY_QUANTITIES = (ALTITUDE, LONGITUDE, LATITUDE, SPEED, FLIGHT_PATH_ANGLE, AZIMUTH)
CONTROL_QUANTITIES = (ANGLE_OF_ATTACK, BANK_ANGLE, BANK_RATE)
DYNAMIC_PRESSURE = Quantity("Dynamic pressure", "kPa", KILO)
HEAT_FLUX = Quantity("Heat flux", "MW/m²", MEGA)
EAST = Quantity("East of target", "km", KILO)
NORTH = Quantity("North of target", "km", KILO)
CROSSRANGE = Quantity("Crossrange", "km", KILO)
DOWNRANGE = Quantity("Downrange", "km", KILO)
