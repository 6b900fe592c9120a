"""`ampi diff`: what differs between two databases, and by how much."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ampi.cli.console import escaped, out, print_json
from ampi.cli.endings import refusals
from ampi.cli.options import Json

if TYPE_CHECKING:
    from database.difference import Changed, Difference, RowDifference

MOST = 12  # lines of one kind; --json has them all
WIDTH = 60  # characters of a value


def diff(
    first: Annotated[Path, typer.Argument(help="Trajectory database (.h5).")],
    second: Annotated[Path, typer.Argument(help="The other one.")],
    as_json: Json = False,
) -> None:
    """Say what differs between two databases: missions, software, grids, statuses, optima.

    Exit status: 0 if nothing differs, 1 if something does, 2 if a file cannot be read.
    """
    from ampi.dataset import read_dataset
    from database.difference import difference

    with refusals():
        found = difference(read_dataset(first), read_dataset(second))
    if as_json:
        print_json(found.as_dict())
    else:
        _print(found)
    if not found.same:
        raise typer.Exit(1)


def _print(found: Difference) -> None:
    for title, changes in (
        ("mission", found.mission),
        ("software and settings", found.made_by),
        ("grid", found.axes),
        ("statuses", found.statuses),
    ):
        for line in _lines(title, changes):
            out.print(escaped(line))
    one, two = found.cases
    out.print(
        f"cases: {one:,} and {two:,}, {found.common:,} in both, {found.compared:,} solved in both"
    )
    if not found.compared:
        out.print("no optimum to compare")
    elif all(row.greatest == 0.0 for row in found.rows):
        where = "" if found.same_mesh else " at the last node; the meshes differ"
        out.print(f"optima: the same to the bit{where}")
    else:
        out.print(_table(found.rows))
        if not found.same_mesh:
            out.print("the meshes differ: states and bank rate are those of the last node")
    if found.same:
        out.print("nothing differs")


def _lines(title: str, changes: Sequence[Changed]) -> list[str]:
    if not changes:
        return [f"{title}: the same"]
    lines = [f"{title}: {len(changes)} differ"]
    lines += [f"  {one.name}: {_short(one.first)} → {_short(one.second)}" for one in changes[:MOST]]
    if len(changes) > MOST:
        lines.append(f"  and {len(changes) - MOST} more")
    return lines


def _short(value: object) -> str:
    text = "–" if value is None else str(value)
    return text if len(text) <= WIDTH else f"{text[:WIDTH]}…"


def _table(rows: Sequence[RowDifference]) -> Table:
    table = Table("optima", "greatest difference", "in case")
    for row in rows:
        angle = row.unit.startswith("rad")
        number = math.degrees(row.greatest) if angle else row.greatest
        unit = row.unit.replace("rad", "deg") if angle else row.unit
        unit = "" if unit == "1" else f" {unit}"
        case = ", ".join(f"{key} {value:+g}" for key, value in row.case.items() if value)
        table.add_row(
            row.row,
            f"{number:+.3g}{unit}" if number else "0",
            case or "the nominal one" if number else "–",
        )
    return table
