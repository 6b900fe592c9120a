"""Numbers of the truth and the laws that they are drawn from: of the catalogue, and of the mission."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.parameters import (
    MOST_DIMENSIONS,
    MissionNumber,
    mission_numbers,
    with_numbers,
)
from ampi.missions.units import symbol
from ampi.simulation.csv_table import CsvTable, rows_of
from ampi.simulation.distributions import (
    SMALLEST_SHARE,
    Constant,
    NumericLaw,
    TableColumn,
    Truncated,
)
from ampi.simulation.uncertainties import CATALOGUE, Uncertainty
from ampi.simulation.world_sections import AnyLaw, EntryDraws, WorldSections

Array = NDArray[np.float64]


class Place(IntEnum):
    """Of an input in the stream of a flight; the parameters of the mission stand before these."""

    DENSITY_PROFILE = MOST_DIMENSIONS
    WIND_PROFILE = MOST_DIMENSIONS + 1
    SENSOR_SEED = MOST_DIMENSIONS + 2
    ROW_OF_DRAWS = MOST_DIMENSIONS + 3
    CATALOGUE = MOST_DIMENSIONS + 4  # the first of its uncertainties


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A number of the truth: base + per_unit · F⁻¹(u), F in the unit of its key."""

    name: str  # of the catalogue, or the path of a parameter of the mission: entry.speed
    place: int  # in the stream of uniform numbers
    law: NumericLaw
    unit: str = ""  # of the key, as it is printed after a number
    per_unit: float = 1.0  # SI per unit of the key
    nominal: float = 0.0  # in that unit: what a law without a mean is about
    base: float = 0.0  # SI
    file: str | None = None  # whose row the number comes from

    @property
    def input(self) -> str | None:
        """The uniform number that it is made from; None of a constant."""
        if self.file is not None:
            return rows_of(self.file)
        return None if isinstance(self.law, Constant) else self.name

    @property
    def is_nominal(self) -> bool:
        """Whether it is the nominal number in every flight."""
        return isinstance(self.law, Constant) and self.law.value == self.nominal

    def values(self, uniforms: Array) -> Array:
        """The numbers (n,), SI, of as many uniform numbers."""
        return np.asarray(self.base + self.per_unit * self.law.quantiles(uniforms, self.nominal))

    @property
    def ends(self) -> tuple[float, float]:
        """Least and greatest, SI, that may be drawn."""
        low, high = self.law.ends(self.nominal)
        return self.base + self.per_unit * low, self.base + self.per_unit * high

    def in_words(self) -> str:
        """What is drawn, in the unit of the file."""
        words = self.law.in_words(self.unit)
        return words if self.file is None else f"{words}, a row of {self.file}"


def drawn_of_catalogue(
    sections: WorldSections, tables: Mapping[str, CsvTable]
) -> tuple[Drawn, ...]:
    """Every uncertainty, in the order of the catalogue.

    Raises
    ------
    ValueError
        A sentence a line, of laws that draw what their uncertainty cannot be.
    """
    found, faults = [], list[str]()
    for place, uncertainty in enumerate(CATALOGUE, start=Place.CATALOGUE):
        key, law = sections.law_of(uncertainty) or _nominal(uncertainty)
        unit = key[len(uncertainty.key) + 1 :]
        per_unit = uncertainty.per_unit(key)
        try:
            drawn = Drawn(
                name=uncertainty.name,
                place=place,
                law=_numeric(law, tables),
                unit=f" {symbol(unit)}" if unit else "",
                per_unit=per_unit,
                nominal=uncertainty.nominal / per_unit,
                file=law.file if isinstance(law, TableColumn) else None,
            )
            _require_admitted(drawn, uncertainty)
        except ValueError as error:
            faults.append(f"{uncertainty.section}.{key}: {error}")
        else:
            found.append(drawn)
    if faults:
        raise ValueError("\n".join(faults))
    return tuple(found)


