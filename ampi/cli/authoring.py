"""`ampi new` and `ampi schema`: a mission or a world of one's own, and what editors check it with."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ampi.cli.console import escaped, out
from ampi.cli.endings import refusals
from ampi.cli.options import one_of
from ampi.cli.output_files import check_output

if TYPE_CHECKING:
    from ampi.simulation.world import World

MISSION, WORLD = "mission", "world"


def new(
    path: Annotated[Path, typer.Argument(help="File to write (.toml).")],
    source: Annotated[
        str,
        typer.Option("--from", help="Shipped mission or world, or the .toml file of one."),
    ],
    world: Annotated[
        bool, typer.Option("--world", help="The .toml file after --from is a world.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Write a mission or a world to edit: the values of another one, and every field explained.

    The JSON schema that its first line names is written beside it, and the CSV tables of a world.
    """
    from ampi.simulation.world_loading import shipped_worlds

    with refusals():
        kind = WORLD if world or source in shipped_worlds() else MISSION
        files = _world_files(path, source) if kind == WORLD else _mission_files(path, source)
        _check_new(path, source, force=force)
        for beside in [file for file in files if file != path]:
            _check_beside(beside, files[beside], force=force)
        for file, text in files.items():
            file.write_text(text, encoding="utf-8")
    names = " and ".join(escaped(file.name) for file in files if file != path)
    out.print(f"{escaped(path)}: the {kind} {escaped(source)}, explained; beside it {names}")


def schema(
    kind: Annotated[str, typer.Argument(help="mission or world.")] = MISSION,
    output: Annotated[
        Path | None, typer.Option(help="File to write; by default standard output.")
    ] = None,
) -> None:
    """Print the JSON schema of mission or world files: editors complete and check by it.

    A file names it in its first line: #:schema ./mission.schema.json
    """
    with refusals():
        text = _schema_text(one_of((MISSION, WORLD), kind, "KIND"))
        check_output(output, ".json", made_by='"title": "ampi ')
        if output is not None:
            output.write_text(text, encoding="utf-8")
        else:
            sys.stdout.write(text)


def _schema_text(kind: str) -> str:
    if kind == MISSION:
        from ampi.missions.json_schema import mission_schema as made
    else:
        from ampi.simulation.world_schema import world_schema as made
    return json.dumps(made(), indent=1, ensure_ascii=False) + "\n"


def _mission_files(path: Path, source: str) -> dict[Path, str]:
    """Texts by path: the mission, which holds the numbers of its tables, and the schema."""
    from ampi.missions.explained import explained, opening
    from ampi.missions.loading import load_mission

    mission = load_mission(source)
    lines = [*opening(MISSION, Path(source).name), *explained(mission)]
    return _files(path, MISSION, lines, {})


def _world_files(path: Path, source: str) -> dict[Path, str]:
    """Texts by path: the world, the tables that it names, and the schema."""
    from ampi.missions.explained import opening
    from ampi.simulation.explained_world import explained_world
    from ampi.simulation.world_loading import load_world

    world = load_world(source)
    lines = [*opening(WORLD, Path(source).name), *explained_world(world.sections)]
    return _files(path, WORLD, lines, _tables(world, source))


def _tables(world: World, source: str) -> dict[str, str]:
    """The texts of the CSV files that a world names."""
    from ampi.simulation.world_loading import SHELF

    folders = (SHELF.find(source)[1].parent, SHELF.path)
    found = {}
    for file in world.sections.files:
        place = next(folder / file for folder in folders if (folder / file).is_file())
        found[file] = place.read_text(encoding="utf-8")
    return found


def _files(path: Path, kind: str, lines: list[str], tables: Mapping[str, str]) -> dict[Path, str]:
    folder = path.parent
    return {
        path: "\n".join(lines) + "\n",
        folder / f"{kind}.schema.json": _schema_text(kind),
        **{folder / file: text for file, text in tables.items()},
    }


def _check_new(path: Path, source: str, *, force: bool) -> None:
    if path.suffix.lower() != ".toml":
        raise ValueError(f"{path}: expected a name that ends in .toml")
    if path.exists() and path.is_file() and force:
        if Path(source).exists() and path.samefile(source):
            raise ValueError(f"{path}: expected another file than the source of its values")
        if not os.access(path, os.W_OK):
            raise ValueError(f"{path}: no permission to write there")
        return
    if path.is_file():
        raise ValueError(
            f"{path} is already there; nothing was overwritten: choose another path, or add --force"
        )
    check_output(path)


def _check_beside(path: Path, text: str, *, force: bool) -> None:
    """A schema of ours is replaced without a word; a table that is there already stays what it is."""
    if path.is_file() and path.read_bytes() == text.encode():
        return
    schema = path.name.endswith(".schema.json")
    check_output(path, force=force, made_by='"title": "ampi ' if schema else None)
