"""What may differ between the truth and what guidance was told: one catalogue, one name each.

A world file has a table for each section of the catalogue and a key, with its unit, for each of its
uncertainties; `Truth.numbers` holds them all by name, in SI. A factor multiplies the number of the
mission, an error is added to it. Noise is given by its standard deviation; over altitude (density,
wind) it is a first-order Gauss–Markov process with a correlation length, see `profiles`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ampi.missions.units import UNITS, si_key, symbol

THE_MISSION = "the mission as it is"
CHANNELS = {  # of navigation → their dimension
    "north": "length",
    "east": "length",
    "altitude": "length",
    "speed": "speed",
    "flight_path_angle": "angle",
    "azimuth": "angle",
    "bank_angle": "angle",
}
AXES = {
    "along": "along the velocity",
    "up": "normal to it, upwards in the vertical plane",
    "right": "normal to both",
}


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """One number of the truth: where a world file has it, what it means, what it may be."""

    section: str  # table of a world file
    key: str  # in that table, without the unit
    nominal: float  # SI: of a world that does not say
    meaning: str
    dimension: str | None = None  # of `units.UNITS`; None: a plain number
    least: float = -math.inf  # SI
    greatest: float = math.inf  # SI
    positive: bool = False  # 0 is excluded
    source: str = THE_MISSION  # of the nominal number

    @property
    def name(self) -> str:
        """Its name in `Truth.numbers`: `wind_east`, `navigation_speed_bias`, `lift_factor`."""
        if self.section in ("aerodynamics", "vehicle"):
            return self.key
        return f"{self.section}_{self.key}"

    @property
    def unit(self) -> str:
        """SI unit as it is printed; "1" of a plain number."""
        return "1" if self.dimension is None else symbol(si_key(self.dimension))

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys, with units, that a world file may give it under."""
        if self.dimension is None:
            return (self.key,)
        return tuple(f"{self.key}_{unit}" for unit in UNITS[self.dimension])

    def per_unit(self, key: str) -> float:
        """SI per unit of `key`."""
        return 1.0 if self.dimension is None else UNITS[self.dimension][key[len(self.key) + 1 :]]

    def admits(self, least: float, greatest: float) -> bool:
        """Whether it may be all from `least` to `greatest` (SI)."""
        low = least > 0.0 if self.positive else least >= self.least
        return low and greatest <= self.greatest

    @property
    def bounds(self) -> str:
        """What `admits` wants, in words and SI."""
        if self.positive:
            return "greater than 0"
        unit = "" if self.dimension is None else f" {self.unit}"
        most = f" and at most {self.greatest:g}" if self.greatest < math.inf else ""
        return f"at least {self.least:g}{unit}{most}"


def _factor(section: str, key: str, meaning: str) -> Uncertainty:
    return Uncertainty(section=section, key=key, nominal=1.0, meaning=meaning, positive=True)


def _error(section: str, key: str, dimension: str, meaning: str) -> Uncertainty:
    return Uncertainty(section=section, key=key, nominal=0.0, meaning=meaning, dimension=dimension)


def _size(
    section: str, key: str, dimension: str | None, meaning: str, *, greatest: float = math.inf
) -> Uncertainty:
    return Uncertainty(
        section=section,
        key=key,
        nominal=0.0,
        meaning=meaning,
        dimension=dimension,
        least=0.0,
        greatest=greatest,
    )


def _noise_length(section: str, nominal: float) -> Uncertainty:
    return Uncertainty(
        section=section,
        key="noise_length",
        nominal=nominal,
        meaning="altitude over which the correlation of the noise falls to 1/e",
        dimension="length",
        least=1e3,  # the step of a profile
        source="[X] the vertical size of gravity waves",
    )


CATALOGUE: tuple[Uncertainty, ...] = (
    _factor("density", "factor", "on the density, at all altitudes"),
    _size("density", "noise", None, "relative standard deviation of the density over altitude"),
    _noise_length("density", 10e3),
    _factor("aerodynamics", "lift_factor", "on the lift coefficient"),
    _factor("aerodynamics", "drag_factor", "on the drag coefficient"),
    _factor("vehicle", "mass_factor", "on the mass"),
    _error("vehicle", "angle_of_attack_error", "angle", "flown beside the angle commanded"),
    _error("wind", "east", "speed", "wind towards the east, at all altitudes"),
    _error("wind", "north", "speed", "wind towards the north, at all altitudes"),
    _size("wind", "noise", "speed", "standard deviation of each component over altitude"),
    _noise_length("wind", 15e3),
    *(
        _error("navigation", f"{channel}_bias", dimension, "told less true, all flight long")
        for channel, dimension in CHANNELS.items()
    ),
    *(
        _size("navigation", f"{channel}_noise", dimension, "standard deviation of each sample")
        for channel, dimension in CHANNELS.items()
    ),
    _size("navigation", "dropout", None, "probability that a sample is missing", greatest=1.0),
    _size("navigation", "latency", "time", "age of a sample when guidance has it"),
    *(
        _error("accelerometer", f"{axis}_bias", "acceleration", f"told less true, {direction}")
        for axis, direction in AXES.items()
    ),
    _size("accelerometer", "noise", "acceleration", "standard deviation, each component"),
    Uncertainty(
        section="accelerometer", key="scale", nominal=0.0, meaning="relative error of the scale"
    ),
    _size("actuator", "lag", "time", "time constant of the bank angle, beside its limits"),
    _size("actuator", "delay", "time", "from the command to its effect"),
)
BY_NAME = {uncertainty.name: uncertainty for uncertainty in CATALOGUE}
SECTIONS = tuple(dict.fromkeys(uncertainty.section for uncertainty in CATALOGUE))
SENSOR_NOISE = tuple(
    name
    for name in BY_NAME
    if name.startswith(("navigation", "accelerometer")) and name.endswith(("_noise", "_dropout"))
)
