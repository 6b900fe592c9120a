"""One process at a time makes a file.

The lock is the kernel's (flock on `PATH.partial/lock`), not the file's existence: it goes with the
process that holds it, however that ends, and a stale file locks nothing.
"""

from __future__ import annotations

import fcntl
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


class LockedError(RuntimeError):
    """Another process holds the folder; `holder` says which."""

    def __init__(self, holder: str) -> None:
        super().__init__(holder)
        self.holder = holder


class NoLocksError(RuntimeError):
    """The file system of the folder has no locks."""


@contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Hold `folder` (made if absent) until the end of the block.

    Raises
    ------
    LockedError
        If another process holds it.
    NoLocksError
        If the file system cannot say whether one does.
    """
    try:
        with _held(folder):
            yield
    finally:  # on a network, a file that is open cannot be removed, nor can its folder
        with suppress(OSError):
            folder.rmdir()  # if it is empty


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    path = folder / "lock"
    while True:
        folder.mkdir(exist_ok=True)
        try:
            file = path.open("a+", encoding="utf-8")
        except FileNotFoundError:
            if folder.is_dir():
                raise
            continue  # the holder before us has just removed the folder
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                raise LockedError(file.read().strip() or "another process") from None
            except OSError as error:  # ENOLCK, ENOTSUP, ENOSYS: by file system
                raise NoLocksError(error.strerror) from None
            if not _is_at(path, file.fileno()):
                continue  # the holder before us has finished, and removed what we have just locked
            file.truncate(0)
            file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
            file.flush()
            yield
            return


def _is_at(path: Path, descriptor: int) -> bool:
    """Whether an open file is the one at `path` now."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False
