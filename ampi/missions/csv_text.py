"""A CSV of numbers, read strictly: every fault names the file, the line and the column.

Commas stand between the columns and points in the numbers. The first line that is neither empty nor
from # on names the columns. A byte-order mark, any line ends and quoted cells do.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

SEPARATORS = {";": "semicolons", "\t": "tabulators"}  # what spreadsheets write in place of commas


@dataclass(frozen=True)
class CsvText:
    """The wanted columns of a file: a tuple of numbers each, and the lines that they are from."""

    name: str  # of the file, as sentences call it
    lines: tuple[int, ...]
    columns: dict[str, tuple[float, ...]]

    def place(self, row: int, column: str) -> str:
        """Where a number stands, as sentences begin."""
        return f"{self.name}: line {self.lines[row]}, column {column}"

    def increasing(self, column: str) -> tuple[float, ...]:
        """The numbers of a column.

        Raises
        ------
        ValueError
            If one is not greater than that of the row before.
        """
        for row, (before, after) in enumerate(pairwise(self.columns[column]), 1):
            if not after > before:
                raise ValueError(
                    f"{self.place(row, column)}: expected more than {before:g}, the number of the row "
                    f"before, got {after:g}"
                )
        return self.columns[column]


def read_csv_text(text: str, name: str, wanted: Sequence[str] | None = None) -> CsvText:
    """The `wanted` columns of a CSV text, or all.

    Raises
    ------
    ValueError
        If a column is missing or named twice, a row has other cells than the columns, or a wanted cell
        is no finite number.
    """
    lines = text.removeprefix("\ufeff").splitlines()
    told = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    if not told:
        columns = f" {', '.join(wanted)}" if wanted else ""
        raise ValueError(
            f"{name}: expected a line of columns{columns} and rows of numbers, got none"
        )
    rows = [(k, next(csv.reader([line], skipinitialspace=True))) for k, line in told]
    where, header = f"{name}: line {rows[0][0]}", [cell.strip() for cell in rows[0][1]]
    _check_header(where, header, wanted)
    for line, row in rows[1:]:
        if len(row) != len(header):
            raise ValueError(f"{name}: line {line}: {_wrong_count(len(header), len(row))}")
    if len(rows) == 1:
        raise ValueError(f"{name}: expected one or more rows of numbers, got none")
    columns_of = {column: header.index(column) for column in (wanted or header)}
    return CsvText(
        name,
        tuple(line for line, _ in rows[1:]),
        {
            column: tuple(
                _number(f"{name}: line {line}, column {column}", row[place])
                for line, row in rows[1:]
            )
            for column, place in columns_of.items()
        },
    )


def _check_header(where: str, header: list[str], wanted: Sequence[str] | None) -> None:
    for sign, word in SEPARATORS.items():
        if any(sign in cell for cell in header):
            raise ValueError(f"{where}: expected commas between the columns, got {word}")
    missing = [column for column in wanted or () if column not in header]
    if missing:
        raise ValueError(
            f"{where}: expected the columns {', '.join(wanted or ())}, got none that is "
            f"{' or '.join(missing)}"
        )
    if len(set(header)) != len(header) or not all(header):
        raise ValueError(
            f"{where}: expected a name for each column, each once, got {', '.join(header)}"
        )


def _wrong_count(expected: int, came: int) -> str:
    sentence = f"expected {expected} cell{'s' * (expected > 1)}, one for each column, got {came}"
    return f"{sentence}; the decimal sign is a point, no comma" if came > expected else sentence


def _number(where: str, cell: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        raise ValueError(f"{where}: {_no_number(cell.strip())}") from None
    if not math.isfinite(number):
        raise ValueError(f"{where}: expected a finite number, got {cell.strip()!r}")
    return number


def _no_number(cell: str) -> str:
    if not cell:
        return "expected a number, got an empty cell"
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return f"expected a number, got {cell!r}"
    return f"expected a number with a decimal point, got {cell!r}"
