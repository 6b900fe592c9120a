"""What a world file may say: how the entry is drawn, then a table for each section of the catalogue."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime, timedelta
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter, field_validator, model_validator

from ampi.missions import units as u
from ampi.missions.units import Number, Section, key_given
from ampi.physics.angles import TURN
from ampi.simulation.distributions import (
    KnownKeys,
    Law,
    NumericLaw,
    TableColumn,
    law_as_written,
    unknown_name,
)
from ampi.simulation.nrlmsis import NrlmsisConditions
from ampi.simulation.uncertainties import BY_NAME, CATALOGUE, SECTIONS, Uncertainty

DAY = "%Y-%m-%d"
WITH_PROFILE = ("density", "wind")  # may name a table over altitude
Month = Annotated[int, Field(strict=True, ge=1, le=12)]
AnyLaw = NumericLaw | TableColumn
LAW: TypeAdapter[NumericLaw] = TypeAdapter(NumericLaw)


class EntryDraws(KnownKeys):
    """How the parameters p of the mission are drawn: offsets over the extent of its grid, Eq. (34).

    `normal` is about the nominal p with 3σ at the farther end of each axis, so on a lopsided axis some
    draws lie beyond the nearer end; `uniform` fills the box of the grid, `corners` are its vertices.
    """

    distribution: Literal["normal", "uniform", "corners", "none"] = Field(
        description="Of the mission's parameters over the extent of its grid"
    )
    scale: Number = Field(default=1.0, gt=0, description="On the extent of the grid")
    offsets: Mapping[str, Law] = Field(
        default={},
        description="Distributions of single numbers of the mission, by key and in its unit, in the "
        "place of the grid's",
    )

    @field_validator("offsets", mode="before")
    @classmethod
    def _keys_with_dots(cls, value: Any) -> Any:
        return dict(_laws_below(value)) if isinstance(value, dict) else value

    def law(self, ends: tuple[float, float]) -> NumericLaw:
        """Of an axis of the grid from its first to its last offset."""
        low, high = (self.scale * end for end in ends)
        law: dict[str, dict[str, Any]] = {
            "normal": {"distribution": "normal", "three_sigma": max(-low, high)},
            "uniform": {"distribution": "uniform", "low": low, "high": high},
            "corners": {"distribution": "discrete", "values": (low, high)},
            "none": {"distribution": "constant", "value": 0.0},
        }
        return LAW.validate_python(law[self.distribution])

    def as_written(self) -> dict[str, Any]:
        """The table of a world file."""
        offsets = {key: law_as_written(law) for key, law in self.offsets.items()}
        written = {**super().as_written(), "offsets": offsets}
        return {name: value for name, value in written.items() if value != {}}


def _laws_below(table: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted key and law: `target.longitude_deg` quoted or not, TOML allows both."""
    for key, value in table.items():
        if isinstance(value, dict) and value and all(isinstance(v, dict) for v in value.values()):
            yield from _laws_below(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value


class DrawsSection(KnownKeys):
    """A table whose rows are profiles of density and wind, each flight one of them, all alike."""

    table: str = Field(
        description="CSV, a profile in each row: density_<z>km, wind_east_<z>km, wind_north_<z>km",
        examples=["draws.csv"],
    )
    months: tuple[Month, ...] | None = Field(
        default=None,
        description="Only rows of these, 1 to 12, by the column day_of_year",
        examples=[[1, 2, 12]],
    )

    @field_validator("months")
    @classmethod
    def _some_months(cls, value: tuple[int, ...] | None) -> tuple[int, ...] | None:
        if value == ():
            raise ValueError("expected one or more months, 1 to 12")
        return value


class NrlmsisSection(Section):
    """The air of a day and a place by NRLMSIS 2.1, the same for every flight (`nrlmsis`)."""

    date: str = Field(description="Day, YYYY-MM-DD", examples=["2026-01-15"])
    hour: Number = Field(default=12.0, ge=0, lt=24, description="Of the day, UTC")
    latitude: u.Angle = Field(
        ge=-0.5 * np.pi, le=0.5 * np.pi, description="Of the place, north positive"
    )
    longitude: u.CircularAngle = Field(
        ge=-2 * TURN, le=2 * TURN, description="Of the place, east positive"
    )
    f107: Number = Field(
        default=150.0, ge=50, le=1e3, description="F10.7 of the day before (1e-22 W/(m² Hz))"
    )
    f107_average: Number = Field(
        default=150.0, ge=50, le=1e3, description="F10.7 over 81 days (1e-22 W/(m² Hz))"
    )
    ap: Number = Field(default=4.0, ge=0, le=1e3, description="Geomagnetic index Ap")

    @field_validator("date")
    @classmethod
    def _is_a_day(cls, value: str) -> str:
        try:
            datetime.strptime(value, DAY)
        except ValueError:
            raise ValueError("expected a day as YYYY-MM-DD") from None
        return value

    @property
    def conditions(self) -> NrlmsisConditions:
        """What NRLMSIS is asked."""
        return NrlmsisConditions(
            time=datetime.strptime(self.date, DAY) + timedelta(hours=self.hour),
            latitude=self.latitude,
            longitude=self.longitude,
            f107=self.f107,
            f107_average=self.f107_average,
            ap=self.ap,
        )


class CorrelationSection(KnownKeys):
    """The correlation of each pair of some uncertainties, as if they were normal."""

    of: tuple[str, ...] = Field(
        min_length=2,
        description="Names of uncertainties",
        examples=[["lift_factor", "drag_factor"]],
    )
    value: Number = Field(ge=-1, le=1, description="Correlation of each pair of them")

    @field_validator("of")
    @classmethod
    def _names_are_of_the_catalogue(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [unknown_name(name, BY_NAME) for name in value if name not in BY_NAME]
        if len(set(value)) < len(value):
            unknown.append(f"expected different uncertainties, got {', '.join(value)}")
        if unknown:
            raise ValueError("\n".join(unknown))
        return value


class WorldSections(Section):
    """All that a world file says, each section by itself."""

    name: str = Field(pattern=r"^[a-z0-9_]+$", description="Small letters, digits and _")
    title: str = Field(pattern=r"^[^\x00-\x1f]*$", description="One line, as reports print it")
    entry: EntryDraws = Field(description="How the entry is drawn")
    profiles: Mapping[str, str] = {}  # section → CSV file over altitude
    laws: Mapping[str, Mapping[str, Law]] = {}  # section → key with unit → distribution
    draws: DrawsSection | None = Field(
        default=None, description="Each flight in the air of one row of a table"
    )
    nrlmsis: NrlmsisSection | None = Field(
        default=None,
        description="The air of a day and a place by NRLMSIS 2.1 (pip install 'ampi[atmosphere]')",
    )
    correlation: tuple[CorrelationSection, ...] = Field(
        default=(), description="Correlations of uncertainties, as if they were normal"
    )

    @model_validator(mode="before")
    @classmethod
    def _sections_of_the_catalogue(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        own = ("name", "title", "entry", "draws", "nrlmsis", "correlation")
        faults = [unknown_name(k, (*own, *SECTIONS)) for k in data if k not in (*own, *SECTIONS)]
        laws: dict[str, dict[str, Any]] = {}
        profiles: dict[str, Any] = {}
        for section in SECTIONS:
            table = data.get(section, {})
            if not isinstance(table, dict):
                faults.append(f"{section}: expected a table, got {table!r}")
                continue
            given = dict(table)
            if section in WITH_PROFILE and "table" in given:
                profiles[section] = given.pop("table")
            faults += [f"{section}.{fault}" for fault in _faults_of_keys(section, given)]
            laws[section] = given
        if faults:
            raise ValueError("\n".join(faults))
        kept = {key: value for key, value in data.items() if key in own}
        return {**kept, "profiles": profiles, "laws": laws}

    def law_of(self, uncertainty: Uncertainty) -> tuple[str, AnyLaw] | None:
        """Key and distribution of an uncertainty; None if the file does not say."""
        given = self.laws.get(uncertainty.section, {})
        return next(((key, given[key]) for key in uncertainty.keys if key in given), None)

    @property
    def files(self) -> tuple[str, ...]:
        """The CSV files that it names, each once."""
        laws = [law for given in self.laws.values() for law in given.values()]
        laws += list(self.entry.offsets.values())
        named = [law.file for law in laws if isinstance(law, TableColumn)]
        named += list(self.profiles.values())
        named += [] if self.draws is None else [self.draws.table]
        return tuple(dict.fromkeys(named))

    def as_written(self) -> dict[str, Any]:
        """The world file."""
        written = super().as_written()
        for name in ("laws", "profiles"):
            written.pop(name, None)
        for section in SECTIONS:
            given = self.laws.get(section, {})
            table: dict[str, Any] = {key: law_as_written(law) for key, law in given.items()}
            if section in self.profiles:
                table["table"] = self.profiles[section]
            if table:
                written[section] = table
        return written


def _faults_of_keys(section: str, given: Mapping[str, Any]) -> list[str]:
    """A sentence for each key that no uncertainty of the section has, or that it has twice."""
    here = [uncertainty for uncertainty in CATALOGUE if uncertainty.section == section]
    faults, bare = [], {u.key for u in here if u.dimension is not None}
    for uncertainty in here:
        if uncertainty.dimension is not None:
            try:
                key_given(uncertainty.key, uncertainty.dimension, given)
            except ValueError as error:
                faults.append(str(error))
    known = [key for uncertainty in here for key in uncertainty.keys]
    known += ["table"] * (section in WITH_PROFILE)
    faults += [unknown_name(key, known) for key in given if key not in {*known, *bare}]
    return faults
