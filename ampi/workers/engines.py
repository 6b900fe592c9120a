"""Where jobs run: processes of this machine, or a dask.distributed cluster.

Both engines give every job to a `Supervisor`, in a thread here or in a worker there, so that time
limits and dying processes mean the same on both. A node of a cluster that is lost is the scheduler's
matter: it runs the job elsewhere. joblib has no part in it: a dying process ends its loky call, and
its dask backend then waits for ever.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, Protocol, TypeVar

from ampi.workers.job import Job, JobError
from ampi.workers.software import require_same, software
from ampi.workers.supervisor import Supervisor

Result = TypeVar("Result")
Message = TypeVar("Message")
Tell = Callable[[Result | BaseException], None]

RETRIES = 3  # of a job that raises on a cluster: a folder may be out of reach for a moment
LONELY = 120.0  # s without any worker
LOOK = 5.0  # s without a result, after which an engine looks whether there can be one
IMPORTABLE = "__import__('importlib.util').util.find_spec({package!r}) is not None"
AHEAD = 3  # jobs under way per worker: one is computed, one flushed, one on its way


class Engine(Protocol):
    """Runs jobs; `tell` is called from any thread with a job's result, or what it raised."""

    @property
    def room(self) -> int:
        """How many jobs may be under way."""

    @property
    def width(self) -> int:
        """Into how many portions a layer is best cut, if it is to be cut into few."""

    @property
    def workers(self) -> int:
        """How many jobs are computed at once, as far as is known now; one at least."""

    def submit(self, job: Job[Result], tell: Tell[Result]) -> None:
        """Run a job some time."""

    def look(self) -> None:
        """Raise JobError if there is nobody left to run a job."""

    def close(self) -> None:
        """Drop what is under way and end."""


class LocalEngine:
    """`n_jobs` worker processes that import `module`; a thread watches each job."""

    def __init__(self, module: str, n_jobs: int) -> None:
        self._supervisor = Supervisor(module, most=n_jobs)
        self.room, self.width, self.workers = AHEAD * n_jobs, 2 * n_jobs, n_jobs
        self._threads = ThreadPoolExecutor(self.room)
        for _ in range(n_jobs):  # their imports take longer than the first jobs
            self._threads.submit(self._supervisor.start_worker)

    def submit(self, job: Job[Result], tell: Tell[Result]) -> None:
        """Run a job when a worker is free."""
        future = self._threads.submit(self._supervisor.run, job)
        future.add_done_callback(
            lambda f: None if f.cancelled() else tell(f.exception() or f.result())
        )

    def look(self) -> None:
        """Workers are replaced as they die."""

    def close(self) -> None:
        """End workers and threads."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._supervisor.close()
        self._threads.shutdown()


class ClusterEngine:
    """The workers of a dask.distributed client, for jobs that need `module`.

    They must see the folders that its jobs name.
    """

    room = width = 1000  # the scheduler has its own queues: enough for any workers, and bounded

    def __init__(self, module: str, client: Any) -> None:
        from distributed.scheduler import KilledWorker

        self._module, self._client, self._killed = module, client, KilledWorker
        self._futures: set[Any] = set()
        self._seen = time.monotonic()
        package = module.partition(".")[0]
        for worker, importable in client.run(eval, IMPORTABLE.format(package=package)).items():
            if not importable:
                raise JobError(f"the worker {worker} cannot import ampi; install it there")

    @property
    def workers(self) -> int:
        """The threads of all workers: they come and go."""
        return max(1, sum(self._client.nthreads().values()))

    def submit(self, job: Job[Result], tell: Tell[Result]) -> None:
        """Run a job on some worker, and again elsewhere if that worker is lost."""
        arguments = (self._module, job, software())
        future = self._client.submit(run_supervised, *arguments, pure=False, retries=RETRIES)
        self._futures.add(future)

        def done(finished: Any) -> None:
            self._futures.discard(finished)
            if finished.status == "finished":
                tell(finished.result())
            elif finished.status == "error":
                outcome = self.outcome(job, finished.exception())
                tell(outcome)
            else:
                tell(JobError(f"the cluster has dropped a job ({finished.status})"))

        future.add_done_callback(done)

    def outcome(self, job: Job[Result], error: BaseException) -> Result | BaseException:
        """A job whose workers were lost time and again gives up, as on one machine."""
        if isinstance(error, OSError | JobError):
            return error
        if not isinstance(error, self._killed):
            text = " ".join(str(error).split())
            return JobError(f"a worker of the cluster: {type(error).__name__}: {text}")
        try:
            return job.give_up(
                "The cluster lost every worker that tried it."
            )  # no address: same bytes
        except (OSError, JobError) as failure:
            return failure

    def look(self) -> None:
        """Nobody knows whether workers that are gone will come back: then there is an end."""
        if self._client.scheduler_info()["workers"]:
            self._seen = time.monotonic()
        elif time.monotonic() - self._seen > LONELY:
            raise JobError(
                f"the cluster has had no workers for {LONELY:g} s; start some, wait for them "
                "(client.wait_for_workers)"
            )

    def close(self) -> None:
        """Drop what is under way; the client stays open, it is not ours."""
        self._client.cancel(list(self._futures))


def engine_for(module: str, n_jobs: int, client: Any = None) -> LocalEngine | ClusterEngine:
    """`n_jobs` processes of this machine, or a `distributed.Client`'s workers, for jobs of `module`.

    Raises
    ------
    JobError
        If a worker of the cluster cannot import the module's package.
    """
    return LocalEngine(module, n_jobs) if client is None else ClusterEngine(module, client)


def next_told(told: queue.SimpleQueue[Message], engine: Engine) -> Message:
    """What is told next; while nothing is, the engine looks whether anything can be."""
    while True:
        try:
            return told.get(timeout=LOOK)
        except queue.Empty:
            engine.look()


@cache
def _supervisor(module: str) -> Supervisor:
    return Supervisor(module)


def run_supervised(module: str, job: Job[Result], expected: Mapping[str, str]) -> Result:
    """A job in a process of its own on a cluster's worker, which it cannot bring down.

    Raises
    ------
    JobError
        If the worker has other software than the file will name.
    """
    require_same(software(), "a worker of the cluster", expected)
    return _supervisor(module).run(job)
