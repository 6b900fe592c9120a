"""`ampi check`: what is feasible, before a week of computing."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ampi.cli.console import escaped, known, out, print_json
from ampi.cli.endings import refusals
from ampi.cli.options import Jobs, Json, MissionArgument
from ampi.cli.progress import progress

if TYPE_CHECKING:
    from database.corners import Corners
    from database.feasibility import Feasibility, MeshCheck, Reach

KM = 1e-3
NOTHING, LOOK, UNSOLVED = (
    "nothing speaks against the build",
    "look at what is marked with ! before the build",
    "the nominal case has no solution: mend that first",
)


def check(mission: MissionArgument, *, jobs: Jobs, as_json: Json = False) -> None:
    """Say what is feasible before a grid is built: reach, limits, mesh, corners, size and time.

    Exit status: 0 if nothing speaks against the build, 1 if corners have no solution or the mesh is too
    coarse, 2 if the nominal case is not solved.
    """
    from ampi.missions.loading import load_mission
    from database.corners import MOST_CORNERS
    from database.feasibility import feasibility

    with refusals():
        loaded = load_mission(mission)
        with progress("checking", MOST_CORNERS) as advance:
            found = feasibility(loaded, workers=jobs, folder=Path(), advance=advance)
    if as_json:
        print_json(found.as_dict())
    else:
        out.print(f"{escaped(loaded.name)}: {escaped(loaded.title)}")
        for line in in_words(found):
            out.print(escaped(line))
    if not found.clear:
        raise typer.Exit(1 if found.status.ok else 2)


def in_words(found: Feasibility) -> list[str]:
    """A line for each part, and a verdict."""
    lines = [_reach(found.reach), f"{'  ' if found.status.ok else '! '}optimum  {found.sentence}"]
    if found.use:
        lines.append(_limits(found))
    if found.mesh is not None:
        lines.append(_mesh(found.mesh))
    if found.corners is not None:
        lines += _corners(found.corners)
    if found.cost is not None:
        lines.append(f"  grid     {found.cost}")
    elif found.status.ok:
        lines.append("  grid     none: the mission disperses nothing")
    verdict = NOTHING if found.clear else LOOK if found.status.ok else UNSOLVED
    return [*lines, verdict]


def _reach(reach: Reach) -> str:
    def km(range_: float) -> str:
        return known(range_ * KM, ",.0f")

    mark = "  " if reach.within else "! "
    line = (
        f"{mark}reach    bank angles held reach {km(reach.least)} km (at the limit) to "
        f"{km(reach.greatest)} km (wings level)"
    )
    where = ", between" if reach.within else ", outside: no bank angle held comes there"
    if math.isnan(reach.least) and math.isnan(reach.greatest):
        line, where = "  reach    of bank angles held is unknown", ""
    if reach.distance == reach.distance:
        line += f"; the target lies at {km(reach.distance)} km{where}"
    if reach.nearest == reach.nearest:
        line += f"; the best plan of bank angles found ends {km(reach.nearest)} km from it"
    return line


def _limits(found: Feasibility) -> str:
    binding = " and ".join(found.binding) + (" bind" if len(found.binding) > 1 else " binds")
    uses = ", ".join(f"{name} {100.0 * use:.1f} %" for name, use in found.use.items())
    return f"  limits   {binding if found.binding else 'none binds'}; greatest use: {uses}"


def _mesh(mesh: MeshCheck) -> str:
    mark, verdict = ("  ", "adequate") if mesh.adequate else ("! ", "too coarse")
    finer = "no solution"
    if mesh.finer_status.converged:
        finer = (
            f"the final time moves by {mesh.final_time_moved:+.3f} s, the cost by "
            f"{100.0 * mesh.cost_moved:.2g} %"
        )
    hint = "" if mesh.adequate else "; try: ampi solve --refine"
    return (
        f"{mark}mesh     {verdict}: {mesh.nodes} nodes, flown again "
        f"{mesh.position_error:,.1f} m off at most; on {mesh.finer_nodes} nodes {finer}{hint}"
    )


def _corners(corners: Corners) -> list[str]:
    failed, tried = corners.failed, len(corners.solved)
    some = "" if tried == corners.number else f" (of {corners.number:,}, drawn by lot)"
    lines = [
        f"{'! ' if failed else '  '}corners  {tried - len(failed)} of {tried} solved{some}, "
        f"{1e3 * corners.seconds_each:.1f} ms each"
    ]
    for status, count in Counter(corner.status for corner in failed).items():
        first = next(corner for corner in failed if corner.status is status)
        lines.append(f"           {count}: {status.sentence} The first: {first.in_words()}")
    return lines
