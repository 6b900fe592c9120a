"""A worker process: takes jobs on its standard input, one at a time (database.supervisor starts it).

Messages are pickles on the two pipes that its supervisor holds:

    supervisor → worker    Job
    worker → supervisor    Ready | Began(attempt) | Kept | Raised(error)

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
from dataclasses import dataclass
from typing import IO

from database.jobs import Job, JobError


@dataclass(frozen=True)
class Ready:
    """The worker has started."""


@dataclass(frozen=True)
class Began:
    """An attempt begins."""

    attempt: int


@dataclass(frozen=True)
class Kept:
    """The job's result is on disk."""


@dataclass(frozen=True)
class Raised:
    """The job could not keep a result."""

    error: Exception


Message = Ready | Began | Kept | Raised


def main() -> None:
    """Serve until the supervisor closes the pipe or dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the supervisor decides what an interrupt means
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not mix with the replies
    jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(sys.stdin.buffer, jobs), daemon=True).start()

    def send(message: Message) -> None:
        try:
            pickle.dump(message, replies)
            replies.flush()
        except BrokenPipeError:
            os._exit(0)

    send(Ready())
    while True:
        job = jobs.get()
        if job is None:
            send(Raised(JobError("a worker cannot read its job: is its solver in a module?")))
            return
        try:
            job.run(lambda attempt: send(Began(attempt)))
        except OSError as error:  # a full disk, a folder gone: the supervisor tells the user
            send(Raised(error))
        except JobError as error:
            send(Raised(error))
        except Exception as error:  # a defect; not every class survives the pipe, its text does
            traceback.print_exc()
            send(Raised(JobError(f"{type(error).__name__}: {error}")))
        else:
            send(Kept())


def _receive(pipe: IO[bytes], jobs: queue.SimpleQueue[Job | None]) -> None:
    """Jobs into the queue; when the supervisor is gone, nobody waits for this process."""
    while True:
        try:
            jobs.put(pickle.load(pipe))
        except (EOFError, OSError):
            os._exit(0)
        except Exception:  # a name that this process does not have
            traceback.print_exc()
            jobs.put(None)
            return
