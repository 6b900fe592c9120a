"""A CSV file of numbers: a line of names, then a line for each row; lines from # on are comments."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.missions.csv_text import read_csv_text

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CsvTable:
    """Names of the columns and their finite numbers (rows, columns)."""

    file: str
    columns: tuple[str, ...]
    values: Array
    lines: tuple[int, ...] = ()  # of the rows in the file; none where it is no file

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
    table = read_csv_text(text, name)
    values = np.column_stack(list(table.columns.values()))
    return CsvTable(name, tuple(table.columns), values, table.lines)
