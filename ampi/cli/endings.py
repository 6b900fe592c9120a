"""How a command ends before its end: misuse and bad files in one sentence, a signal in order."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import typer

from ampi.cli.console import error_out, escaped, print_error
from ampi.workers.job import JobError

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Stopped(SystemExit):
    """A signal has asked for the end: what was begun is ended in order, workers and temporary files."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.signal = signal.Signals(number)


def watch_signals() -> None:
    """Let each signal that asks for the end raise Stopped."""
    for number in STOPPING:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup wants it
            signal.signal(number, _stop)


def _stop(number: int, frame: FrameType | None) -> None:
    for one in STOPPING:  # whoever asks twice does not wait
        signal.signal(one, signal.SIG_DFL)
    raise Stopped(number)


@contextmanager
def refusals() -> Iterator[None]:
    """Misuse and bad files end in one clear sentence and exit status 2, not in a traceback."""
    try:
        yield
    except (ValueError, OSError, MemoryError, JobError) as error:
        print_error(_sentence(error))
        raise typer.Exit(2) from None
    except Stopped as stopped:
        error_out.print(f"Interrupted by {stopped.signal.name}.")
        raise


def _sentence(error: Exception) -> str:
    """The file before what befell it, without the system's number."""
    from ampi.missions.sections import MissionError

    if isinstance(error, OSError) and error.filename is not None:
        return f"{escaped(error.filename)}: {error.strerror}"
    lines = isinstance(error, MissionError)  # a line for each fault
    return "\n".join(map(escaped, str(error).split("\n"))) if lines else escaped(error)
