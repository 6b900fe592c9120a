"""A part of a database's grid as a database of its own: without the cases that nobody can solve.

Nothing is solved: the optima that stay are taken over, those that could not be solved stay what they
are.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.missions.mission import Mission
from ampi.missions.parameters import measured_values
from ampi.scp.solve import solve
from database.build import build
from database.build_report import BuildReport, in_unit_of_key
from database.building import KnownOptimum
from database.plan.grid import Grid
from database.records.campaign import BuildError, Solver, as_built

BEFORE = " of the grid before cropping: "
ROUNDING = 0.01  # of the step to the next grid point: values are typed as they were printed

Kept = tuple[tuple[int, ...], ...]  # by axis, the indices that stay


@dataclass(frozen=True)
class CropReport:
    """What was left out, and the file that holds the rest."""

    dropped: dict[str, tuple[float, ...]]  # by key, values in the key's unit
    cases_before: int
    build: BuildReport


def crop(
    path: str | Path,
    output: str | Path,
    *,
    drop: Sequence[tuple[str, float]] = (),
    box: bool = False,
    solver: Solver = solve,
    n_jobs: int = 2,
    advance: Callable[[int], None] | None = None,
) -> CropReport:
    """Write the database of `path` without some of its grid to `output`.

    Parameters
    ----------
    path, output
        Database files; `output` is new, or the same crop.
    drop
        (key, value): grid points of an axis, in the key's unit. The nominal ones stay.
    box
        Keep of what is left the largest box around the nominal case in which all cases are solved.
    solver
        The optimiser that built the database.
    n_jobs
        Worker processes.
    advance
        Called with the number of cases just taken over.

    Raises
    ------
    BuildError
        If a value is none of the grid, or nominal; if nothing would be left out, or no axis be left.
    """
    path, output = Path(path), Path(output).absolute()
    if output.resolve() == path.resolve():
        raise BuildError(
            f"output: expected another file than the database to crop, got {output}; "
            "choose another path"
        )
    if not drop and not box:
        raise BuildError("drop: expected at least one KEY=VALUE to leave out, or box, got neither")
    dataset = read_dataset(path)
    settings = as_built(dataset, solver)
    mission, grid = dataset.mission, Grid.from_mission(dataset.mission)
    kept = _without(mission, grid, drop)
    if box:
        kept = largest_box(dataset.solved, grid.centre, kept)
    cropped = with_points(mission, kept)
    known = taken_over(dataset, kept)
    report = build(cropped, output, n_jobs=n_jobs, known=known, advance=advance, **settings)
    dropped = {
        p.key: tuple(in_unit_of_key(p, i) for i in range(len(p.offsets)) if i not in stays)
        for p, stays in zip(mission.parameters, kept, strict=True)
    }
    return CropReport({k: v for k, v in dropped.items() if v}, grid.size, report)


def _without(mission: Mission, grid: Grid, drop: Sequence[tuple[str, float]]) -> Kept:
    """The indices that stay without these points."""
    kept = [list(range(n)) for n in grid.shape]
    for key, value in drop:
        given = measured_values(mission, mission.parameters, {key: value})
        moved = np.flatnonzero(given != mission.nominal_parameters)
        if len(moved) == 0:
            raise _nominal(key, value)
        i = int(moved[0])
        near = int(np.argmin(np.abs(grid.axes[i] - given[i])))
        if not _is_at(grid.axes[i], near, float(given[i])):
            axis = mission.parameters[i]
            points = ", ".join(f"{in_unit_of_key(axis, k):.6g}" for k in range(grid.shape[i]))
            raise BuildError(
                f"drop: expected a grid point of {axis.key} ({points}), got {key} = {value:g}"
            )
        if near == grid.centre[i]:
            raise _nominal(key, value)
        if near in kept[i]:
            kept[i].remove(near)
    return tuple(tuple(indices) for indices in kept)


def _nominal(key: str, value: float) -> BuildError:
    return BuildError(
        f"drop: {key} = {value:g} is the nominal value, which every grid holds; leave out others, or "
        "change the mission and build it"
    )


def _is_at(axis: NDArray[np.float64], near: int, asked: float) -> bool:
    """Whether a value is that of its nearest grid point, but for rounding."""
    step = np.min(np.abs(np.delete(axis, near) - axis[near]))
    return bool(abs(asked - axis[near]) <= ROUNDING * step)


def largest_box(solved: NDArray[np.bool_], centre: tuple[int, ...], kept: Kept) -> Kept:
    """The largest box of the `kept` indices around the centre without an unsolved case.

    Any such box leaves out a given hole by ending before it on one axis. So the largest is found by
    taking boxes in the order of their size, and cutting those that hold a hole on each axis in turn.
    """
    part = solved[np.ix_(*kept)]
    middle = tuple(indices.index(c) for indices, c in zip(kept, centre, strict=True))
    whole = tuple((0, n) for n in part.shape)
    waiting, seen = [(-part.size, whole)], {whole}
    while True:
        _, ranges = heapq.heappop(waiting)
        inside = part[tuple(slice(*r) for r in ranges)]
        holes = np.argwhere(~inside) + np.array([low for low, _ in ranges])
        if len(holes) == 0:
            return tuple(indices[slice(*r)] for indices, r in zip(kept, ranges, strict=True))
        hole = holes[np.argmin(np.abs(holes - np.array(middle)).sum(axis=1))]  # nearest: cuts most
        for axis, (at, c) in enumerate(zip(hole.tolist(), middle, strict=True)):
            if at == c:
                continue
            low, high = ranges[axis]
            cut = (low, at) if at > c else (at + 1, high)
            smaller = (*ranges[:axis], cut, *ranges[axis + 1 :])
            if smaller not in seen:
                seen.add(smaller)
                heapq.heappush(waiting, (-math.prod(b - a for a, b in smaller), smaller))


def with_points(mission: Mission, kept: Kept) -> Mission:
    """The mission with these points of its axes alone.

    Raises
    ------
    BuildError
        If that is the whole grid, or a single point.
    """
    if all(len(stays) == len(p.offsets) for p, stays in zip(mission.parameters, kept, strict=True)):
        raise BuildError(
            f"{mission.name}: expected something to leave out, got a grid without a hole"
        )
    if all(len(stays) == 1 for stays in kept):
        raise BuildError(
            f"{mission.name}: nothing but the nominal case would be left; a grid needs an axis of two "
            "points: leave out less, or move the nominal values away from what cannot be solved"
        )
    axes = {
        p.key: [p.offsets[i] for i in stays]
        for p, stays in zip(mission.parameters, kept, strict=True)
    }
    return mission.with_grid({**dict(mission.grid.offsets), **axes})


def taken_over(dataset: TrajectoryDataset, kept: Kept) -> dict[int, KnownOptimum]:
    """The cases that stay, solved or not, numbered as in the cropped grid.

    An axis of one point is none; C order does not depend on it.
    """
    known = {}
    numbers = np.arange(dataset.solved.size).reshape(dataset.shape)[np.ix_(*kept)]
    for number, case in enumerate(numbers.ravel().tolist()):
        found = KnownOptimum.of(dataset, case)
        first = found.message.split(BEFORE)[-1]  # not a line more with every crop
        known[number] = KnownOptimum(found.trajectory, f"case {case}{BEFORE}{first}")
    return known
