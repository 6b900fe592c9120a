"""In which order jobs run: each as soon as the records that it builds on are kept.

No layer waits for its slowest case. What a job builds on is fixed by the plan, never by what happens
to be finished, so the order of execution leaves no trace in the results.

Of the plan no more is looked at than keeps all workers busy: the tasks may be hundreds of thousands.
"""

from __future__ import annotations

import heapq
import queue
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.workers.engines import Engine, next_told
from ampi.workers.keeping import require_seen
from database.factory.jobs import Job, Kept
from database.records.record_files import NOT_KEPT, Files

FORESIGHT = 4  # tasks looked at, over the jobs that may be under way; what waits is no work
LEAST_FORESIGHT = 64


@dataclass(frozen=True, eq=False)
class Task:
    """A job, and the cases whose records it builds on, (n,)."""

    job: Job
    needs: NDArray[np.int64]


def run_jobs(
    tasks: Iterable[Task],
    files: Files,
    engine: Engine,
    finished: Callable[[tuple[int, ...]], None],
) -> None:
    """Run the jobs of all `tasks`, each after those that solve what it `needs`.

    Parameters
    ----------
    tasks
        Each after those that it needs; of those that are ready the first is next.
    files
        Where the record of each case lies, (c,); kept up to date.
    engine
        Runs the jobs. What a job raises is raised here.
    finished
        Called, in this thread, with the cases of each file of records that is kept. What is ready by
        then is under way.
    """
    agenda = _Agenda(enumerate(tasks), files)
    foresight = max(LEAST_FORESIGHT, FORESIGHT * engine.room)
    told: queue.SimpleQueue[tuple[int, Job, Kept | BaseException]] = queue.SimpleQueue()
    under_way = 0

    def submit(place: int, job: Job) -> None:
        engine.submit(job, lambda found: told.put((place, job, found)))

    def submit_ready() -> None:
        nonlocal under_way
        while agenda.ready and under_way < engine.room:
            submit(*agenda.next_job())
            under_way += 1

    while True:
        agenda.look_ahead(foresight, idle=under_way == 0)
        submit_ready()
        if under_way == 0:
            return
        place, job, found = next_told(told, engine)
        under_way -= 1
        if isinstance(found, BaseException):
            raise found
        evidence = job.evidence(found)
        if evidence is not None:
            require_seen(job, evidence)
        agenda.settle(place, job, found)
        submit_ready()
        for cases in found:
            finished(cases)


class _Agenda:
    """The tasks that have been looked at: ready, or waiting for records.

    A task that waits is looked at again when one certain case of those that it misses is kept.
    """

    def __init__(self, coming: Iterator[tuple[int, Task]], files: Files) -> None:
        self._coming, self._files = coming, files
        self.ready: list[tuple[int, int, Job]] = []  # by place in the plan, then by case
        self._waiting = defaultdict[int, list[tuple[int, Task]]](list)  # by the case waited for
        self._waits = 0  # how many

    def look_ahead(self, most: int, *, idle: bool) -> None:
        """Take tasks from the plan until there are `most`, or if all is idle until one is ready."""
        while self._waits + len(self.ready) < most or (idle and not self.ready):
            place, task = next(self._coming, (0, None))
            if task is None:
                return
            self._place(place, task)

    def _place(self, place: int, task: Task) -> None:
        """Among those that are ready, or that wait."""
        missing = task.needs[self._files[task.needs] == NOT_KEPT]
        if len(missing):
            self._waiting[int(missing[-1])].append((place, task))
            self._waits += 1
        else:
            self._is_ready(place, task.job.placed(self._where(task.needs)))

    def _where(self, cases: NDArray[np.int64]) -> dict[int, int]:
        return dict(zip(cases.tolist(), self._files[cases].tolist(), strict=True))

    def _is_ready(self, place: int, job: Job) -> None:
        heapq.heappush(self.ready, (place, job.cases[0] if job.cases else 0, job))

    def next_job(self) -> tuple[int, Job]:
        """The first of those that are ready, and its place."""
        place, _, job = heapq.heappop(self.ready)
        return place, job

    def settle(self, place: int, job: Job, kept: Kept) -> None:
        """Take note of what a job has kept; what waited for that, or for what it has left, is ready."""
        for one in job.left(kept):  # in the job's place: what it builds on is kept
            self._is_ready(place, one)
        for cases in kept:
            self._files[list(cases)] = cases[0]
        for cases in kept:
            for case in cases:
                for waiting in self._waiting.pop(case, ()):
                    self._waits -= 1
                    self._place(*waiting)
