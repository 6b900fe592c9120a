"""A CSV file of numbers: a line of names, then a line for each row; lines from # on are comments."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CsvTable:
    """Names of the columns and their finite numbers (rows, columns)."""

    file: str
    columns: tuple[str, ...]
    values: Array

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=float)
        if values.ndim != 2 or values.shape[1] != len(self.columns) or not len(values):
            raise ValueError(
                f"{self.file}: expected one or more rows of {len(self.columns)} numbers, "
                f"got shape {values.shape}"
            )
        values.setflags(write=False)
        object.__setattr__(self, "values", values)

    def column(self, name: str) -> Array:
        """The numbers of one column (rows,).

        Raises
        ------
        ValueError
            If there is none of that name.
        """
        if name not in self.columns:
            raise ValueError(
                f"{self.file}: expected a column {name!r}, got {', '.join(self.columns)}"
            )
        return np.asarray(self.values[:, self.columns.index(name)])

    def rows(self, kept: NDArray[np.bool_]) -> CsvTable:
        """Some of its rows."""
        return CsvTable(self.file, self.columns, self.values[kept])


def rows_of(file: str) -> str:
    """Name of the uniform number that selects a row of a file, for all that is read from it."""
    return f"row of {file}"


def read_csv_table(path: Path, name: str) -> CsvTable:
    """Read a table of finite numbers; sentences call it `name`.

    Raises
    ------
    ValueError
        If there is no such file, it has no rows, or something in it is no finite number.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise ValueError(f"{name}: expected a CSV file in UTF-8 at {path}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    names, *rows = csv.reader(lines, skipinitialspace=True) if lines else [[]]
    columns = tuple(title.strip() for title in names)
    if len(set(columns)) != len(columns) or not all(columns):
        raise ValueError(f"{name}: expected a name for each column, each once, got {names}")
    values = [_numbers(name, columns, number, row) for number, row in enumerate(rows, 1)]
    if not values:
        raise ValueError(f"{name}: expected one or more rows of numbers, got none")
    return CsvTable(name, columns, np.array(values))


def _numbers(file: str, columns: tuple[str, ...], number: int, row: list[str]) -> list[float]:
    if len(row) != len(columns):
        raise ValueError(
            f"{file}: row {number}: expected {len(columns)} numbers, got {len(row)}: {', '.join(row)}"
        )
    try:
        values = [float(item) for item in row]
    except ValueError:
        raise ValueError(f"{file}: row {number}: expected numbers, got {', '.join(row)}") from None
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{file}: row {number}: expected finite numbers, got {', '.join(row)}")
    return values
