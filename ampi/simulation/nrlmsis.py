"""The air of a day and a place by NRLMSIS 2.1, through the optional package pymsis (`ampi[atmosphere]`).

Solar and geomagnetic activity are given and never looked up, so nothing is fetched and a result can be
had again. The speed of sound is √(κ R T) with the gas of the ground, R = 287.053 J/(kg K): above some
86 km the air is lighter, and faster by up to a tenth at 120 km; that is neglected.

References
----------
Emmert et al. (2021), "NRLMSIS 2.0: A Whole-Atmosphere Empirical Model of Temperature and Neutral Species
Densities", Earth and Space Science 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.physics.atmosphere import AIR_GAS_CONSTANT, SPECIFIC_HEAT_RATIO

Array = NDArray[np.float64]

VERSION = 2.1
METRES = 1e3  # per km, the unit of pymsis
DENSITY, TEMPERATURE = 0, 10  # its columns
AP_VALUES = 7  # the daily one, and a history that is read in a storm alone


@dataclass(frozen=True, kw_only=True)
class NrlmsisConditions:
    """When and where the air is asked for, and how active the Sun is."""

    time: datetime  # UTC
    latitude: float  # geodetic, rad
    longitude: float  # rad
    f107: float = 150.0  # solar radio flux at 10.7 cm of the day before, in 1e-22 W/(m² Hz)
    f107_average: float = 150.0  # over 81 days
    ap: float = 4.0  # geomagnetic activity of the day

    def __post_init__(self) -> None:
        if not abs(self.latitude) <= 0.5 * math.pi:
            raise ValueError(
                f"latitude: expected -90 to 90 deg, got {math.degrees(self.latitude):g} deg"
            )
        if not math.isfinite(self.longitude):
            raise ValueError(f"longitude: expected a finite number, got {self.longitude}")
        for name, least in (("f107", 50.0), ("f107_average", 50.0), ("ap", 0.0)):
            value = getattr(self, name)
            if not least <= value <= 1e3:
                raise ValueError(f"{name}: expected {least:g} to 1000, got {value:g}")


def nrlmsis_density(conditions: NrlmsisConditions, altitudes: Array) -> Array:
    """Density (k,) in kg/m³ at geometric `altitudes` (k,) in m, from 0 to 1,000 km.

    Raises
    ------
    ValueError
        If pymsis is not installed.
    """
    return _columns(conditions, altitudes)[:, DENSITY]


def nrlmsis_speed_of_sound(conditions: NrlmsisConditions, altitudes: Array) -> Array:
    """Speed of sound (k,) in m/s, of air as it is on the ground; else as `nrlmsis_density`."""
    temperature = _columns(conditions, altitudes)[:, TEMPERATURE]
    return np.sqrt(SPECIFIC_HEAT_RATIO * AIR_GAS_CONSTANT * temperature)


def _columns(conditions: NrlmsisConditions, altitudes: Array) -> Array:
    try:
        import pymsis
    except ImportError:
        raise ValueError(
            "NRLMSIS needs pymsis, which is not installed; try: pip install 'ampi[atmosphere]'"
        ) from None
    activity: dict[str, Any] = {
        "f107s": [conditions.f107],
        "f107as": [conditions.f107_average],
        "aps": [[conditions.ap] * AP_VALUES],
    }
    found = pymsis.calculate(
        np.datetime64(conditions.time),
        math.degrees(conditions.longitude),
        math.degrees(conditions.latitude),
        np.asarray(altitudes) / METRES,
        **activity,
        version=VERSION,
    )
    return np.asarray(found, dtype=float).reshape(len(altitudes), -1)
