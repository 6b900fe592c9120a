"""The kinds of work in a build: solve cases together, one alone, assemble a block.

Most cases need nothing but Newton's iteration from where their neighbours lead, and that is several
times faster for many at once: `SolveTogether` keeps a record of those that it solves, and leaves the
others to `SolveCase`, one by one. That one begins with the same attempt, to the same bits: a record
does not show which of the two has made it, and portions may be cut anywhere.

A case is tried from each neighbour at once, then along paths of more and more steps in p, at last from
nothing; what is still unsolved when all is done is tried once more (`second_pass`). An attempt
that fails, raises or exceeds its time limit is a line of the record, and the next one follows; a case
without a solution is a record with a status, never a hole.

A job depends on the mission and on records already kept, on nothing else. It may be run anywhere, any
number of times, and always keeps the same result.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from ampi.scp.problem.shortfall import verdict
from ampi.scp.solve import solve_family
from ampi.trajectory import Status, Trajectory
from ampi.workers.job import JobError
from database.factory.attempts import (
    attempts,
    first_start,
    follow,
    is_vain,
    no_trajectory,
    path_to,
    stopped_after,
)
from database.file.blocks import Block, assemble, block_shape
from database.file.hdf5_file import encoded_block
from database.plan.continuation import PlannedCase
from database.plan.prediction import predicted
from database.records.campaign import Campaign, lost
from database.records.record_files import (
    CaseRecord,
    block_path,
    is_recorded,
    keeping_block,
    record_path,
)


class Job(ABC):
    """A job (ampi.workers.job) of a build: what it leaves is on disk, and its result None."""

    @property
    @abstractmethod
    def result(self) -> Path:
        """What the job leaves."""

    @property
    def cases(self) -> tuple[int, ...]:
        """Whose records are kept after it, and after those that it has `left`."""
        return ()

    def left(self) -> list[Job]:
        """Once it is done: jobs for the cases that it was no match for."""
        return []

    @abstractmethod
    def compute(self, announce: Callable[[int], None]) -> Future[None]:
        """Do it, telling the number of each attempt before it begins; the result is then being flushed.

        A flush takes milliseconds, and the processor can be computing the next job.
        """

    def run(self, announce: Callable[[int], None]) -> None:
        """Do it, until the result is kept."""
        self.compute(announce).result()

    @abstractmethod
    def without(self, attempt: int) -> Job:
        """The same job, but for an attempt that has exceeded its time limit."""

    @abstractmethod
    def give_up(self, reason: str) -> None:
        """Keep a result that says why there is none."""


@dataclass(frozen=True)
class SolveTogether(Job):
    """Solve what Newton's iteration solves of some cases of one layer, and keep the results."""

    campaign: Campaign
    planned: tuple[PlannedCase, ...]

    def __str__(self) -> str:
        return f"cases {', '.join(str(case) for case in self.cases)}"

    @property
    def result(self) -> Path:
        """The folder of the records: there may be some or none."""
        return self.campaign.folder

    @property
    def cases(self) -> tuple[int, ...]:
        """All of them."""
        return tuple(p.case for p in self.planned)

    def left(self) -> list[Job]:
        """One for each case without a record."""
        return [
            SolveCase(self.campaign, p)
            for p in self.planned
            if not is_recorded(self.campaign.folder, p.case)
        ]

    def compute(self, announce: Callable[[int], None]) -> Future[None]:
        """All at once."""
        announce(0)
        campaign, began = self.campaign, time.perf_counter()
        solved = lru_cache(maxsize=None)(campaign.solved)  # the portion shares its neighbours
        starts = [(p.case, first_start(campaign.grid, p, solved)) for p in self.planned]
        ready = [(case, *start) for case, start in starts if start is not None]
        missions = [
            campaign.mission.with_parameters(campaign.grid.point(case)) for case, *_ in ready
        ]
        with stopped_after(campaign.time_limit * max(1, len(ready))):
            try:
                found = solve_family(missions, [start for *_, start in ready])
            except Exception:  # one of them; alone each has its own log
                found = [None] * len(ready)
        seconds = (time.perf_counter() - began) / max(1, len(ready))
        records = [
            CaseRecord(case, flown, f"{attempt}: {flown.status.sentence}", 1, seconds)
            for (case, attempt, _), flown in zip(ready, found, strict=True)
            if flown is not None
        ]
        return keeper().submit(campaign.keeping(records))

    def without(self, attempt: int) -> SolveTogether:
        """Nothing: each case will be tried alone."""
        return replace(self, planned=())

    def give_up(self, reason: str) -> None:
        """Leave the cases to be tried alone; whichever is at fault will have a record of its own."""


