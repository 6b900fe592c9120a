"""Cases that the first pass leaves unsolved, once more when all others are done.

In the first pass a case starts from its neighbours towards the centre, and where their branch ends
before it, that is the end. Another branch may have come round on the other side: so now it starts from
whatever is solved nearby, also outwards and diagonally. What that solves may be a start for others: they
are tried again, in rounds, until a round solves nothing.

A round builds on the records of the rounds before it alone, all of which are kept, and keeps its own in
a folder of its own: as in the first pass, no result depends on timing, on kills or on the workers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from pathlib import Path

import numpy as np

from ampi.scp.problem.shortfall import outcome_sentence
from ampi.trajectory import Trajectory
from ampi.workers.engines import Engine
from ampi.workers.keeping import keeper
from database.factory.attempts import Attempt, follow, path_to
from database.factory.jobs import Job, Kept
from database.factory.schedule import Task, run_jobs
from database.plan.grid import Grid
from database.records.campaign import Campaign
from database.records.case_record import CaseRecord
from database.records.reader import RecordReader
from database.records.record_files import (
    Files,
    again_folder,
    is_recorded,
    load_record,
    record_path,
)

MOST_AXES = 2  # along which a start may lie beside a case: a diagonal of the grid's faces
MOST_STARTS = 6
MOST_IF_CONVERGED = 2  # for a case whose attempts came to an end that is no solution
MOST_ROUNDS = 30


def second_pass(
    campaign: Campaign, files: Files, unsolved: Collection[int], engine: Engine
) -> Campaign:
    """Try the cases again until that solves none; the campaign whose records count those rounds.

    `files` (c,) says where the records of the first pass lie: all are kept.
    """
    grid = campaign.grid
    left, todo = set(unsolved), sorted(unsolved)
    while todo and campaign.rounds < MOST_ROUNDS:
        after = replace(campaign, rounds=campaign.rounds + 1)
        after.round_folder.mkdir(exist_ok=True)
        tasks = []
        for case in todo:
            if load_record(after.round_folder, case, campaign.mission, campaign.label) is None:
                record_path(after.round_folder, case).unlink(missing_ok=True)
                around = np.array([case, *(near for near, _ in nearby(grid, case))])
                tasks.append(Task(SolveAgain(campaign, case), around))
        run_jobs(tasks, files, engine, lambda cases: None)
        campaign = after
        kept = RecordReader(campaign, {case: int(files[case]) for case in todo}).read(todo)
        solved = {case for case, record in kept.items() if record.trajectory.status.ok}
        left -= solved
        todo = sorted({near for case in solved for near, _ in nearby(grid, case)} & left)
    return campaign


def nearby(grid: Grid, case: int) -> Iterator[tuple[int, bool]]:
    """Cases one grid step away along one axis or two, and whether a step is towards the centre.

    Along one axis first.
    """
    index = np.array(np.unravel_index(case, grid.shape))
    for count in range(1, MOST_AXES + 1):
        for axes in combinations(range(len(grid.shape)), count):
            for steps in product((-1, 1), repeat=count):
                there, inward = index.copy(), False
                for axis, step in zip(axes, steps, strict=True):
                    there[axis] += step
                    inward |= abs(there[axis] - grid.centre[axis]) < abs(
                        index[axis] - grid.centre[axis]
                    )
                if np.all(there >= 0) and np.all(there < grid.shape):
                    yield int(np.ravel_multi_index(tuple(there), grid.shape)), inward


@dataclass(frozen=True)
class SolveAgain(Job):
    """Solve a case from what is solved nearby, and keep what came of it in the next round's folder."""

    campaign: Campaign
    case: int
    files: Mapping[int, int] = field(default_factory=dict)  # of the records around it
    overdue: frozenset[int] = frozenset()  # attempts that have exceeded the time limit

    def __str__(self) -> str:
        return f"case {self.case}, again"

    def evidence(self, kept: Kept) -> Path:
        """The round's record of the case."""
        return record_path(self._folder, self.case)

    def placed(self, files: Mapping[int, int]) -> SolveAgain:
        """With these files."""
        return replace(self, files=files)

    @property
    def _folder(self) -> Path:
        return again_folder(self.campaign.folder, self.campaign.rounds + 1)

    @property
    def cases(self) -> tuple[int, ...]:
        """The one."""
        return (self.case,)

    def compute(self, announce: Callable[[int], None]) -> Future[Kept]:
        """From one start after the other, until one succeeds."""
        began = time.perf_counter()
        campaign = self.campaign
        reader = RecordReader(campaign, self.files)
        before = reader.record(self.case)
        log, solves, best = [before.message], before.solves, before.trajectory
        for number, (neighbour, start) in enumerate(self._starts(reader, before)):
            attempt = Attempt(neighbour)
            if number in self.overdue:
                log.append(f"again {attempt}: Stopped at the time limit.")
                continue
            announce(number)
            path = path_to(campaign.mission, campaign.grid, self.case, attempt)
            try:
                flown, count = follow(campaign, path, start)
            except Exception as error:  # whatever it was, it belongs in the record
                log.append(f"again {attempt}: {type(error).__name__}: {error}")
                continue
            solves += count
            log.append(f"again {attempt}: {outcome_sentence(path[-1], flown)}")
            if flown.status.ok:
                best, log = flown, log[-1:]
                break
        seconds = before.seconds + time.perf_counter() - began
        record = CaseRecord(self.case, best, "; ".join(log), solves, seconds)
        keep = campaign.keeping([record], self._folder)

        def whole() -> Kept:
            keep()
            return ()  # of the first pass

        return keeper().submit(whole)

    def _starts(self, reader: RecordReader, before: CaseRecord) -> list[tuple[int, Trajectory]]:
        """What has not been tried: in the first round all but the neighbours, then what is new.

        A case that has converged elsewhere has followed its branch from within to the end: only what
        lies outwards on every axis can be on another.
        """
        campaign, found = self.campaign, []
        converged = before.trajectory.status.converged
        axes_of_neighbours = set(campaign.grid.beside(self.case))
        for near, inward in nearby(campaign.grid, self.case):
            if campaign.rounds:
                if not is_recorded(campaign.round_folder, near):
                    continue
            elif inward and (converged or near in axes_of_neighbours):
                continue
            solved = reader.solved(near)
            if solved is not None:
                found.append((near, solved))
        return found[: MOST_IF_CONVERGED if converged else MOST_STARTS]

    def without(self, attempt: int) -> SolveAgain:
        """The same case from the other starts."""
        return replace(self, overdue=self.overdue | {attempt})

    def give_up(self, reason: str) -> Kept:
        """What the rounds before had found, and why there is no more."""
        before = RecordReader(self.campaign, self.files).record(self.case)
        message = f"{before.message}; again: {reason}"
        record = CaseRecord(self.case, before.trajectory, message, before.solves, before.seconds)
        self.campaign.keeping([record], self._folder)()
        return ()