def drawn_of_mission(
    entry: EntryDraws, mission: Mission, tables: Mapping[str, CsvTable]
) -> tuple[Drawn, ...]:
    """The parameters of the mission, each an offset from its nominal number, in their order.

    Raises
    ------
    ValueError
        A sentence a line, of offsets of no parameter, or at which the mission could not be.
    """
    offsets = _offsets_by_name(entry, mission)
    found, faults = [], list[str]()
    for place, parameter in enumerate(mission.parameters):
        number, key = parameter.number, parameter.key
        law: AnyLaw = entry.law((parameter.offsets[0], parameter.offsets[-1]))
        if number.name in offsets:
            number, law = offsets[number.name]
            key = f"offsets.{number.key}"
        unit = number.key[len(number.name) + 1 :]
        try:
            drawn = Drawn(
                name=".".join(number.path),
                place=place,
                law=_numeric(law, tables),
                unit=f" {symbol(unit)}" if unit else "",
                per_unit=number.per_unit,
                base=number.nominal,
                file=law.file if isinstance(law, TableColumn) else None,
            )
            _require_reached(drawn)
            _require_possible(drawn, mission, number)
        except ValueError as error:
            faults.append(f"entry.{key}: {error}")
        else:
            found.append(drawn)
    if faults:
        raise ValueError("\n".join(faults))
    return tuple(found)


def _nominal(uncertainty: Uncertainty) -> tuple[str, AnyLaw]:
    return uncertainty.keys[0], Constant(distribution="constant", value=uncertainty.nominal)


def _numeric(law: AnyLaw, tables: Mapping[str, CsvTable]) -> NumericLaw:
    return law.of(tables[law.file]) if isinstance(law, TableColumn) else law


def _offsets_by_name(
    entry: EntryDraws, mission: Mission
) -> dict[str, tuple[MissionNumber, AnyLaw]]:
    """What stands in [entry.offsets], by the name of the parameter."""
    names = {parameter.name for parameter in mission.parameters}
    known = {n.key: n for n in mission_numbers(mission) if n.name in names}
    found: dict[str, tuple[MissionNumber, AnyLaw]] = {}
    for key, law in entry.offsets.items():
        number = known.get(key.removeprefix("entry."))
        if number is None:
            raise ValueError(
                f"entry.offsets: expected a parameter of the mission {mission.name} "
                f"({', '.join(p.key for p in mission.parameters) or 'it has none'}), got {key!r}, "
                "an uncertainty that the mission does not know"
            )
        if number.name in found:
            raise ValueError(
                f"entry.offsets.{key}: {number.name} is given already; remove one of them"
            )
        found[number.name] = number, law
    return found


def _require_reached(drawn: Drawn) -> None:
    law = drawn.law
    if isinstance(law, Truncated) and law.share(drawn.nominal) < SMALLEST_SHARE:
        raise ValueError(
            f"expected bounds that the normal law reaches, got {law.in_words(drawn.unit)}"
        )


def _require_admitted(drawn: Drawn, uncertainty: Uncertainty) -> None:
    _require_reached(drawn)
    if not uncertainty.admits(*drawn.ends):
        low, high = (end / drawn.per_unit for end in drawn.ends)
        reach = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        remedy = "" if low == high else '; distribution = "truncated" keeps to bounds'
        raise ValueError(f"expected numbers {uncertainty.bounds}, got {reach}{drawn.unit}{remedy}")


def _require_possible(drawn: Drawn, mission: Mission, number: MissionNumber) -> None:
    """Raise where the mission could not be at the ends of a law."""
    if drawn.is_nominal:
        return
    for end in drawn.ends:
        faults = number.faults(with_numbers(mission, [(number.path, end)]))
        if faults:
            offset = (end - drawn.base) / drawn.per_unit
            raise ValueError(
                "expected offsets that the mission can have, the least and the greatest one drawn too, "
                f"got {offset:.4g}{drawn.unit}, where {faults[0]}"
            )
