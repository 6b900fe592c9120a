"""Jobs in processes that may die, and what follows when one does.

A worker that dies takes its job with it and nothing else. What ended it decides what comes next:

- the alarm that a job has set (`stopped_after`): the attempt under way has exceeded its time limit;
  it is begun once more, for the process may have been stopped meanwhile; if it is overdue
  again, the job runs without that attempt;
- anything else (a crash in native code, the kernel short of memory, an operator): the same job runs
  again as it was, because its result must not depend on accidents; after `DEATHS` of them the job
  itself is held to be the cause, and gives up.

A worker leads a process group of its own: what its job has started ends with it. Workers are forked from
one process that has imported what they need (`fork_server`), where the system allows it.

A worker that dies before it is ready has nothing to do with any job: after `DEATHS` such failures
in a row there is no point in starting another.

While a worker flushes what it has computed it can take the next job. If it dies then, the job that was
being flushed runs again; it was not the cause.
"""

from __future__ import annotations

import math
import operator
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

from ampi.workers import fork_server
from ampi.workers.fork_server import ForkedProcess, ForkServer
from ampi.workers.job import Job, JobError
from ampi.workers.software import require_same, software
from ampi.workers.worker import START, Began, Computed, Done, Message, Raised, Ready

Result = TypeVar("Result")

DEATHS = 3
OVERDUE = 2  # times that an attempt may exceed its time limit
MISFORTUNES = 30  # deaths before it began or while its result was flushed: no accident either
LAST_BREATH = 5.0  # s between a worker's end of file and its exit status
SETTINGS = {
    "OMP_NUM_THREADS": "1",  # the matrices are small, and the workers are processes
    "OPENBLAS_NUM_THREADS": "1",
    # glibc gives arrays of megabytes back to the kernel at once, and gets them again page by page; two
    # workers that both do so hold each other up, some per cent of a build
    "MALLOC_MMAP_THRESHOLD_": str(2**30),
    "MALLOC_TRIM_THRESHOLD_": str(2**30),
}
# the collector finds nothing among what imports make, and looks for a fourteenth of their time
# the supervisor decides what an interrupt means, from the first import on
_COMMAND = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); import gc; gc.disable(); "
_SERVE = "from ampi.workers.fork_server import serve; serve({module!r}, {{control}})"
_WORK = "from ampi.workers.worker import main; main({module!r})"


class WorkerLost(Exception):  # noqa: N818 - an event of normal operation, not an error
    """The process ended in the middle of a job."""

    def __init__(self, returncode: int, attempt: int, *, computed: bool) -> None:
        super().__init__(returncode, attempt)
        self.returncode, self.attempt, self.computed = returncode, attempt, computed

    @property
    def overdue(self) -> bool:
        """Whether its own alarm ended it."""
        return self.returncode == -signal.SIGALRM and self.attempt >= 0 and not self.computed

    @property
    def cause(self) -> str:
        """How it ended."""
        if self.returncode < 0:
            return signal.Signals(-self.returncode).name
        return f"exit status {self.returncode}"


def _environment() -> dict[str, str]:
    paths = [str(Path(p).resolve()) for p in sys.path]
    return {**os.environ, **SETTINGS, "PYTHONPATH": os.pathsep.join(paths)}


