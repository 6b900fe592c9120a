"""One more point on one axis: the refined mission, with every solved case of the old database in it.

The grid is a Cartesian product, so a new axis value adds a whole layer of cases; every old case is a
case of the new grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.missions.mission import Mission
from ampi.scp.solve import solve
from database.audit.error_map import CellError, best_cell, error_map
from database.build import build
from database.build_report import BuildReport
from database.building import KnownOptimum
from database.plan.grid import Grid
from database.records.campaign import BuildError, Solver, as_built

BEFORE = " of the grid before refinement: "


@dataclass(frozen=True)
class RefineReport:
    """What was added, and what it took."""

    cell: CellError
    offset: float  # of the new point, in the unit of the cell's key
    reused: int
    solved_anew: int
    build: BuildReport


def refine(
    path: str | Path,
    output: str | Path,
    *,
    parameter: str | None = None,
    solver: Solver = solve,
    n_jobs: int = 2,
    advance: Callable[[int], None] | None = None,
) -> RefineReport:
    """Write the database of `path` with one more point, where it pays most, to `output`.

    Parameters
    ----------
    path, output
        Database files; `output` is new, or a database of the same refined mission.
    parameter
        The axis, by the parameter's name; None: the one where a point pays most.
    solver
        The optimiser that built the database; the new cases are solved as the old ones were.
    n_jobs
        Worker processes.
    advance
        Called with the number of cases just finished.
    """
    output = Path(output).absolute()
    if output.resolve() == Path(path).resolve():
        raise BuildError(
            f"output: expected another file than the database to refine, got {output}; "
            "choose another path"
        )
    dataset = read_dataset(path)
    settings = as_built(dataset, solver)
    cell = best_cell(error_map(dataset, n_jobs=n_jobs), parameter)
    offset = 0.5 * (cell.low + cell.high)
    refined = with_point(dataset.mission, cell.parameter, offset)
    known = carried_over(dataset, refined, cell.parameter)
    report = build(refined, output, n_jobs=n_jobs, known=known, advance=advance, **settings)
    return RefineReport(cell, offset, len(known), report.cases - len(known), report)


def with_point(mission: Mission, parameter: str, offset: float) -> Mission:
    """The mission with `offset` (in the unit of the axis' key) added to an axis of its grid."""
    axis = next(p for p in mission.parameters if p.name == parameter)
    offsets = dict(mission.grid.offsets)
    return mission.with_grid({**offsets, axis.key: sorted([*offsets[axis.key], offset])})


def carried_over(
    dataset: TrajectoryDataset, refined: Mission, parameter: str
) -> dict[int, KnownOptimum]:
    """The solved cases of a database, numbered as in the refined mission's grid."""
    old, new = Grid.from_mission(dataset.mission), Grid.from_mission(refined)
    i = old.names.index(parameter)
    moved_to = [int(np.flatnonzero(new.axes[i] == value)[0]) for value in old.axes[i]]
    known: dict[int, KnownOptimum] = {}
    for case in np.flatnonzero(dataset.solved.ravel()):
        index = [int(k) for k in np.unravel_index(case, old.shape)]
        index[i] = moved_to[index[i]]
        number = int(np.ravel_multi_index(index, new.shape))
        kept = KnownOptimum.of(dataset, int(case))
        first = kept.message.split(BEFORE)[-1]  # not a line more with every refinement
        message = f"case {case}{BEFORE}{first}"
        known[number] = KnownOptimum(kept.trajectory, message)
    return known
