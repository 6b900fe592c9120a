"""The world that guidance must prove itself in: what may be true, drawn flight by flight.

    uniform numbers (n, m) → copula → inverse distributions → numbers, profiles, seeds: a `Truth`

Every step is a function of the uniform numbers, elementwise over the flights: a flight is the same to
the bit alone and in company, and a design of experiments may bring uniform numbers of its own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.missions.mission import Mission
from ampi.missions.text import toml_text
from ampi.physics.atmosphere import StandardAtmosphere1976
from ampi.simulation.air_tables import (
    NRLMSIS,
    AirTable,
    density_of,
    density_over_altitude,
    drawn_air,
    in_months,
    wind_of,
    wind_over_altitude,
)
from ampi.simulation.copula import Copula
from ampi.simulation.csv_table import CsvTable, rows_of
from ampi.simulation.distributions import LEAST
from ampi.simulation.drawn import Drawn, Place, drawn_of_catalogue, drawn_of_mission
from ampi.simulation.profiles import ALTITUDES, density_noise, wind_noise
from ampi.simulation.truth import Truth
from ampi.simulation.uncertainties import SENSOR_NOISE
from ampi.simulation.uniform_numbers import seeds_of, uniform_numbers
from ampi.simulation.world_sections import WorldSections

Array = NDArray[np.float64]

DENSITY_PROFILE, WIND_PROFILE = "density profile", "wind profile"
SENSOR_SEED = "sensor noise"


class WorldError(ValueError):
    """A world, or a world file, that cannot be used; the message names every fault."""


@dataclass(frozen=True, eq=False)
class World:
    """What a world file says, and the tables that it names; load one with `load_world`."""

    sections: WorldSections
    tables: Mapping[str, CsvTable]  # as read, by the name in the world file

    def __post_init__(self) -> None:
        faults = dict[
            str, None
        ]()  # each once: the copula asks the catalogue, and all ask the tables
        for part in ("_kept_tables", "_catalogue", "_air", "_copula"):
            try:
                getattr(self, part)
            except ValueError as error:
                faults[str(error)] = None
        if faults:
            raise WorldError("\n".join(faults))

    @property
    def name(self) -> str:
        """Its name, as in its file."""
        return self.sections.name

    @property
    def title(self) -> str:
        """Its title, as in its file."""
        return self.sections.title

    @property
    def profiles(self) -> tuple[str, ...]:
        """Which profiles over altitude every `truth` has: "density", "wind", both or none."""
        winds = ("wind_east", "wind_north", "wind_noise")
        density = any(air.log_density is not None for air in self._air)
        wind = any(air.wind is not None for air in self._air)
        has = {
            "density": density or self._varies("density_noise"),
            "wind": wind or self._varies(*winds),
        }
        return tuple(name for name, is_there in has.items() if is_there)

    @cached_property
    def toml(self) -> str:
        """Its text: with the tables that it names, the same world."""
        return toml_text(self.sections.as_written())

    @cached_property
    def digest(self) -> str:
        """SHA-256 of its text and of the numbers in its tables."""
        found = hashlib.sha256(self.toml.encode())
        for file, table in sorted(self.tables.items()):
            found.update(f"{file}: {','.join(table.columns)}\n".encode())
            found.update(table.values.astype("<f8").tobytes())
        return found.hexdigest()

    def checked(self, mission: Mission) -> World:
        """This world, if the mission can be flown in it.

        Raises
        ------
        WorldError
            If it draws what is no parameter of the mission, or what the mission cannot be, or a table
            does not reach from the target to the entry altitude.
        """
        _ = self._parameters(mission)
        low, high = mission.target.altitude, mission.entry.altitude
        short = [air for air in self._air if air.lowest > low or air.highest < high]
        if short:
            raise WorldError(
                f"{self.name}: {short[0].file}: expected altitudes from the target's, {low / 1e3:g} km, "
                f"to the entry altitude, {high / 1e3:g} km, got {short[0].lowest / 1e3:g} to "
                f"{short[0].highest / 1e3:g} km"
            )
        return self

    def inputs(self, mission: Mission) -> tuple[str, ...]:
        """Names of the uniform numbers that a flight is made from, in order."""
        return tuple(self._places(self._parameters(mission)))

    def dimension(self, mission: Mission) -> int:
        """How many uniform numbers a flight is made from."""
        return len(self.inputs(mission))

    def uniforms(
        self, mission: Mission, n: int, seed: int, pool: str = "reported", first: int = 0
    ) -> Array:
        """Uniform numbers (n, m) of flights first … first + n − 1 of a pool, "reported" or "tuning"."""
        places = list(self._places(self._parameters(mission)).values())
        return uniform_numbers(places, n, seed=seed, pool=pool, first=first)

    def draw(
        self, mission: Mission, n: int, seed: int, pool: str = "reported", first: int = 0
    ) -> Truth:
        """What is true of flights first … first + n − 1 of a pool, "reported" or "tuning"."""
        return self.truth(mission, self.uniforms(mission, n, seed, pool, first))

    def truth(self, mission: Mission, uniforms: ArrayLike) -> Truth:
        """What is true of n flights, made from uniform numbers (n, m) in the order of `inputs`.

        Numbers of a design that are 0 or 1 are taken at the middle of the outermost cell.
        """
        parameters = self.checked(mission)._parameters(mission)
        given, names = np.asarray(uniforms, dtype=float), tuple(self._places(parameters))
        if given.ndim != 2 or given.shape[1] != len(names):
            raise ValueError(f"uniforms: expected shape (n, {len(names)}), got {given.shape}")
        if not np.all((given >= 0.0) & (given <= 1.0)):  # NaN too
            raise ValueError("uniforms: expected numbers from 0 to 1")
        given = np.clip(given, LEAST, 1.0 - LEAST)
        columns = {name: np.ascontiguousarray(given[:, i]) for i, name in enumerate(names)}
        columns = self._copula.correlate(columns)
        unread = np.full(len(given), 0.5)  # of what is no input

        def values(drawn: Drawn) -> Array:
            return drawn.values(unread if drawn.input is None else columns[drawn.input])

        numbers = {drawn.name: values(drawn) for drawn in self._catalogue}
        return Truth(
            np.column_stack([np.empty((len(given), 0)), *map(values, parameters)]),
            numbers,
            ALTITUDES,
            self._density(numbers, columns, mission),
            self._wind(numbers, columns),
            seeds_of(columns.get(SENSOR_SEED, unread)),
        )

    def in_words(self, mission: Mission) -> list[str]:
        """What is not nominal, a line each, in the units of the files."""
        lines = [
            f"{d.name}: {d.in_words()}"
            for d in (*self._parameters(mission), *self._catalogue)
            if not d.is_nominal
        ]
        for section, file in self.sections.profiles.items():
            lines.append(f"{section}: over altitude from {file}")
        draws = self.sections.draws
        if draws is not None:
            rows = self._kept_tables[draws.table].values.shape[0]
            months = f", months {', '.join(map(str, draws.months))}" if draws.months else ""
            lines.append(f"air: one of {rows} rows of {draws.table}{months}")
        msis = self.sections.nrlmsis
        if msis is not None:
            lines.append(
                f"air: NRLMSIS of {msis.date}, {msis.hour:g} h UTC, F10.7 {msis.f107:g}, Ap {msis.ap:g}"
            )
        for pair in self.sections.correlation:
            lines.append(f"correlation of {' and '.join(pair.of)}: {pair.value:g}")
        return lines

    @cached_property
    def _kept_tables(self) -> dict[str, CsvTable]:
        """The tables with the rows that may be drawn: of the months wanted."""
        draws, kept = self.sections.draws, dict(self.tables)
        if draws is not None and draws.months is not None:
            kept[draws.table] = in_months(kept[draws.table], draws.months)
        return kept

    @cached_property
    def _catalogue(self) -> tuple[Drawn, ...]:
        return drawn_of_catalogue(self.sections, self._kept_tables)

    def _parameters(self, mission: Mission) -> tuple[Drawn, ...]:
        try:
            return drawn_of_mission(self.sections.entry, mission, self._kept_tables)
        except ValueError as error:
            raise WorldError(f"{self.name}: {error}") from None

    @cached_property
    def _air(self) -> tuple[AirTable, ...]:
        read = {"density": density_over_altitude, "wind": wind_over_altitude}
        found = [
            read[section](self._kept_tables[file])
            for section, file in self.sections.profiles.items()
        ]
        if self.sections.draws is not None:
            found.append(drawn_air(self._kept_tables[self.sections.draws.table]))
        if self.sections.nrlmsis is not None:
            found.append(drawn_air(self._kept_tables[NRLMSIS]))
        return tuple(found)

    @cached_property
    def _copula(self) -> Copula:
        pairs: dict[frozenset[str], float] = {}
        drawn = {d.name for d in self._catalogue if d.input == d.name}
        for section in self.sections.correlation:
            for missing in [name for name in section.of if name not in drawn]:
                raise ValueError(
                    "correlation: expected uncertainties that this world draws by a law of their own "
                    f"({', '.join(sorted(drawn)) or 'it has none'}), got {missing}"
                )
            for pair in map(frozenset, combinations(section.of, 2)):
                if pair in pairs:
                    raise ValueError(
                        f"correlation: {' and '.join(sorted(pair))} have one already; remove one"
                    )
                pairs[pair] = section.value
        names = {name for pair in pairs for name in pair}
        return Copula.of(tuple(d.name for d in self._catalogue if d.name in names), pairs)

    def _places(self, parameters: tuple[Drawn, ...]) -> dict[str, int]:
        """The uniform numbers of a flight: name → place in its stream."""
        places: dict[str, int] = {}
        for drawn in (*parameters, *self._catalogue):
            if drawn.input is not None:
                places.setdefault(drawn.input, drawn.place)
        if self.sections.draws is not None:
            places[rows_of(self.sections.draws.table)] = Place.ROW_OF_DRAWS
        if self._varies("density_noise"):
            places[DENSITY_PROFILE] = Place.DENSITY_PROFILE
        if self._varies("wind_noise"):
            places[WIND_PROFILE] = Place.WIND_PROFILE
        if self._varies(*SENSOR_NOISE):
            places[SENSOR_SEED] = Place.SENSOR_SEED
        return places

    def _varies(self, *names: str) -> bool:
        return any(d.name in names and not d.is_nominal for d in self._catalogue)

    def _density(
        self, numbers: Mapping[str, Array], columns: Mapping[str, Array], mission: Mission
    ) -> Array | None:
        """Factor on the mission's density (n, k); None if nothing varies it over altitude."""
        density = density_of(self._air, columns, len(numbers["density_factor"]))
        of_the_air = self.sections.draws is not None or self.sections.nrlmsis is not None
        if density is not None and of_the_air:
            own = mission.flight_model.atmosphere.density(ALTITUDES)
            factor = mission.atmosphere.density_factor
            density = density * (StandardAtmosphere1976().density(ALTITUDES) * factor / own)
        if DENSITY_PROFILE not in columns:
            return density
        noise = density_noise(
            columns[DENSITY_PROFILE], numbers["density_noise"], numbers["density_noise_length"]
        )
        return noise if density is None else density * noise

    def _wind(self, numbers: Mapping[str, Array], columns: Mapping[str, Array]) -> Array | None:
        """East and north (2, n, k), m/s; None if there is no wind."""
        constant = np.stack([numbers["wind_east"], numbers["wind_north"]])[..., None]
        profiles = wind_of(self._air, columns, constant.shape[1])
        if "wind" not in self.profiles:
            return None
        wind = np.repeat(constant, len(ALTITUDES), axis=-1)
        if profiles is not None:
            wind = wind + profiles
        if WIND_PROFILE in columns:
            wind = wind + wind_noise(
                columns[WIND_PROFILE], numbers["wind_noise"], numbers["wind_noise_length"]
            )
        return wind
