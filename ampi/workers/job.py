"""Work that a process does alone: what a supervisor and a worker know of it, and no more.

A job is pickled on its way to the worker. It may run anywhere, any number of times, and always has the
same result: what a dying process was at is simply done again.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol, TypeVar

Result = TypeVar("Result")


class JobError(RuntimeError):
    """A job without a result: what asked for it cannot go on. The message says why, in one sentence."""


class Job(Protocol[Result]):
    """Work with a result, which travels back to the supervisor; None where it is kept on disk."""

    def compute(self, announce: Callable[[int], None]) -> Future[Result]:
        """Do it, telling the number of each attempt before it begins.

        What is still to come of the result needs no processor: a flush to the disk takes milliseconds,
        and the process can be computing the next job.
        """

    def without(self, attempt: int) -> Job[Result]:
        """The same job, but for an attempt that has exceeded its time limit."""

    def give_up(self, reason: str) -> Result:
        """The result where there is none, or JobError; `reason` is a sentence."""


def finished(result: Result) -> Future[Result]:
    """A result of which nothing is still to come."""
    future: Future[Result] = Future()
    future.set_result(result)
    return future
