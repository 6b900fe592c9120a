"""From a name, a path or a text to a mission."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ampi.missions import units as u
from ampi.missions.agreement import disagreements
from ampi.missions.air_table import with_air_table
from ampi.missions.mission import Mission
from ampi.missions.sections import MissionError, MissionSections


@dataclass(frozen=True)
class _Source:
    label: str
    text: str
    folder: Traversable  # where it says that other files are


def shipped_missions() -> list[str]:
    """Names of the missions in the package."""
    folder = resources.files("ampi.missions")
    return sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml"))


def _read(name_or_path: str | Path) -> _Source:
    path, known = Path(name_or_path), shipped_missions()
    shipped = str(name_or_path) in known and not path.is_file()
    if not shipped and (path.suffix == ".toml" or path.exists()):
        if not path.is_file():
            raise MissionError(f"mission: no file at {path}")
        try:
            return _Source(str(path), path.read_text(encoding="utf-8"), path.parent)
        except UnicodeDecodeError:
            raise MissionError(f"{path}: not a text file in UTF-8") from None
    if not shipped:
        raise MissionError(
            f"mission: expected one of {', '.join(known)} or the path of a .toml file, "
            f"got {str(name_or_path)!r}"
        )
    folder = resources.files("ampi.missions")
    file = folder.joinpath(f"{name_or_path}.toml")
    return _Source(str(name_or_path), file.read_text(encoding="utf-8"), folder)


def parse_mission(text: str, label: str = "mission", folder: Traversable | None = None) -> Mission:
    """Mission from TOML `text`; `label` opens the error messages, files it names lie in `folder`."""
    text = text.removeprefix("\ufeff")  # the byte order mark of a text file
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MissionError(f"{label}: not valid TOML: {error}") from None
    try:
        data = with_air_table(data, folder)
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
    source = _read(name_or_path)
    return parse_mission(source.text, source.label, source.folder)
