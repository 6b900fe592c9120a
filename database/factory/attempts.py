"""The ways to a case, one after the other until one succeeds.

From the continuation of its neighbours; from each neighbour at once, then along paths of more and more
steps in p; at last from nothing. Every solve is tried by Newton's iteration first, where there is
something to start it from, and has a time limit.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from ampi.missions.mission import Mission
from ampi.scp.solve import optimum, solve_family
from ampi.trajectory import Status, Trajectory
from database.plan.continuation import PlannedCase
from database.plan.grid import Grid
from database.plan.prediction import predicted
from database.records.campaign import Campaign

LONGEST_ALARM = 1e9  # s: the kernel's clock takes nine times as much
PATH_STEPS = (4, 16)  # a failed case is retried along this many steps of p


@dataclass(frozen=True)
class Attempt:
    """One way to a case: predicted, from a solved neighbour in `steps` steps of p, or from nothing."""

    neighbour: int | None
    steps: int = 1
    predicted: bool = False  # from the multilinear continuation of several neighbours

    def __str__(self) -> str:
        if self.predicted:
            return "from the continuation of its neighbours"
        if self.neighbour is None:
            return "from a constant bank angle"
        return f"from case {self.neighbour} in {self.steps} step(s)"


def attempts(neighbours: Sequence[int], *, predicted: bool) -> list[Attempt]:
    """All attempts at a case with these solved neighbours, in order; `predicted` if it can be."""
    first = [Attempt(None, predicted=True)] if predicted else []
    from_neighbours = [Attempt(n, steps) for steps in (1, *PATH_STEPS) for n in neighbours]
    return [*first, *from_neighbours, Attempt(None)]


def is_vain(attempt: Attempt, ways: Sequence[Attempt], ended: Sequence[Status | None]) -> bool:
    """Whether an attempt cannot lead elsewhere than those before it, which `ended` so.

    If all of those in one step converged, and to no solution, that is where their branch leads: more
    steps lead to its end, at the price of the slowest solves there are. One path is followed all the
    same, for one step may have been too long: the shortest, from the best neighbour.
    """
    if attempt.steps == 1:
        return False
    whole = all(status is not None and status.converged for status in ended[: _direct(ways)])
    return whole and attempt != ways[_direct(ways)]


def _direct(ways: Sequence[Attempt]) -> int:
    """How many attempts are made in one step from neighbours; they come first."""
    return sum(way.steps == 1 for way in ways) - 1


def first_start(
    grid: Grid, planned: PlannedCase, solved: Callable[[int], Trajectory | None]
) -> tuple[Attempt, Trajectory] | None:
    """The first of `attempts` and where it starts, from solved cases; None if that is from nothing."""
    continued = predicted(grid, planned.case, solved)
    if continued is not None:
        return Attempt(None, predicted=True), continued
    for neighbour in planned.neighbours:
        start = solved(neighbour)
        if start is not None:
            return Attempt(neighbour), start
    return None


def path_to(mission: Mission, grid: Grid, case: int, attempt: Attempt) -> list[Mission]:
    """The missions to solve on the way of an attempt, that of the case last."""
    goal = grid.point(case)
    origin = goal if attempt.neighbour is None else grid.point(attempt.neighbour)
    return [
        mission.with_parameters(origin + (goal - origin) * (k / attempt.steps))
        for k in range(1, attempt.steps + 1)
    ]


def follow(
    campaign: Campaign, path: list[Mission], start: Trajectory | None
) -> tuple[Trajectory, int]:
    """Solve along a path, each mission from the one before: the last trajectory, the solves."""
    solves, flown = 0, start
    for mission in path:
        with stopped_after(campaign.time_limit):
            flown = solve_one(campaign, mission, flown)
        solves += 1
        if not flown.status.ok:
            break
    if flown is None:
        raise ValueError("path: expected at least one mission, got none")
    return flown, solves


def solve_one(campaign: Campaign, mission: Mission, start: Trajectory | None) -> Trajectory:
    """By Newton's iteration where that is enough, else by the campaign's optimiser."""
    if campaign.together and start is not None:
        found = solve_family(campaign.family_of(mission), [start], campaign.settings)[0]
        if found is not None and found.status.ok:
            return found
    # the assembly flies all cases of a block again, together
    if campaign.judged:
        return optimum(mission, guess=start, settings=campaign.settings)
    return campaign.solver(mission, guess=start)


@contextmanager
def stopped_after(seconds: float) -> Iterator[None]:
    """End this process if the block takes longer.

    The kernel does it, by a signal that nothing handles: code that is stuck in a library never comes
    back to the interpreter, where an exception could be raised.
    """
    signal.setitimer(signal.ITIMER_REAL, min(seconds, LONGEST_ALARM))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def no_trajectory(mission: Mission) -> Trajectory:
    """What stands for a case that raised, hung or killed its process."""
    return Trajectory.none(mission.pseudospectral_mesh, Status.ERROR, mission.n_states)
