"""The two kinds of work in a build: solve a case, assemble a block. Each keeps its own result.

A case is tried from each neighbour at once, then along paths of more and more steps in p, at last from
nothing. An attempt that fails, raises or exceeds its time limit is a line of the record, and the next
one follows; a case without a solution is a record with a status, never a hole.

A job depends on the mission and on records already kept, on nothing else. It may be run anywhere, any
number of times, and always keeps the same result.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np

from ampi.missions.mission import Mission, parse_mission
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.shortfall import verdict
from ampi.scp.solve import solve
from ampi.trajectory import Status, Trajectory
from database.blocks import Block, assemble
from database.continuation import PlannedCase
from database.gains import GainSettings
from database.grid import Grid
from database.prediction import predicted
from database.records import (
    CaseRecord,
    block_path,
    load_record,
    record_path,
    save_block,
    save_record,
)

PATH_STEPS = (4, 16)  # a failed case is retried along this many steps of p
TIME_LIMIT = 60.0  # s for one solve: some 300 times what a hard one takes


class JobError(RuntimeError):
    """A job that could not keep a result: the build cannot go on."""


class Solver(Protocol):
    """An optimiser: a mission and a neighbour's trajectory in, a trajectory out."""

    __module__: str
    __qualname__: str

    def __call__(self, mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
        """Solve."""


def solver_name(solver: Solver) -> str:
    """Where to find an optimiser, for the records and for the file."""
    return f"{solver.__module__}.{solver.__qualname__}"


@dataclass(frozen=True)
class Campaign:
    """What all jobs of a build share; it travels to the workers."""

    toml: str
    folder: Path
    solver: Solver = solve
    time_limit: float = TIME_LIMIT  # s, of one solve
    gains: GainSettings = field(default_factory=GainSettings)

    @property
    def mission(self) -> Mission:
        """The mission, parsed once per process."""
        return _mission_and_grid(self.toml)[0]

    @property
    def grid(self) -> Grid:
        """Its grid."""
        return _mission_and_grid(self.toml)[1]


@lru_cache(maxsize=4)
def _mission_and_grid(toml: str) -> tuple[Mission, Grid]:
    mission = parse_mission(toml)
    return mission, Grid.from_mission(mission)


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


class Job(Protocol):
    """Work that a process does alone."""

    @property
    def result(self) -> Path:
        """The file that the job leaves."""

    def run(self, announce: Callable[[int], None]) -> None:
        """Do it, telling the number of each attempt before it begins."""

    def without(self, attempt: int) -> Job:
        """The same job, but for an attempt that has exceeded its time limit."""

    def give_up(self, reason: str) -> None:
        """Keep a result that says why there is none."""


@dataclass(frozen=True)
class SolveCase:
    """Solve one case from its neighbours' records and keep the result."""

    campaign: Campaign
    planned: PlannedCase
    overdue: frozenset[int] = frozenset()  # attempts that have exceeded the time limit

    @property
    def result(self) -> Path:
        """The case's record."""
        return record_path(self.campaign.folder, self.planned.case)

    def run(self, announce: Callable[[int], None]) -> None:
        """Attempt after attempt, until one succeeds."""
        began = time.perf_counter()
        mission, grid = self.campaign.mission, self.campaign.grid
        starts, continued = self._starts(), self._predicted()
        log, solves = list[str](), 0
        best: Trajectory | None = None
        for number, attempt in enumerate(attempts(list(starts), predicted=continued is not None)):
            if number in self.overdue:
                limit = self.campaign.time_limit
                log.append(f"{attempt}: Stopped at the time limit of {limit:g} s.")
                continue
            announce(number)
            start = continued if attempt.predicted else None
            if attempt.neighbour is not None:
                start = starts[attempt.neighbour]
            path = path_to(mission, grid, self.planned.case, attempt)
            try:
                flown, count = follow(self.campaign, path, start)
            except Exception as error:  # whatever it was, it belongs in the record
                log.append(f"{attempt}: {type(error).__name__}: {error}")
                continue
            solves += count
            log.append(f"{attempt}: {verdict(path[count - 1], flown)}")
            if flown.status.ok:
                best, log = flown, log[-1:]
                break
            if count == len(path) and (best is None or attempt.neighbour is not None):
                best = flown  # it has come to the case's own problem, if not to a solution
        trajectory = no_trajectory(mission.pseudospectral_mesh) if best is None else best
        seconds = time.perf_counter() - began
        record = CaseRecord(self.planned.case, trajectory, "; ".join(log), solves, seconds)
        save_record(self.campaign.folder, record)

    def without(self, attempt: int) -> SolveCase:
        """The same case along the other paths."""
        return replace(self, overdue=self.overdue | {attempt})

    def give_up(self, reason: str) -> None:
        """A record with the status ERROR."""
        nothing = no_trajectory(self.campaign.mission.pseudospectral_mesh)
        save_record(self.campaign.folder, CaseRecord(self.planned.case, nothing, reason, 0, 0.0))

    def _starts(self) -> dict[int, Trajectory]:
        """The solved neighbours, best first."""
        found = {n: self._solved(n) for n in self.planned.neighbours}
        return {n: trajectory for n, trajectory in found.items() if trajectory is not None}

    def _predicted(self) -> Trajectory | None:
        return predicted(self.campaign.grid, self.planned.case, self._solved)

    def _solved(self, case: int) -> Trajectory | None:
        return _solved_record(self.campaign.folder, case, self.campaign)


@lru_cache(maxsize=4096)  # a record never changes once it is kept; 10 kB each
def _kept_trajectory(path: Path, stamp: int, campaign: Campaign, case: int) -> Trajectory | None:
    record = load_record(campaign.folder, case, campaign.mission)
    return None if record is None or not record.trajectory.status.ok else record.trajectory


def _solved_record(folder: Path, case: int, campaign: Campaign) -> Trajectory | None:
    """The solution of a case that is kept, read once per process; None if there is none."""
    path = record_path(folder, case)
    try:
        stamp = path.stat().st_mtime_ns
    except OSError:
        return None
    return _kept_trajectory(path, stamp, campaign, case)


@dataclass(frozen=True)
class AssembleBlock:
    """Gains and re-integration of a block whose cases are all kept."""

    campaign: Campaign
    block: Block

    @property
    def result(self) -> Path:
        """The block's file."""
        return block_path(self.campaign.folder, self.block.number)

    def run(self, announce: Callable[[int], None]) -> None:
        """Assemble and keep."""
        announce(0)
        folder, mission = self.campaign.folder, self.campaign.mission
        records = []
        for case in self.block.cases(self.campaign.grid.shape):
            record = load_record(folder, case, mission)
            if record is None:
                raise JobError(
                    f"{record_path(folder, case)} has disappeared or changed during the build"
                )
            records.append(record)
        with stopped_after(self.campaign.time_limit * len(records)):
            values = assemble(mission, self.block, records, self.campaign.gains)
        save_block(folder, self.block.number, values)

    def without(self, attempt: int) -> Job:
        """There is one way only."""
        raise JobError(f"block {self.block.number}: its re-integration exceeded its time limit")

    def give_up(self, reason: str) -> None:
        """A block is part of the file: there is no build without it."""
        raise JobError(f"block {self.block.number}: {reason}")


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
            flown = campaign.solver(mission, guess=flown)
        solves += 1
        if not flown.status.ok:
            break
    if flown is None:
        raise ValueError("path: expected at least one mission, got none")
    return flown, solves


@contextmanager
def stopped_after(seconds: float) -> Iterator[None]:
    """End this process if the block takes longer.

    The kernel does it, by a signal that nothing handles: code that is stuck in a library never comes
    back to the interpreter, where an exception could be raised.
    """
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def no_trajectory(mesh: Mesh) -> Trajectory:
    """What stands for a case that raised, hung or killed its process."""
    nan = np.full((7, mesh.n_nodes), np.nan)
    return Trajectory(mesh, nan, nan[0], np.nan, np.nan, Status.ERROR)
