"""Files that are kept: written under another name, flushed, renamed; whole or absent at any moment."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

from ampi.workers.job import JobError

HOST = socket.gethostname()
NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC


def keeping(results: Mapping[str, bytes]) -> Callable[[], None]:
    """Write all under other names; what it returns flushes and renames: every target is whole or absent.

    The kernel is told to bring them all to the disk before any is waited for. A flush then mostly finds
    its work done; one by one, each would wait for the disk in its turn. The folder is not flushed: a
    loss of power may take back the last renames, and those results are worked out again.
    """
    writer = f"{HOST}.{os.getpid()}"  # on a cluster, two may have one number
    temporaries = [f"{target}.{writer}.tmp" for target in results]
    files: list[int] = []

    def keep() -> None:
        with _cleared_away(files, temporaries):
            for file in files:
                os.fsync(file)
            while files:
                os.close(files.pop())
            for temporary, target in zip(temporaries, results, strict=True):
                os.replace(temporary, target)

    with _cleared_away(files, temporaries):
        for temporary, raw in zip(temporaries, results.values(), strict=True):
            files.append(os.open(temporary, NEW_FILE, 0o666))
            _write(files[-1], raw)
        if hasattr(os, "posix_fadvise"):
            for file in files:  # who does not need a page has it written
                os.posix_fadvise(file, 0, 0, os.POSIX_FADV_DONTNEED)
    return keep


@contextmanager
def _cleared_away(files: list[int], temporaries: list[str]) -> Iterator[None]:
    """If the disk refuses, close and delete: what is kept needs the room."""
    try:
        yield
    except OSError:
        while files:
            os.close(files.pop())
        for temporary in temporaries:
            Path(temporary).unlink(missing_ok=True)
        raise


def _write(file: int, raw: bytes) -> None:
    """All of it: a disk that is nearly full takes a part without a word."""
    left = memoryview(raw)
    while left:
        left = left[os.write(file, left) :]


@contextmanager
def no_parts(folder: Path) -> Iterator[None]:
    """Delete, before and after, what processes that were killed did not finish: it holds room.

    A driver that dies leaves some to the next; one that gives up kills its workers as they write.
    """
    _delete_parts(folder)
    try:
        yield
    finally:
        _delete_parts(folder)


def _delete_parts(folder: Path) -> None:
    with suppress(FileNotFoundError):  # the folder: the file is whole
        delete(f"{folder}{os.sep}{name}" for name in entry_names(folder) if name.endswith(".tmp"))


def entry_names(folder: Path) -> Iterator[str]:
    """What lies in a folder, an entry at a time: it may hold hundreds of thousands."""
    with os.scandir(folder) as entries:
        for entry in entries:
            yield entry.name


def delete(files: Iterable[str]) -> None:
    """Those that are there."""
    for file in files:
        with suppress(FileNotFoundError):
            os.unlink(file)


@lru_cache(maxsize=1)
def keeper() -> ThreadPoolExecutor:
    """The thread that waits for the disk."""
    return ThreadPoolExecutor(1)


def require_seen(job: object, evidence: Path) -> None:
    """Raise JobError unless a file is there that a job has kept: its worker may see another folder."""
    if not evidence.exists():
        raise JobError(
            f"{job}: its result is not in {evidence.parent}; the workers must see the "
            "same folder as this process: choose a path on a shared file system"
        )
