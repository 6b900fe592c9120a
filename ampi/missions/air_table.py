"""A table of the air as CSV: altitude (m), density (kg/m³) and speed of sound (m/s), read and written.

    altitude_m,density_kg_per_m3,speed_of_sound_m_per_s
    0,1.24853,328.7
    2000,1.00429,325.1

Lines that begin with # say where it is from; other columns are not read.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from importlib.resources.abc import Traversable
from typing import Any

COLUMNS = {  # of the CSV → key of the mission file
    "altitude_m": "altitude_m",
    "density_kg_per_m3": "density",
    "speed_of_sound_m_per_s": "speed_of_sound_m_per_s",
}


def with_air_table(data: Mapping[str, Any], folder: Traversable | None) -> dict[str, Any]:
    """The tables of a mission file with the numbers of `atmosphere.file`, if any, in its place.

    Raises
    ------
    ValueError
        One sentence, if there is no such table in `folder`.
    """
    atmosphere = data.get("atmosphere")
    if not isinstance(atmosphere, dict) or "file" not in atmosphere:
        return dict(data)
    rest = {key: value for key, value in atmosphere.items() if key != "file"}
    file, model = atmosphere["file"], atmosphere.get("model")
    if not isinstance(file, str):
        raise ValueError(f"atmosphere.file: expected the path of a CSV file, got {file!r}")
    if model != "table":
        raise ValueError(f'atmosphere.file: expected model = "table" beside it, got {model!r}')
    if folder is None:
        raise ValueError(
            f"atmosphere.file: expected the numbers of {file}: a text has no folder to read it from"
        )
    numbers = parse_air_table(_text(folder, file), file)
    twice = sorted(set(numbers) & set(rest))
    if twice:
        raise ValueError(
            f"atmosphere.file: expected a file or its numbers, got {', '.join(twice)} beside {file}"
        )
    return {**data, "atmosphere": {**rest, **numbers}}


def _text(folder: Traversable, file: str) -> str:
    try:
        return folder.joinpath(file).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ValueError(f"atmosphere.file: {file}: not a text file in UTF-8") from None
    except OSError as error:
        raise ValueError(f"atmosphere.file: {file}: {error.strerror}") from None


def parse_air_table(text: str, name: str) -> dict[str, list[float]]:
    """Columns by the keys of a mission file; `name` opens the error messages."""
    lines = text.removeprefix("\ufeff").splitlines()
    told = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    rows = [(k, next(csv.reader([line], skipinitialspace=True))) for k, line in told]
    header = [cell.strip() for cell in rows[0][1]] if rows else []
    missing = [column for column in COLUMNS if column not in header]
    if missing:
        raise ValueError(
            f"atmosphere.file: {name}: expected the columns {', '.join(COLUMNS)}, got none that is "
            f"{' or '.join(missing)}"
        )
    numbers: dict[str, list[float]] = {key: [] for key in COLUMNS.values()}
    for line, row in rows[1:]:
        for column, key in COLUMNS.items():
            place = header.index(column)
            cell = row[place] if place < len(row) else ""
            try:
                numbers[key].append(float(cell))
            except ValueError:
                raise ValueError(
                    f"atmosphere.file: {name}: expected a number in line {line}, column {column}, got "
                    f"{cell!r}"
                ) from None
    return numbers


def air_table_text(columns: Iterable[Iterable[float]], comments: Iterable[str]) -> str:
    """The CSV of columns in the order of `COLUMNS`, in six digits, under `comments`."""
    lines = [*(f"# {comment}" for comment in comments), ",".join(COLUMNS)]
    lines += [",".join(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"
