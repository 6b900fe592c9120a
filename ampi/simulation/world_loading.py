"""From a name, a path or a text to a world."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from ampi.missions.source import Shelf
from ampi.missions.units import sentences
from ampi.simulation.air_tables import NRLMSIS, nrlmsis_table
from ampi.simulation.csv_table import CsvTable, read_csv_table
from ampi.simulation.distributions import LAWS
from ampi.simulation.world import World, WorldError
from ampi.simulation.world_sections import WorldSections

SHELF = Shelf("world", "ampi.simulation", "worlds")


def shipped_worlds() -> list[str]:
    """Names of the worlds in the package."""
    return SHELF.names


def load_world(name_or_path: str | Path) -> World:
    """Load a shipped world by name or any world by the path of its TOML file.

    The tables that it names are looked for beside the file, then among the shipped ones.

    Raises
    ------
    WorldError
        If it does not exist, or something in it or in a table is faulty; every faulty field is named
        with what was expected and what came.
    """
    try:
        label, path = SHELF.find(name_or_path)
        _, text = SHELF.read(name_or_path)
    except ValueError as error:
        raise WorldError(str(error)) from None
    return parse_world(text, label, folder=path.parent)


def parse_world(text: str, label: str = "world", *, folder: Path | None = None) -> World:
    """World from TOML `text`; `label` opens the sentences, `folder` holds the tables that it names."""
    text = text.removeprefix("\ufeff")  # the byte order mark of a text file
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise WorldError(f"{label}: not valid TOML: {error}") from None
    try:
        sections = WorldSections.model_validate(data)
    except ValidationError as error:
        lines = [line for f in error.errors() for line in sentences(_as_in_file(f), data)]
        raise _faulty(label, lines) from None
    tables, faults = dict[str, CsvTable](), list[str]()
    for file in sections.files:
        try:
            tables[file] = _read_table(file, folder)
        except ValueError as error:
            faults.append(str(error))
    if sections.nrlmsis is not None:
        try:
            tables[NRLMSIS] = nrlmsis_table(sections.nrlmsis.conditions)
        except ValueError as error:
            faults.append(str(error))
    if not faults:
        try:
            return World(sections, tables)
        except WorldError as error:
            faults = str(error).split("\n")
    raise _faulty(label, faults)


def _faulty(label: str, lines: list[str]) -> WorldError:
    told = "\n".join(f"  {line}" for line in lines)
    return WorldError(f"{label}: {len(lines)} faulty field(s)\n{told}")


def _as_in_file(fault: ErrorDetails) -> ErrorDetails:
    """A fault at its place in the file, where a law has no kind and a constant is a number."""
    place = fault["loc"]
    if place[:1] == ("profiles",):
        return {**fault, "loc": (*place[1:], "table")}
    if "constant" in place:
        place = place[: place.index("constant")]
    return {**fault, "loc": tuple(part for part in place if part not in ("laws", *LAWS))}


def _read_table(file: str, folder: Path | None) -> CsvTable:
    for place in (folder, SHELF.path):
        if place is not None and (place / file).is_file():
            return read_csv_table(place / file, file)
    where = "among the shipped ones" if folder is None else f"in {folder} or among the shipped ones"
    raise ValueError(f"{file}: expected a CSV file {where}, got none of that name")
