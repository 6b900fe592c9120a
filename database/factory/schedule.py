"""In which order jobs run: each as soon as the records that it builds on are kept.

No layer waits for its slowest case. What a job builds on is fixed by the plan, never by what happens
to be finished, so the order of execution leaves no trace in the results.

Of the plan no more is looked at than keeps all workers busy: the tasks may be millions.
"""

from __future__ import annotations

import heapq
import queue
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.workers.job import JobError
from database.factory.engines import Engine
from database.factory.jobs import Job

LOOK = 5.0  # s
FORESIGHT = 4  # tasks looked at, over the jobs that may be under way; what waits is no work
LEAST_FORESIGHT = 64


@dataclass(frozen=True)
class Task:
    """A job, and the cases whose records it builds on."""

    job: Job
    needs: tuple[int, ...]


def run_jobs(
    tasks: Iterable[Task],
    kept: NDArray[np.bool_],
    engine: Engine,
    finished: Callable[[int], None],
) -> None:
    """Run the jobs of all `tasks`, each after those that solve what it `needs`.

    Parameters
    ----------
    tasks
        Each after those that it needs; of those that are ready the first is next.
    kept
        Which cases have a record, (c,); kept up to date.
    engine
        Runs the jobs. What a job raises is raised here.
    finished
        Called, in this thread, with the number of each case whose record is kept.
    """
    agenda = _Agenda(enumerate(tasks), kept)
    foresight = max(LEAST_FORESIGHT, FORESIGHT * engine.room)
    told: queue.SimpleQueue[tuple[int, Job, BaseException | None]] = queue.SimpleQueue()
    under_way = 0

    def submit(place: int, job: Job) -> None:
        engine.submit(job, lambda error: told.put((place, job, error)))

    while True:
        agenda.look_ahead(foresight, idle=under_way == 0)
        if not agenda.ready and under_way == 0:
            return
        while agenda.ready and under_way < engine.room:
            submit(*agenda.next_job())
            under_way += 1
        place, job, error = _next(told, engine)
        under_way -= 1
        if error is not None:
            raise error
        if not job.result.exists():
            raise JobError(
                f"{job}: its result is not in {job.result.parent}; the workers must see the "
                "same folder as this process: choose a path on a shared file system"
            )
        for case in agenda.settle(place, job):
            finished(case)


class _Agenda:
    """The tasks that have been looked at: ready, or waiting for records."""

    def __init__(self, coming: Iterator[tuple[int, Task]], kept: NDArray[np.bool_]) -> None:
        self._coming, self._kept = coming, kept
        self.ready: list[tuple[int, int, Job]] = []  # by place in the plan, then by case
        self._open: dict[int, tuple[Job, set[int]]] = {}  # by place: what it still waits for
        self._waiting = defaultdict[int, list[int]](list)  # by case: the places that wait for it

    def look_ahead(self, most: int, *, idle: bool) -> None:
        """Take tasks from the plan until there are `most`, or if all is idle until one is ready."""
        while len(self._open) + len(self.ready) < most or (idle and not self.ready):
            place, task = next(self._coming, (0, None))
            if task is None:
                return
            missing = {case for case in task.needs if not self._kept[case]}
            if missing:
                self._open[place] = task.job, missing
                for case in missing:
                    self._waiting[case].append(place)
            else:
                self._is_ready(place, task.job)

    def _is_ready(self, place: int, job: Job) -> None:
        heapq.heappush(self.ready, (place, job.cases[0] if job.cases else 0, job))

    def next_job(self) -> tuple[int, Job]:
        """The first of those that are ready, and its place."""
        place, _, job = heapq.heappop(self.ready)
        return place, job

    def settle(self, place: int, job: Job) -> list[int]:
        """What is ready now that a job is done; the cases whose records are kept."""
        left = job.left()
        for one in left:  # in the job's place: what it builds on is kept
            self._is_ready(place, one)
        open_cases = {case for one in left for case in one.cases}
        done = [case for case in job.cases if case not in open_cases]
        for case in done:
            self._kept[case] = True
            for waiting in self._waiting.pop(case, ()):
                that, missing = self._open[waiting]
                missing.discard(case)
                if not missing:
                    del self._open[waiting]
                    self._is_ready(waiting, that)
        return done


def _next(
    told: queue.SimpleQueue[tuple[int, Job, BaseException | None]], engine: Engine
) -> tuple[int, Job, BaseException | None]:
    """What is told next; while nothing is, the engine looks whether anything can be."""
    while True:
        try:
            return told.get(timeout=LOOK)
        except queue.Empty:
            engine.look()
