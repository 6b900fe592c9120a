"""The kinds of work in a build: solve a portion of cases, one alone, assemble a block.

Most cases need nothing but the first attempt, and what a case costs besides is shared by a portion: one
job, one file of records, one word to the driver. `SolvePortion` keeps records of those that it solves
(`ampi.solve_family`'s all at once, which is several times faster; another optimiser's one after the
other), and leaves the rest to `SolveCase`, one by one. That one begins with the same attempt, to the
same bits: a record does not show which of the two has made it, and portions may be cut anywhere.

A case is tried from each neighbour at once, then along paths of more and more steps in p, at last from
nothing; what is still unsolved when all is done is tried once more (`second_pass`). An attempt
that fails, raises or exceeds its time limit is a line of the record, and the next one follows; a case
without a solution is a record with a status, never a hole.

A job depends on the mission and on records already kept, on nothing else; it is told in which files they
lie. It may be run anywhere, any number of times, and always keeps the same result.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ampi.scp.problem.shortfall import outcome_sentence
from ampi.scp.solve import solve_family
from ampi.trajectory import Status, Trajectory
from ampi.workers.job import JobError, finished
from ampi.workers.keeping import keeper
from database.factory.attempts import (
    Attempt,
    attempts,
    first_start,
    follow,
    is_vain,
    no_trajectory,
    path_to,
    solve_one,
    stopped_after,
)
from database.file.block_sensitivities import block_sensitivities
from database.file.blocks import Block, assemble, block_shape
from database.file.encoded_block import encoded_block
from database.plan.continuation import planned
from database.plan.prediction import predicted
from database.records.campaign import Campaign
from database.records.case_record import CaseRecord
from database.records.reader import RecordReader
from database.records.record_files import block_path, keeping_block, record_path

MODULE = __name__  # what workers import
Kept = tuple[tuple[int, ...], ...]  # what a job has kept of the first pass: the cases of each file
FLUSH_AFTER = 1.0  # s that a record waits for others of its portion, at most
Start = tuple[int, Attempt, Trajectory]  # a case, and where it begins


class Job(ABC):
    """A job (ampi.workers.job) of a build: its result is which records it has kept."""

    campaign: Campaign

    @property
    def cases(self) -> tuple[int, ...]:
        """Whose records are kept after it, and after those that it has `left`."""
        return ()

    @abstractmethod
    def evidence(self, kept: Kept) -> Path | None:
        """A file that it leaves, with what it has `kept`; None if it has left none."""

    def placed(self, files: Mapping[int, int]) -> Job:
        """The job, told in which files the records lie that it builds on."""
        return self

    def left(self, kept: Kept) -> list[Job]:
        """Once it is done: jobs for the cases that it was no match for."""
        return []

    @abstractmethod
    def compute(self, announce: Callable[[int], None]) -> Future[Kept]:
        """Do it, telling the number of each attempt before it begins; the result is then being flushed.

        A flush takes milliseconds, and the processor can be computing the next job.
        """

    def run(self, announce: Callable[[int], None]) -> Kept:
        """Do it, until the result is kept."""
        return self.compute(announce).result()

    @abstractmethod
    def without(self, attempt: int) -> Job:
        """The same job, but for an attempt that has exceeded its time limit."""

    @abstractmethod
    def give_up(self, reason: str) -> Kept:
        """Keep a result that says why there is none."""


@dataclass(frozen=True)
class SolvePortion(Job):
    """Make the first attempt at some cases of one layer, and keep the results of those it solves."""

    campaign: Campaign
    portion: tuple[int, ...]
    files: Mapping[int, int] = field(default_factory=dict)  # of the records that it builds on
    overdue: frozenset[int] = frozenset()  # attempts that have exceeded the time limit

    def __str__(self) -> str:
        return f"cases {', '.join(str(case) for case in self.cases)}"

    @property
    def cases(self) -> tuple[int, ...]:
        """All of them."""
        return self.portion

    def evidence(self, kept: Kept) -> Path | None:
        """The first file of records: there may be some or none."""
        return record_path(self.campaign.folder, kept[0][0]) if kept else None

    def placed(self, files: Mapping[int, int]) -> SolvePortion:
        """With these files."""
        return replace(self, files=files)

    def left(self, kept: Kept) -> list[Job]:
        """One for each case without a record."""
        solved = {case for file in kept for case in file}
        return [
            SolveCase(self.campaign, case, self.files)
            for case in self.portion
            if case not in solved
        ]

    def compute(self, announce: Callable[[int], None]) -> Future[Kept]:
        """All at once, or one after the other."""
        campaign = self.campaign
        if campaign.together:
            if self.overdue:
                return finished(())
            announce(0)
        reader = RecordReader(campaign, self.files)
        solved = reader.read(self.files)  # each file once; the portion shares its neighbours

        def optimum(case: int) -> Trajectory | None:
            trajectory = (solved[case] if case in solved else reader.record(case)).trajectory
            return trajectory if trajectory.status.ok else None

        starts = list[Start]()
        for p in planned(campaign.grid, np.array(self.portion)):
            start = first_start(campaign.grid, p, optimum)
            if start is not None:
                starts.append((p.case, *start))
        if campaign.together:
            return _flushed(campaign, self._together(starts))
        return _flushed(campaign, self._in_turn(starts, announce))

    def _together(self, starts: list[Start]) -> Iterator[CaseRecord]:
        campaign, began = self.campaign, time.perf_counter()
        points = np.array([campaign.grid.point(case) for case, *_ in starts])
        with stopped_after(campaign.time_limit * max(1, len(starts))):
            try:
                family = campaign.mission.family(points.reshape(len(starts), -1))
                found = solve_family(family, [start for *_, start in starts], campaign.settings)
            except Exception:  # one of them; alone each has its own log
                found = [None] * len(starts)
        seconds = (time.perf_counter() - began) / max(1, len(starts))
        for (case, attempt, _), flown in zip(starts, found, strict=True):
            if flown is not None:
                yield CaseRecord(case, flown, f"{attempt}: {flown.status.sentence}", 1, seconds)

    def _in_turn(
        self, starts: list[Start], announce: Callable[[int], None]
    ) -> Iterator[CaseRecord]:
        """Each case is an attempt of its own, with its own time limit."""
        campaign = self.campaign
        for number, (case, attempt, start) in enumerate(starts):
            if number in self.overdue:
                continue
            announce(number)
            began = time.perf_counter()
            mission = campaign.mission.with_parameters(campaign.grid.point(case))
            with stopped_after(campaign.time_limit):
                try:
                    flown = solve_one(campaign, mission, start)
                except Exception:  # alone it has its log
                    continue
            if flown.status.ok:
                message = f"{attempt}: {outcome_sentence(mission, flown)}"
                yield CaseRecord(case, flown, message, 1, time.perf_counter() - began)

    def without(self, attempt: int) -> SolvePortion:
        """The same portion; what was being solved will be tried alone."""
        return replace(self, overdue=self.overdue | {attempt})

    def give_up(self, reason: str) -> Kept:
        """Leave the cases to be tried alone; whichever is at fault will have a record of its own."""
        return ()


def _flushed(campaign: Campaign, records: Iterable[CaseRecord]) -> Future[Kept]:
    """Bring records to the disk, in one file if they come quickly; the last flush is still to come."""
    kept, waiting, flushes, since = list[tuple[int, ...]](), list[CaseRecord](), [], 0.0
    for record in records:
        if not waiting:
            since = time.perf_counter()
        waiting.append(record)
        if time.perf_counter() - since > FLUSH_AFTER:
            kept.append(tuple(r.case for r in waiting))
            flushes.append(keeper().submit(campaign.keeping(waiting)))
            waiting = []
    if waiting:
        kept.append(tuple(r.case for r in waiting))
        flushes.append(keeper().submit(campaign.keeping(waiting)))

    def whole() -> Kept:
        for flush in flushes:
            flush.result()
        return tuple(kept)

    return keeper().submit(whole)


@dataclass(frozen=True)
class SolveCase(Job):
    """Solve one case from its neighbours' records and keep the result."""

    campaign: Campaign
    case: int
    files: Mapping[int, int] = field(default_factory=dict)  # of the records that it builds on
    overdue: frozenset[int] = frozenset()  # attempts that have exceeded the time limit

    def __str__(self) -> str:
        return f"case {self.case}"

    @property
    def cases(self) -> tuple[int, ...]:
        """The one."""
        return (self.case,)

    def evidence(self, kept: Kept) -> Path:
        """The case's record."""
        return record_path(self.campaign.folder, self.case)

    def placed(self, files: Mapping[int, int]) -> SolveCase:
        """With these files."""
        return replace(self, files=files)

    def compute(self, announce: Callable[[int], None]) -> Future[Kept]:
        """Attempt after attempt, until one succeeds."""
        began = time.perf_counter()
        mission, grid = self.campaign.mission, self.campaign.grid
        reader = RecordReader(self.campaign, self.files)
        (here,) = planned(grid, np.array([self.case]))
        solved = {n: reader.solved(n) for n in here.neighbours}  # best first
        starts = {n: trajectory for n, trajectory in solved.items() if trajectory is not None}
        continued = predicted(grid, self.case, reader.solved)
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
            path = path_to(mission, grid, self.case, attempt)
            try:
                flown, count = follow(self.campaign, path, start)
            except Exception as error:  # whatever it was, it belongs in the record
                log.append(f"{attempt}: {type(error).__name__}: {error}")
                continue
            solves += count
            ended[-1] = flown.status
            log.append(f"{attempt}: {outcome_sentence(path[count - 1], flown)}")
            if flown.status.ok:
                best, log = flown, log[-1:]
                break
            if count == len(path) and (best is None or attempt.neighbour is not None):
                best = flown  # it has come to the case's own problem, if not to a solution
        trajectory = no_trajectory(mission) if best is None else best
        seconds = time.perf_counter() - began
        record = CaseRecord(self.case, trajectory, "; ".join(log), solves, seconds)
        return _flushed(self.campaign, [record])

    def without(self, attempt: int) -> SolveCase:
        """The same case along the other paths."""
        return replace(self, overdue=self.overdue | {attempt})

    def give_up(self, reason: str) -> Kept:
        """A record with the status ERROR."""
        nothing = no_trajectory(self.campaign.mission)
        record = CaseRecord(self.case, nothing, reason, 0, 0.0)
        self.campaign.keeping([record])()
        return (self.cases,)


