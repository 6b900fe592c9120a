"""From a name, a path or a text to a mission."""

from __future__ import annotations

import tomllib
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ampi.missions import units as u
from ampi.missions.agreement import disagreements
from ampi.missions.mission import Mission
from ampi.missions.named_files import with_named_files
from ampi.missions.sections import MissionError, MissionSections
from ampi.missions.source import Shelf

SHELF = Shelf("mission", "ampi.missions")


def shipped_missions() -> list[str]:
    """Names of the missions in the package."""
    return SHELF.names


def parse_mission(text: str, label: str = "mission", folder: Traversable | None = None) -> Mission:
    """Mission from TOML `text`; `label` opens the error messages, files it names lie in `folder`."""
    text = text.removeprefix("\ufeff")  # the byte order mark of a text file
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MissionError(f"{label}: not valid TOML: {error}") from None
    try:
        data = with_named_files(data, folder)
    except ValueError as error:
        raise MissionError(f"{label}: {error}") from None
    try:
        return Mission.model_validate(data)
    except ValidationError as error:
        lines = [line for fault in error.errors() for line in u.sentences(fault, data)]
        lines += _faults_of_the_rest(data, {str(f["loc"][0]) for f in error.errors() if f["loc"]})
        told = "\n".join(f"  {line}" for line in lines)
        raise MissionError(f"{label}: {len(lines)} faulty field(s)\n{told}") from None


def _faults_of_the_rest(data: dict[str, Any], faulty: set[str]) -> list[str]:
    """What does not fit together among the sections that no fault of their own keeps out."""
    if not faulty:
        return []
    fields = {
        name: info for name, info in MissionSections.model_fields.items() if name not in faulty
    }
    sections = {
        name: TypeAdapter(info.annotation).validate_python(data[name])
        for name, info in fields.items()
        if name in data and info.annotation is not None
    }
    rest = MissionSections.model_construct(**sections)
    for name in faulty:
        rest.__dict__.pop(name, None)  # a default is not what was asked for
    return disagreements(rest)


def load_mission(name_or_path: str | Path) -> Mission:
    """Load a shipped mission by name or any mission by the path of its TOML file.

    Raises
    ------
    MissionError
        If it does not exist or a field is faulty; every faulty field is named with what was
        expected and what came.
    """
    try:
        label, text = SHELF.read(name_or_path)
        folder = SHELF.find(name_or_path)[1].parent
    except ValueError as error:
        raise MissionError(str(error)) from None
    return parse_mission(text, label, folder)
