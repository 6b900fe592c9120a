"""Results of jobs in the order of the jobs, with a bounded number of them computed ahead.

However many jobs there are, `AHEAD` per worker are under way or wait to be taken, and no more: what
takes the results decides the pace, and memory does not grow with the number of jobs.
"""

from __future__ import annotations

import queue
from collections.abc import Generator, Iterable
from contextlib import closing
from itertools import chain, islice
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from ampi.workers.engines import AHEAD, Engine, engine_for, next_told
from ampi.workers.job import Job
from ampi.workers.supervisor import require_workers

Result = TypeVar("Result")


def in_workers(
    module: str, jobs: Iterable[Job[Result]], n_jobs: int, client: Any = None
) -> Generator[Result, None, None]:
    """The results of `jobs` in their order; a job is asked for when it may begin.

    One worker would have to be waited for, and this process is there: it runs the jobs itself.

    Parameters
    ----------
    module
        What jobs need: workers import it when they start.
    n_jobs
        Worker processes on this machine.
    client
        A `distributed.Client`: its workers instead.

    Raises
    ------
    JobError, OSError
        If a job has no result; the workers end, as whenever the iterator is closed.
    """
    require_workers(n_jobs)
    jobs = iter(jobs)
    first = list(islice(jobs, n_jobs))
    if client is None and len(first) <= 1:
        for job in chain(first, jobs):
            with threadpool_limits(limits=1):  # as in a worker, or the last bits would differ
                result = job.compute(lambda attempt: None).result()
            yield result
    elif first:
        with closing(engine_for(module, len(first), client)) as engine:
            yield from _in_order(engine, chain(first, jobs))


def _in_order(engine: Engine, jobs: Iterable[Job[Result]]) -> Generator[Result, None, None]:
    coming = enumerate(jobs)
    told: queue.SimpleQueue[tuple[int, Result | BaseException]] = queue.SimpleQueue()
    found = dict[int, Result | BaseException]()
    begun, taken = 0, 0

    def begin(number: int, job: Job[Result]) -> None:
        engine.submit(job, lambda result: told.put((number, result)))

    while True:
        for number, job in islice(coming, max(0, taken + AHEAD * engine.workers - begun)):
            begin(number, job)
            begun += 1
        if taken == begun:
            return
        while taken not in found:
            number, result = next_told(told, engine)
            found[number] = result
        result = found.pop(taken)
        if isinstance(result, BaseException):
            raise result
        taken += 1
        yield result
