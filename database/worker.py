"""A worker process: takes jobs on its standard input, one at a time (database.supervisor starts it).

Messages are pickles on the two pipes that its supervisor holds, each with the number of its job:

    supervisor → worker    number, Job
    worker → supervisor    number, Ready(software) | Began(attempt) | Computed | Kept | Raised(error)

Between Computed and Kept a result is on its way to the disk, and the next job may come.

A process of its own, and not a thread or a fork: native code may crash or hang, and then the kernel
ends the process and nothing else. Started as a command, it needs neither a guarded main module nor the
permission to have children that daemonic processes lack.
"""

from __future__ import annotations

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
from typing import IO

from database.campaign import JobError
from database.jobs import Job
from database.provenance import software


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
class Kept:
    """The job's result is on disk."""


@dataclass(frozen=True)
class Raised:
    """The job could not keep a result."""

    error: Exception


Message = Ready | Began | Computed | Kept | Raised
START = -1  # in place of a job's number


def main() -> None:
    """Serve until the supervisor closes the pipe or dies."""
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

    def kept(number: int, keeping: Future[None]) -> None:
        error = keeping.exception()
        send(number, Kept() if error is None else _raised(error))

    send(START, Ready(software()))
    while True:
        number, job = jobs.get()
        try:
            keeping = _read(job).compute(partial(began, number))
        except Exception as error:
            send(number, Computed())
            send(number, _raised(error))
        else:
            send(number, Computed())
            keeping.add_done_callback(partial(kept, number))


def _read(job: bytes) -> Job:
    try:
        found: Job = pickle.loads(job)
    except Exception:  # a name that this process does not have
        traceback.print_exc()
        raise JobError("a worker cannot read its job: is its solver in a module?") from None
    return found


def _raised(error: BaseException) -> Raised:
    if isinstance(error, OSError | JobError):  # a full disk, a folder gone: the user is told
        return Raised(error)
    traceback.print_exception(error)  # a defect; not every class survives the pipe, its text does
    return Raised(JobError(f"{type(error).__name__}: {error}"))


def _receive(pipe: IO[bytes], jobs: queue.SimpleQueue[tuple[int, bytes]]) -> None:
    """Jobs into the queue; when the supervisor is gone, nobody waits for this process."""
    while True:
        try:
            jobs.put(pickle.load(pipe))
        except Exception:  # its end, or half a message of a supervisor that was killed
            os._exit(0)
