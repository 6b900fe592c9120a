"""A worker process: takes jobs on its standard input, one at a time (ampi.workers.supervisor starts it).

Messages are pickles on the two pipes that its supervisor holds, each with the number of its job:

    supervisor → worker    number, Job
    worker → supervisor    number, Ready(software) | Began(attempt) | Computed | Done(result)
                                   | Raised(error)

Between Computed and Done a result may be on its way to the disk, and the next job may come.

A process of its own, and not a thread or a fork of the driver: native code may crash or hang, and then
the kernel ends the process and nothing else. Forked from a command (`fork_server`), or started as one,
it needs neither a guarded main module nor the permission to have children that daemonic processes lack.
"""

from __future__ import annotations

import gc
import os
import pickle
import queue
import signal
import sys
import threading
import traceback
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import IO, Any, NoReturn

from ampi.workers.job import Job, JobError
from ampi.workers.software import software


@dataclass(frozen=True)
class Ready:
    """The worker has started, with this software."""

    software: Mapping[str, str]


@dataclass(frozen=True)
class Began:
    """An attempt begins."""

    attempt: int


@dataclass(frozen=True)
class Computed:
    """The job needs the processor no more."""


@dataclass(frozen=True)
class Done:
    """The job's result; None if it is on disk."""

    result: Any


@dataclass(frozen=True)
class Raised:
    """The job has no result."""

    error: Exception


Message = Ready | Began | Computed | Done | Raised
START = -1  # in place of a job's number


def main(module: str) -> NoReturn:
    """A worker that is a command of its own; `module` is what its jobs need.

    The module is imported while the supervisor still plans, not when the first job comes.
    """
    import_module(module)
    gc.freeze()
    work()


def work() -> NoReturn:
    """Serve until the supervisor closes the pipe or dies."""
    gc.enable()
    signal.signal(signal.SIGALRM, signal.SIG_DFL)  # its parent may ignore it: no time limit then
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
    replies, talking = os.fdopen(os.dup(1), "wb"), threading.Lock()
    os.dup2(2, 1)  # what a library prints must not mix with the replies
    jobs: queue.SimpleQueue[tuple[int, bytes]] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(sys.stdin.buffer, jobs), daemon=True).start()

    def send(number: int, message: Message) -> None:
        try:
            with talking:
                pickle.dump((number, message), replies)
                replies.flush()
        except BrokenPipeError:
            os._exit(0)

    def began(number: int, attempt: int) -> None:
        send(number, Began(attempt))

    def done(number: int, future: Future[Any]) -> None:
        error = future.exception()
        send(number, Done(future.result()) if error is None else _raised(error))

    send(START, Ready(software()))
    while True:
        number, job = jobs.get()
        try:
            future = _read(job).compute(partial(began, number))
        except Exception as error:
            send(number, Computed())
            send(number, _raised(error))
        else:
            send(number, Computed())
            future.add_done_callback(partial(done, number))


def _read(job: bytes) -> Job[Any]:
    try:
        found: Job[Any] = pickle.loads(job)
    except Exception:  # a name that this process does not have
        traceback.print_exc()
        raise JobError("a worker cannot read its job: is its solver in a module?") from None
    return found


def _raised(error: BaseException) -> Raised:
    if isinstance(error, OSError | JobError):  # a full disk, a folder gone: the user is told
        return Raised(error)
    if isinstance(error, MemoryError):
        return Raised(JobError(f"a worker is out of memory: {error}; try fewer worker processes"))
    traceback.print_exception(error)  # a defect; not every class survives the pipe, its text does
    return Raised(JobError(f"{type(error).__name__}: {error}"))


def _receive(pipe: IO[bytes], jobs: queue.SimpleQueue[tuple[int, bytes]]) -> None:
    """Jobs into the queue; when the supervisor is gone, nobody waits for this process."""
    while True:
        try:
            jobs.put(pickle.load(pipe))
        except Exception:  # its end, or half a message of a supervisor that was killed
            os._exit(0)
