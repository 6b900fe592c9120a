"""What differed from flight to flight of a campaign, each number in a unit that is printed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.parameters import Parameter
from ampi.missions.units import UNITS
from ampi.report.quantities import KILO
from ampi.report.scheme_groups import words
from ampi.simulation.flights import DENSITY, WIND, Flights
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.uncertainties import CATALOGUE, Uncertainty

Array = NDArray[np.float64]

PRINTED = {"angle": "deg"}  # dimension → unit; of the others the SI unit
BAND = (
    30e3,
    60e3,
)  # m [X]: where an entry loses its speed; profiles are known by their means there


@dataclass(frozen=True, eq=False)
class Dispersed:
    """One number of each flight."""

    key: str  # with the unit, as a mission or a world file has it
    words: str  # without
    values: Array  # (n,), in that unit; of a parameter its offset from the nominal
    on_axis: NDArray[np.bool_] | None = None  # (n,), within the axis of the grid; None: it has none

    @property
    def varies(self) -> bool:
        """Whether two flights differ in it."""
        finite = self.values[np.isfinite(self.values)]
        return len(finite) > 0 and float(np.ptp(finite)) > 0.0


def dispersed(mission: Mission, flights: Flights) -> tuple[Dispersed, ...]:
    """Every parameter of the mission, and what else varies in the world of the flights."""
    others = [_uncertainty(u, flights.numbers[:, j]) for j, u in enumerate(CATALOGUE)]
    return (
        *(_parameter(p, flights.parameters[:, i]) for i, p in enumerate(mission.parameters)),
        *(one for one in others if one.varies),
        *_profiles(flights),
    )


def _parameter(parameter: Parameter, values: Array) -> Dispersed:
    own = parameter.number
    offsets = (values - own.nominal) / own.per_unit
    inside = (offsets >= parameter.offsets[0]) & (offsets <= parameter.offsets[-1])
    return Dispersed(parameter.key, words(".".join(own.path)), offsets, inside)


def _uncertainty(uncertainty: Uncertainty, values: Array) -> Dispersed:
    name, dimension = uncertainty.name, uncertainty.dimension
    if dimension is None:
        return Dispersed(name, words(name), values)
    unit = PRINTED.get(dimension, next(iter(UNITS[dimension])))
    return Dispersed(f"{name}_{unit}", words(name), values / UNITS[dimension][unit])


def _profiles(flights: Flights) -> tuple[Dispersed, ...]:
    """Means of the profiles over `BAND`, where the world has them."""
    low, high = BAND
    band = (low <= ALTITUDES) & (high >= ALTITUDES)
    where = f"{low * KILO:g} to {high * KILO:g} km"
    means: dict[str, Array] = {}
    if DENSITY in flights.profiles.split():
        means["density_profile"] = flights.density[()][:, band].mean(axis=1)
    if WIND in flights.profiles.split():
        wind = flights.wind[()][..., band].mean(axis=-1)
        means |= {"wind_profile_east_m_per_s": wind[:, 0], "wind_profile_north_m_per_s": wind[:, 1]}
    found = (
        Dispersed(f"{key}, {where}", f"{words(key.removesuffix('_m_per_s'))}, {where}", values)
        for key, values in means.items()
    )
    return tuple(one for one in found if one.varies)
