"""In which order jobs run: each as soon as the results that it builds on are kept.

No layer waits for its slowest case. What a job builds on is fixed by the plan, never by what happens
to be finished, so the order of execution leaves no trace in the results.
"""

from __future__ import annotations

import heapq
import queue
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping

from database.campaign import JobError
from database.engines import Engine
from database.jobs import Job

LOOK = 5.0  # s


def run_jobs(
    jobs: Mapping[str, Job],
    needs: Mapping[str, Collection[str]],
    engine: Engine,
    finished: Callable[[str], None],
) -> None:
    """Run all `jobs`, each after those it `needs`; needs that are no job are met already.

    Of the jobs that are ready the first in the order of `jobs` is next. `finished` is called, in this
    thread, with the name of each job whose result is kept. What a job raises is raised here.
    """
    open_needs = {name: {n for n in needs[name] if n in jobs} for name in jobs}
    waited_for = defaultdict[str, list[str]](list)
    for name, open_ones in open_needs.items():
        for n in open_ones:
            waited_for[n].append(name)
    place = {name: k for k, name in enumerate(jobs)}
    ready: list[tuple[int, str]] = []
    done: list[str] = []
    told: queue.SimpleQueue[tuple[str, BaseException | None]] = queue.SimpleQueue()
    under_way = 0

    def release(name: str) -> None:
        if jobs[name].kept:
            done.append(name)
        else:
            heapq.heappush(ready, (place[name], name))

    def submit(name: str) -> None:
        engine.submit(jobs[name], lambda error: told.put((name, error)))

    for name, open_ones in open_needs.items():
        if not open_ones:
            release(name)
    while ready or under_way or done:
        while ready and under_way < engine.room:
            submit(heapq.heappop(ready)[1])
            under_way += 1
        if not done:
            name, error = _next(told, engine)
            under_way -= 1
            if error is not None:
                raise error
            if not jobs[name].result.exists():
                raise JobError(
                    f"{name}: its result is not in {jobs[name].result.parent}; the workers must see the "
                    "same folder as this process: choose a path on a shared file system"
                )
            done.append(name)
        name = done.pop()
        for waiting in waited_for.pop(name, ()):
            open_needs[waiting].discard(name)
            if not open_needs[waiting]:
                release(waiting)
        finished(name)


def _next(
    told: queue.SimpleQueue[tuple[str, BaseException | None]], engine: Engine
) -> tuple[str, BaseException | None]:
    """What is told next; while nothing is, the engine looks whether anything can be."""
    while True:
        try:
            return told.get(timeout=LOOK)
        except queue.Empty:
            engine.look()
