"""The CSV files that a mission file may name in place of numbers: of the air, and of the vehicle.

    [atmosphere]                     [vehicle.aerodynamics]
    model = "table"                  model = "table"
    file = "january_70n.csv"         file = "aerodynamics.csv"

They lie in the folder of the mission file. A mission holds their numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources.abc import Traversable
from typing import Any

from ampi.missions.aerodynamic_table import parse_aerodynamic_table
from ampi.missions.air_table import parse_air_table

Parser = Callable[[str, str], Mapping[str, Any]]
PARSERS: dict[tuple[str, ...], Parser] = {  # by the table of the mission file
    ("atmosphere",): parse_air_table,
    ("vehicle", "aerodynamics"): parse_aerodynamic_table,
}


def with_named_files(data: Mapping[str, Any], folder: Traversable | None) -> dict[str, Any]:
    """The tables of a mission file with the numbers of each `file` in its place.

    Raises
    ------
    ValueError
        One sentence, if there is no such table in `folder`.
    """
    found = dict(data)
    for path, parse in PARSERS.items():
        found = _with_file(found, path, parse, folder, ".".join(path))
    return found


def _with_file(
    data: Mapping[str, Any],
    path: tuple[str, ...],
    parse: Parser,
    folder: Traversable | None,
    name: str,
) -> dict[str, Any]:
    first, *others = path
    table = data.get(first)
    if not isinstance(table, dict):
        return dict(data)
    if others:
        return {**data, first: _with_file(table, tuple(others), parse, folder, name)}
    return {**data, first: _filled(table, parse, folder, name)} if "file" in table else dict(data)


def _filled(
    table: Mapping[str, Any], parse: Parser, folder: Traversable | None, name: str
) -> dict[str, Any]:
    rest = {key: value for key, value in table.items() if key != "file"}
    file, model = table["file"], table.get("model")
    if not isinstance(file, str):
        raise ValueError(f"{name}.file: expected the path of a CSV file, got {file!r}")
    if model != "table":
        raise ValueError(f'{name}.file: expected model = "table" beside it, got {model!r}')
    if folder is None:
        raise ValueError(
            f"{name}.file: expected the numbers of {file}: a text has no folder to read it from"
        )
    try:
        numbers = parse(_text(folder, file), file)
    except ValueError as error:
        raise ValueError(f"{name}.file: {error}") from None
    twice = sorted(set(numbers) & set(rest))
    if twice:
        raise ValueError(
            f"{name}.file: expected a file or its numbers, got {', '.join(twice)} beside {file}"
        )
    return {**rest, **numbers}


def _text(folder: Traversable, file: str) -> str:
    try:
        return folder.joinpath(file).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ValueError(f"{file}: not a text file in UTF-8") from None
    except OSError as error:
        raise ValueError(f"{file}: {error.strerror}") from None
