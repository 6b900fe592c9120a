"""The corners of a grid solved before the rest: can the build come there, and what does a case cost?

A corner is solved as the build would try it, from farther away: together with the others from the
nominal optimum, and where that fails alone, along a path of a few steps in p. The build goes through
neighbours and tries longer, so what fails here may yet succeed there.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.propagation.reintegration import flight_checks
from ampi.scp.solve import solve, solve_family
from ampi.trajectory import Status, Trajectory
from database.plan.grid import Grid

Array = NDArray[np.float64]

MOST_CORNERS = 64  # more are left out by lot: of ten parameters there are 1024
LOT = 19  # seed of that
MOST_SECONDS = (
    60.0  # for the corners that are solved alone: a case without a solution is a slow one
)
STEPS = 4  # of p on the way to one


@dataclass(frozen=True)
class Corner:
    """One corner of the grid and how its solve ended."""

    offsets: dict[str, float]  # by the key of the grid, in its unit
    status: Status

    def in_words(self) -> str:
        """Where it lies."""
        return ", ".join(f"{key} {value:+g}" for key, value in self.offsets.items())


@dataclass(frozen=True)
class Corners:
    """Those that were solved, of so many, and the seconds that one took."""

    solved: tuple[Corner, ...]
    number: int  # of corners that the grid has
    seconds_each: float  # of one that is solved together with others, its flight included

    @property
    def failed(self) -> tuple[Corner, ...]:
        """Those without a solution."""
        return tuple(corner for corner in self.solved if not corner.status.ok)


def solve_corners(
    mission: Mission, nominal: Trajectory, advance: Callable[[int], None] = lambda count: None
) -> Corners:
    """Solve the corners of the mission's grid, from its nominal optimum.

    Parameters
    ----------
    mission
        With a grid of one or more axes.
    nominal
        Its optimum, solved.
    advance
        Called with the number of corners done.
    """
    grid = Grid.from_mission(mission)
    cases, number = _corners(grid)
    points = np.stack([grid.point(case) for case in cases])
    family = mission.family(points)
    solve_family(mission.family(grid.point(_centre(grid))[None]), [nominal])  # traced once
    began = time.perf_counter()
    found = solve_family(family, [nominal] * len(cases))
    optima = [one if one is not None and one.status.converged else None for one in found]
    flown = [k for k, one in enumerate(optima) if one is not None]
    statuses: dict[int, Status] = {}
    if flown:
        states = np.stack([_of(optima, k).states for k in flown])
        final_time = np.array([_of(optima, k).final_time for k in flown])
        checks = flight_checks(family.take(np.array(flown)), nominal.mesh, states, final_time)
        statuses = {
            k: _of(optima, k).judged_by(check).status
            for k, check in zip(flown, checks, strict=True)
        }
    seconds = (time.perf_counter() - began) / len(cases)
    advance(sum(status.ok for status in statuses.values()))
    corners, until = list[Corner](), time.perf_counter() + MOST_SECONDS
    for k, case in enumerate(cases):
        status = statuses.get(k, Status.STALLED)
        if not status.ok:
            status = _alone(mission, points[k], nominal, until)
            advance(1)
        corners.append(Corner(_offsets(mission, grid, case), status))
    return Corners(tuple(corners), number, seconds)


def _of(optima: list[Trajectory | None], k: int) -> Trajectory:
    found = optima[k]
    assert found is not None
    return found


def _alone(mission: Mission, point: Array, nominal: Trajectory, until: float) -> Status:
    """Of the case at p, along a path from the nominal optimum while there is time."""
    found = nominal
    for k in range(1, STEPS + 1):
        if time.perf_counter() > until:
            return Status.TIME_LIMIT
        origin = mission.nominal_parameters
        there = mission.with_parameters(origin + (point - origin) * (k / STEPS))
        found = solve(there, guess=found)
        if not found.status.ok:
            break
    return found.status


def _corners(grid: Grid) -> tuple[list[int], int]:
    """Cases at the corners, at most `MOST_CORNERS`, and how many there are."""
    ends = product(*((0, size - 1) for size in grid.shape))
    every: NDArray[np.int64] = np.array(
        [int(np.ravel_multi_index(index, grid.shape)) for index in ends]
    )
    if len(every) <= MOST_CORNERS:
        return every.tolist(), len(every)
    kept = np.random.default_rng(LOT).choice(every, MOST_CORNERS, replace=False)
    return sorted(kept.tolist()), len(every)


def _centre(grid: Grid) -> int:
    return int(np.ravel_multi_index(grid.centre, grid.shape))


def _offsets(mission: Mission, grid: Grid, case: int) -> dict[str, float]:
    index = np.unravel_index(case, grid.shape)
    return {p.key: p.offsets[i] for p, i in zip(mission.parameters, index, strict=True)}
