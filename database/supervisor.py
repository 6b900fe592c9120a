"""Jobs in processes that may die, and what follows when one does.

A worker that dies takes its job with it and nothing else. What ended it decides what comes next:

- the alarm of database.jobs.stopped_after: the attempt under way has exceeded its time limit; the same
  job runs again without that attempt, and its record says so;
- anything else (a crash in native code, the kernel short of memory, an operator): the same job runs
  again as it was, because its result must not depend on accidents; after `DEATHS` of them the job
  itself is held to be the cause, and its record says that.

A worker that dies before it is ready has nothing to do with any job: after `DEATHS` such failures
in a row there is no point in starting another.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from database.jobs import Job, JobError
from database.worker import Began, Kept, Message, Raised, Ready

DEATHS = 3
LAST_BREATH = 5.0  # s between a worker's end of file and its exit status
SETTINGS = {
    "OMP_NUM_THREADS": "1",  # the matrices are small, and the workers are processes
    "OPENBLAS_NUM_THREADS": "1",
    # glibc gives arrays of megabytes back to the kernel at once, and gets them again page by page; two
    # workers that both do so hold each other up, some per cent of a build
    "MALLOC_MMAP_THRESHOLD_": str(2**30),
    "MALLOC_TRIM_THRESHOLD_": str(2**30),
}
_COMMAND = "from database.worker import main; main()"


class WorkerLost(Exception):  # noqa: N818 - an event of normal operation, not an error
    """The process ended in the middle of a job."""

    def __init__(self, returncode: int, attempt: int) -> None:
        super().__init__(returncode, attempt)
        self.returncode, self.attempt = returncode, attempt

    @property
    def overdue(self) -> bool:
        """Whether its own alarm ended it."""
        return self.returncode == -signal.SIGALRM and self.attempt >= 0

    @property
    def cause(self) -> str:
        """How it ended."""
        if self.returncode < 0:
            return signal.Signals(-self.returncode).name
        return f"exit status {self.returncode}"


class Worker:
    """One worker process and the two pipes to it."""

    def __init__(self) -> None:
        paths = [str(Path(p).resolve()) for p in sys.path]
        self.process = subprocess.Popen(
            [sys.executable, "-c", _COMMAND],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **SETTINGS, "PYTHONPATH": os.pathsep.join(paths)},
        )
        self.attempt = -1  # under way

    def wait_ready(self) -> None:
        """Until its imports are done."""
        if not isinstance(self._receive(), Ready):
            raise JobError("worker: its first message was not that it is ready")

    def run(self, job: Job) -> None:
        """Until the job's result is kept.

        Raises
        ------
        WorkerLost
            If the process ended before.
        OSError, JobError
            If the job could not keep its result.
        """
        self.attempt = -1
        self._send(job)
        while True:
            message = self._receive()
            if isinstance(message, Began):
                self.attempt = message.attempt
            elif isinstance(message, Raised):
                raise message.error
            elif isinstance(message, Kept):
                return

    def stop(self) -> int:
        """End it, if it has not ended by itself; its exit status."""
        try:
            self.process.communicate(timeout=LAST_BREATH)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()
        return self.process.returncode

    def _send(self, job: Job) -> None:
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(pickle.dumps(job))
            self.process.stdin.flush()
        except BrokenPipeError:
            raise WorkerLost(self.stop(), self.attempt) from None

    def _receive(self) -> Message:
        assert self.process.stdout is not None
        try:
            message: Message = pickle.load(self.process.stdout)
        except (EOFError, pickle.UnpicklingError):  # nothing, or half a message
            raise WorkerLost(self.stop(), self.attempt) from None
        return message


class Supervisor:
    """Workers, started as they are needed and replaced as they die. Safe to use from threads."""

    def __init__(self) -> None:
        self._idle: list[Worker] = []
        self._alive: set[Worker] = set()
        self._closed = False

    def run(self, job: Job) -> None:
        """Run a job until its result is kept, whatever happens to the workers."""
        deaths = 0
        while True:
            worker = self._take()
            try:
                worker.run(job)
            except WorkerLost as lost:
                self._alive.discard(worker)
                if self._closed:
                    raise
                if lost.overdue:
                    job = job.without(lost.attempt)
                    continue
                deaths += 1
                if deaths == DEATHS:
                    job.give_up(f"Its worker process died {DEATHS} times, by {lost.cause}.")
                    return
            except Exception:
                self._idle.append(worker)
                raise
            else:
                self._idle.append(worker)
                return

    def close(self) -> None:
        """End all workers, in the middle of their jobs if need be."""
        self._closed = True
        for worker in list(self._alive):
            worker.process.kill()
        while self._idle:
            self._idle.pop().stop()

    def _take(self) -> Worker:
        """An idle worker, or a new one that has started."""
        while self._idle:
            worker = self._idle.pop()
            if worker.process.poll() is None:
                return worker
            worker.stop()  # it has died between two jobs
            self._alive.discard(worker)
        return self._started()

    def start_worker(self) -> None:
        """Have one more worker ready; if it cannot start, the first job will say why."""
        with suppress(JobError, WorkerLost):
            self._idle.append(self._started())

    def _started(self) -> Worker:
        """A new worker."""
        cause = ""
        for _ in range(DEATHS):
            worker = Worker()
            self._alive.add(worker)
            try:
                if self._closed:
                    worker.process.kill()
                worker.wait_ready()
            except WorkerLost as lost:
                self._alive.discard(worker)
                if self._closed:
                    raise
                cause = lost.cause
            else:
                return worker
        raise JobError(
            f"worker: died {DEATHS} times before its first job, by {cause}; "
            "what it printed on standard error says why"
        )