@lru_cache(maxsize=1)
def keeper() -> ThreadPoolExecutor:
    """The thread that waits for the disk."""
    return ThreadPoolExecutor(1)


@dataclass(frozen=True)
class SolveCase(Job):
    """Solve one case from its neighbours' records and keep the result."""

    campaign: Campaign
    planned: PlannedCase
    overdue: frozenset[int] = frozenset()  # attempts that have exceeded the time limit

    def __str__(self) -> str:
        return f"case {self.planned.case}"

    @property
    def result(self) -> Path:
        """The case's record."""
        return record_path(self.campaign.folder, self.planned.case)

    @property
    def cases(self) -> tuple[int, ...]:
        """The one."""
        return (self.planned.case,)

    def compute(self, announce: Callable[[int], None]) -> Future[None]:
        """Attempt after attempt, until one succeeds."""
        began = time.perf_counter()
        mission, grid = self.campaign.mission, self.campaign.grid
        starts = self._starts()
        continued = predicted(grid, self.planned.case, self.campaign.solved)
        log, solves = list[str](), 0
        best: Trajectory | None = None
        ways = attempts(list(starts), predicted=continued is not None)
        ended: list[Status | None] = []  # by attempt; None if there is no trajectory
        for number, attempt in enumerate(ways):
            ended.append(None)
            if is_vain(attempt, ways, ended):
                continue
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
            ended[-1] = flown.status
            log.append(f"{attempt}: {verdict(path[count - 1], flown)}")
            if flown.status.ok:
                best, log = flown, log[-1:]
                break
            if count == len(path) and (best is None or attempt.neighbour is not None):
                best = flown  # it has come to the case's own problem, if not to a solution
        trajectory = no_trajectory(mission.pseudospectral_mesh) if best is None else best
        seconds = time.perf_counter() - began
        record = CaseRecord(self.planned.case, trajectory, "; ".join(log), solves, seconds)
        return keeper().submit(self.campaign.keeping([record]))

    def without(self, attempt: int) -> SolveCase:
        """The same case along the other paths."""
        return replace(self, overdue=self.overdue | {attempt})

    def give_up(self, reason: str) -> None:
        """A record with the status ERROR."""
        nothing = no_trajectory(self.campaign.mission.pseudospectral_mesh)
        record = CaseRecord(self.planned.case, nothing, reason, 0, 0.0)
        self.campaign.keeping([record])()

    def _starts(self) -> dict[int, Trajectory]:
        """The solved neighbours, best first."""
        found = {n: self.campaign.solved(n) for n in self.planned.neighbours}
        return {n: trajectory for n, trajectory in found.items() if trajectory is not None}


@dataclass(frozen=True)
class AssembleBlock(Job):
    """Gains and re-integration of a block whose cases are all kept."""

    campaign: Campaign
    block: Block

    def __str__(self) -> str:
        return f"block {self.block.number}"

    @property
    def result(self) -> Path:
        """The block's file."""
        return block_path(self.campaign.round_folder, self.block.number)

    def compute(self, announce: Callable[[int], None]) -> Future[None]:
        """Assemble and keep."""
        announce(0)
        folder, mission = self.campaign.folder, self.campaign.mission
        records = []
        for case in self.block.cases(self.campaign.grid.shape):
            record = self.campaign.record(case)
            if record is None:
                raise JobError(lost(folder, case))
            records.append(record)
        with stopped_after(self.campaign.time_limit * len(records)):
            values = assemble(
                mission,
                self.block,
                records,
                self.campaign.gains,
                judged=self.campaign.judged,
            )
        encoded = encoded_block(values, block_shape(self.campaign.grid.shape))
        label = self.campaign.label
        keeping = keeping_block(self.campaign.round_folder, self.block.number, encoded, label)
        return keeper().submit(keeping)

    def without(self, attempt: int) -> Job:
        """There is one way only."""
        raise JobError(f"block {self.block.number}: its re-integration exceeded its time limit")

    def give_up(self, reason: str) -> None:
        """A block is part of the file: there is no build without it."""
        raise JobError(f"block {self.block.number}: {reason}")
