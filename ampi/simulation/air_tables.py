"""Tables of the air: density and wind over altitude, one profile, or one in each row to draw from.

A table over altitude has the columns altitude_m and factor (of [density]) or altitude_m, east_m_per_s
and north_m_per_s (of [wind]). A table of draws has a profile in each row: density_<z>km, the density
over US76's, and wind_east_<z>km, wind_north_<z>km (m/s) at altitudes z; columns that do not end in km
tell where a row is from. Draws are of the air itself: for a mission with air of its own they become
factors on that. Between altitudes wind and ln density are linear; beyond the ends they are constant.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.physics.atmosphere import StandardAtmosphere1976
from ampi.simulation.csv_table import CsvTable, rows_of
from ampi.simulation.distributions import rows_at
from ampi.simulation.nrlmsis import NrlmsisConditions, nrlmsis_density
from ampi.simulation.profiles import ALTITUDES, on_altitudes

Array = NDArray[np.float64]

LAST_DAYS = np.cumsum(
    [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 32]
)  # of the months; day 366 too
NRLMSIS = "NRLMSIS"  # in place of the name of a file
DRAWN_COLUMNS = ("density", "wind_east", "wind_north")


@dataclass(frozen=True, eq=False)
class AirTable:
    """r profiles over `ALTITUDES` of a table that reaches from `lowest` to `highest` (m)."""

    file: str
    lowest: float
    highest: float
    log_density: Array | None = None  # (r, k) of the factor; None: the table has no density
    wind: Array | None = None  # (2, r, k) m/s, east and north; None: it has no wind

    @property
    def rows(self) -> int:
        """Number of profiles."""
        one = self.log_density if self.wind is None else self.wind[0]
        return 0 if one is None else len(one)


def density_over_altitude(table: CsvTable) -> AirTable:
    """The one profile of a factor on the density."""
    altitudes = _increasing_altitudes(table)
    factor = _positive(table.file, table.column("factor"))
    log_density = on_altitudes(altitudes, np.log(factor)[None])
    return AirTable(table.file, altitudes[0], altitudes[-1], log_density=log_density)


def wind_over_altitude(table: CsvTable) -> AirTable:
    """The one profile of the wind."""
    altitudes = _increasing_altitudes(table)
    wind = np.stack([table.column(name) for name in ("east_m_per_s", "north_m_per_s")])
    wind = on_altitudes(altitudes, wind[:, None])
    return AirTable(table.file, altitudes[0], altitudes[-1], wind=wind)


def drawn_air(table: CsvTable) -> AirTable:
    """The profiles of a table of draws."""
    knots: dict[str, list[tuple[float, str]]] = {name: [] for name in DRAWN_COLUMNS}
    for column in table.columns:
        match = re.fullmatch(rf"({'|'.join(DRAWN_COLUMNS)})_(\d+(?:\.\d+)?)km", column)
        if match:
            knots[match[1]].append((1e3 * float(match[2]), column))
        elif column.endswith("km"):
            raise ValueError(
                f"{table.file}: expected density_<z>km, wind_east_<z>km or wind_north_<z>km, "
                f"got a column {column!r}"
            )
    given = [sorted(columns) for columns in knots.values() if columns]
    heights = {tuple(altitude for altitude, _ in columns) for columns in given}
    if len(heights) != 1 or bool(knots["wind_east"]) != bool(knots["wind_north"]):
        raise ValueError(
            f"{table.file}: expected density, wind_east and wind_north at the same altitudes, got "
            + "; ".join(f"{name} at {len(columns)}" for name, columns in knots.items())
        )
    altitudes = _increasing(table.file, np.array(heights.pop()))
    values = {
        name: np.stack([table.column(column) for _, column in sorted(columns)], axis=-1)
        for name, columns in knots.items()
        if columns
    }
    log_density = wind = None
    if "density" in values:
        density = _positive(table.file, values["density"])
        log_density = on_altitudes(altitudes, np.log(density))
    if "wind_east" in values:
        wind = on_altitudes(altitudes, np.stack([values[name] for name in DRAWN_COLUMNS[1:]]))
    return AirTable(table.file, altitudes[0], altitudes[-1], log_density, wind)


def nrlmsis_table(conditions: NrlmsisConditions) -> CsvTable:
    """The density of a day and a place over US76's, as the one row of a table of draws.

    Raises
    ------
    ValueError
        If pymsis is not installed.
    """
    ratio = nrlmsis_density(conditions, ALTITUDES) / StandardAtmosphere1976().density(ALTITUDES)
    columns = tuple(f"density_{altitude / 1e3:g}km" for altitude in ALTITUDES)
    return CsvTable(NRLMSIS, columns, ratio[None])


def density_of(tables: Iterable[AirTable], uniforms: Mapping[str, Array], n: int) -> Array | None:
    """Factor on the density (n, k), the product of all tables; None if none has a density."""
    logarithms = [
        air.log_density[_rows(air, uniforms, n)] for air in tables if air.log_density is not None
    ]
    return np.asarray(np.exp(sum(logarithms))) if logarithms else None


def wind_of(tables: Iterable[AirTable], uniforms: Mapping[str, Array], n: int) -> Array | None:
    """Wind (2, n, k), m/s, the sum of all tables; None if none has a wind."""
    winds = [air.wind[:, _rows(air, uniforms, n)] for air in tables if air.wind is not None]
    return np.asarray(sum(winds)) if winds else None


def _rows(air: AirTable, uniforms: Mapping[str, Array], n: int) -> NDArray[np.int64]:
    """The row of each flight."""
    return rows_at(uniforms.get(rows_of(air.file), np.zeros(n)), air.rows)


def in_months(table: CsvTable, months: tuple[int, ...]) -> CsvTable:
    """The rows of some months, by the column day_of_year (1 is the first of January).

    Raises
    ------
    ValueError
        If there is no such column, a day is none, or no row is left.
    """
    days = np.floor(table.column("day_of_year"))
    if np.any((days < 1) | (days > LAST_DAYS[-1])):
        raise ValueError(f"{table.file}: expected days of a year, 1 to 366, in day_of_year")
    kept = np.isin(1 + np.searchsorted(LAST_DAYS, days), months)
    if not kept.any():
        raise ValueError(
            f"{table.file}: expected rows of the months {', '.join(map(str, months))}, got none"
        )
    return table.rows(kept)


def _increasing_altitudes(table: CsvTable) -> Array:
    altitudes = table.column("altitude_m")
    falls = np.flatnonzero(np.diff(altitudes) <= 0.0)
    if len(falls) and table.lines:
        before, after = altitudes[falls[0]], altitudes[falls[0] + 1]
        raise ValueError(
            f"{table.file}: line {table.lines[falls[0] + 1]}, column altitude_m: expected more than "
            f"{before:g}, the number of the row before, got {after:g}"
        )
    return _increasing(table.file, altitudes)


def _increasing(file: str, altitudes: Array) -> Array:
    if len(altitudes) < 2 or np.any(np.diff(altitudes) <= 0.0):
        raise ValueError(f"{file}: expected two or more altitudes that increase strictly")
    return altitudes


def _positive(file: str, factors: Array) -> Array:
    if np.any(factors <= 0.0):
        raise ValueError(
            f"{file}: expected factors on the density that are greater than 0, got {factors.min():g}"
        )
    return factors