def _own_command(module: str) -> subprocess.Popen[bytes]:
    """A worker that imports by itself."""
    return subprocess.Popen(
        # -P: what lies in the present folder is not ours
        [sys.executable, "-P", "-c", _COMMAND + _WORK.format(module=module)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        env=_environment(),
    )


class Worker:
    """One worker process, the two pipes to it, and a thread that sorts its messages by job."""

    def __init__(self, process: ForkedProcess | subprocess.Popen[bytes]) -> None:
        self.process = process
        self._numbers = count()
        self._lock = threading.Lock()
        self._over = False
        self._inboxes: dict[int, queue.SimpleQueue[Message | None]] = {}
        self._open(START)
        threading.Thread(target=self._listen, daemon=True).start()
        threading.Thread(target=self._clear_away, daemon=True).start()

    def wait_ready(self) -> None:
        """Until its imports are done.

        Raises
        ------
        WorkerLost
            If the process ended before.
        JobError
            If it has imported something else than this process.
        """
        first = self._next(START, -1, computed=False)
        if not isinstance(first, Ready):
            raise JobError("worker: its first message was not that it is ready")
        require_same(first.software, "a new worker process", software())

    def run(self, job: Job[Result], free: Callable[[], None]) -> Result:
        """The job's result; calls `free` once the next job may be sent.

        Raises
        ------
        WorkerLost
            If the process ended before.
        OSError, JobError
            If the job has no result.
        """
        number = next(self._numbers)
        attempt, computed = -1, False
        self._open(number)
        try:
            self._send(number, job)
            while True:
                message = self._next(number, attempt, computed=computed)
                if isinstance(message, Began):
                    attempt = message.attempt
                elif isinstance(message, Computed):
                    computed = True
                    free()
                elif isinstance(message, Raised):
                    raise message.error
                elif isinstance(message, Done):
                    result: Result = message.result
                    return result
        finally:
            with self._lock:
                del self._inboxes[number]

    def kill(self) -> None:
        """End it and what its job has started, at once."""
        if self.process.pid:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
        else:
            self.process.kill()

    def stop(self) -> int:
        """End it, if it has not ended by itself; its exit status."""
        assert self.process.stdin is not None
        with suppress(BrokenPipeError):
            self.process.stdin.close()
        try:
            return self.process.wait(timeout=LAST_BREATH)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def _send(self, number: int, job: Job[Any]) -> None:
        assert self.process.stdin is not None
        try:
            pickle.dump((number, pickle.dumps(job)), self.process.stdin)
            self.process.stdin.flush()
        except (BrokenPipeError, ValueError):  # ValueError: closed, by `stop`
            raise WorkerLost(self.stop(), -1, computed=False) from None

    def _open(self, number: int) -> None:
        with self._lock:
            self._inboxes[number] = queue.SimpleQueue()
            if self._over:
                self._inboxes[number].put(None)

    def _next(self, number: int, attempt: int, *, computed: bool) -> Message:
        message = self._inboxes[number].get()
        if message is None:
            status = self.stop()
            orphaned = isinstance(self.process, ForkedProcess) and self.process.orphaned
            # with its server: whatever it was at is not the cause
            raise WorkerLost(status, -1 if orphaned else attempt, computed=computed)
        return message

    def _clear_away(self) -> None:
        """When it has ended, end what it has left: children hold its pipe, and `_listen` would wait."""
        self.process.wait()
        self.kill()

    def _listen(self) -> None:
        """Until the worker's end of file, or half a message; whatever ends it, nobody waits on."""
        assert self.process.stdout is not None
        try:
            with self.process.stdout as replies, suppress(EOFError, pickle.UnpicklingError):
                while True:
                    number, message = pickle.load(replies)
                    self._inboxes[number].put(message)
        finally:
            with self._lock:
                self._over = True
                for inbox in self._inboxes.values():
                    inbox.put(None)


class Supervisor:
    """Workers, started as they are needed and replaced as they die. Safe to use from threads.

    There are `most` at the most; each imports `module`, which its jobs need, when it starts.
    """

    def __init__(self, module: str, most: float = math.inf) -> None:
        self._module, self._most = module, most
        self._server: ForkServer | None = None
        self._free: list[Worker] = []
        self._alive: set[Worker] = set()
        self._waiting = deque[object]()
        self._changed = threading.Condition()
        self._closed = False

    def run(self, job: Job[Result]) -> Result:
        """The result of a job, whatever happens to the workers."""
        deaths, misfortunes, overdue = 0, 0, list[int]()
        while True:
            worker = self._take()
            try:
                return worker.run(job, partial(self._release, worker))
            except WorkerLost as lost:
                self._forget(worker)
                if self._closed:
                    raise
                if lost.overdue:
                    overdue.append(lost.attempt)
                    if overdue.count(lost.attempt) == OVERDUE:
                        job = job.without(lost.attempt)
                elif lost.computed or lost.attempt < 0:
                    misfortunes += 1
                else:
                    deaths += 1
                for times, most in ((deaths, DEATHS), (misfortunes, MISFORTUNES)):
                    if times == most:
                        return job.give_up(
                            f"Its worker process died {times} times, by {lost.cause}."
                        )

    def start_worker(self) -> None:
        """Have one more worker ready; if it cannot start, the first job will say why."""
        with suppress(JobError, WorkerLost):
            with self._changed:
                if len(self._alive) >= self._most:  # jobs that came first have started theirs
                    return
                hired = self._hired()
            self._release(self._ready(hired))

    def close(self) -> None:
        """End all workers, in the middle of their jobs if need be."""
        with self._changed:
            self._closed = True
            workers = list(self._alive)
            self._changed.notify_all()
        for worker in workers:
            worker.kill()
        if self._server is not None:
            self._server.end()
        for worker in workers:
            worker.stop()

    def _take(self) -> Worker:
        """A worker that computes nothing, or a new one that has started; first come, first served."""
        with self._changed:
            turn = object()
            self._waiting.append(turn)
            try:
                while not self._closed:
                    if self._waiting[0] is turn:
                        while self._free:
                            worker = self._free.pop()
                            if worker.process.poll() is None:
                                return worker
                            worker.stop()  # it has died between two jobs
                            self._alive.discard(worker)
                        if len(self._alive) < self._most:
                            break
                    self._changed.wait()
                hired = self._hired()
            finally:
                self._waiting.remove(turn)
                self._changed.notify_all()
        return self._ready(hired)

    def _release(self, worker: Worker) -> None:
        with self._changed:
            self._free.append(worker)
            self._changed.notify_all()

    def _forget(self, worker: Worker) -> None:
        with self._changed:
            self._alive.discard(worker)
            self._changed.notify_all()

    def _hired(self) -> Worker:
        """A new process; to be called with the lock, so that there are never more than `most`."""
        worker = Worker(self._started())
        self._alive.add(worker)
        if self._closed:
            worker.process.kill()
        return worker

    def _started(self) -> ForkedProcess | subprocess.Popen[bytes]:
        if not fork_server.SUPPORTED:
            return _own_command(self._module)
        if self._server is None or self._server.process.poll() is not None:
            command = _COMMAND + _SERVE.format(module=self._module)
            self._server = ForkServer(command, _environment())
        return self._server.fork()

    def _ready(self, worker: Worker) -> Worker:
        """The worker, or one in its place, once it has started."""
        for deaths in range(1, DEATHS + 1):
            try:
                worker.wait_ready()
            except JobError:
                worker.process.kill()
                worker.stop()
                self._forget(worker)
                raise
            except WorkerLost as lost:
                with self._changed:
                    self._alive.discard(worker)
                    if self._closed or deaths == DEATHS:
                        self._changed.notify_all()
                        cause = lost
                        break
                    worker = self._hired()
            else:
                return worker
        if self._closed:
            raise cause
        raise JobError(
            f"worker: died {DEATHS} times before its first job, by {cause.cause}; "
            "what it printed on standard error says why"
        )


def require_workers(n_jobs: int) -> None:
    """Raise ValueError if this is no number of worker processes."""
    try:
        count = 0 if isinstance(n_jobs, bool) else operator.index(n_jobs)
    except TypeError:
        count = 0
    if count < 1:
        raise ValueError(f"n_jobs: expected at least 1 worker process, got {n_jobs!r}")