@dataclass(frozen=True)
class AssembleBlock(Job):
    """Gains and re-integration of a block whose cases are all kept."""

    campaign: Campaign
    block: Block
    files: Mapping[int, int] = field(default_factory=dict)  # of its cases' records

    def __str__(self) -> str:
        return f"block {self.block.number}"

    def evidence(self, kept: Kept) -> Path:
        """The block's file."""
        return block_path(self.campaign.round_folder, self.block.number)

    def placed(self, files: Mapping[int, int]) -> AssembleBlock:
        """With these files."""
        return replace(self, files=files)

    def compute(self, announce: Callable[[int], None]) -> Future[Kept]:
        """Assemble and keep."""
        announce(0)
        campaign, shape = self.campaign, self.campaign.grid.shape
        cases = self.block.cases(shape).tolist()
        kept = RecordReader(campaign, self.files).read(cases)
        with stopped_after(campaign.time_limit * len(cases)):
            values = assemble(
                campaign.mission,
                self.block,
                [kept[case] for case in cases],
                campaign.gains,
                judged=campaign.judged,
            )
            if campaign.sensitivities:
                values |= block_sensitivities(campaign, self.block, values)
        encoded = encoded_block(values, block_shape(shape)).packed()
        flush = keeping_block(campaign.round_folder, self.block.number, encoded, campaign.label)

        def whole() -> Kept:
            flush()
            return ()

        return keeper().submit(whole)

    def without(self, attempt: int) -> Job:
        """There is one way only."""
        raise JobError(f"block {self.block.number}: its re-integration exceeded its time limit")

    def give_up(self, reason: str) -> Kept:
        """A block is part of the file: there is no build without it."""
        raise JobError(f"block {self.block.number}: {reason}")
