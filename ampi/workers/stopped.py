"""What stops long work from outside, in one sentence that says how to go on."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ampi.workers.job import JobError
from ampi.workers.lock import LockedError, NoLocksError


@dataclass(frozen=True)
class Wording:
    """How a kind of work is spoken of."""

    error: type[Exception]  # what is raised
    done: str  # what happens to the file meanwhile: 'built'
    again: str  # what to do next: 'run the same build again'
    two: str  # what a lock keeps apart: 'two builds'
    kept: Callable[[Path], str]  # of a folder of records: how many of what it holds, or nothing


@contextmanager
def told(folder: Path, path: Path, words: Wording) -> Iterator[None]:
    """What the block raises because of a disk, a lock or a worker, as an error of `words`.

    `folder` holds the records of the work, `path` is the file that comes of it.
    """
    try:
        yield
    except LockedError as locked:
        raise words.error(
            f"{path} is being {words.done} by {locked.holder}; wait for it, or choose another path"
        ) from None
    except NoLocksError as error:
        raise words.error(
            f"{folder}: its file system has no locks ({error}), so nothing would keep {words.two} of "
            "one file apart; choose a path on another file system, or mount this one with locks"
        ) from None
    except OSError as error:
        reason = error.strerror or str(error)
        way_out = _WAYS_OUT.get(error.errno or 0, "{again} when that is mended")
        raise words.error(
            f"{error.filename or folder}: {reason}; {_kept(folder, words)}"
            f"{way_out.format(again=words.again)}"
        ) from None
    except JobError as error:
        raise words.error(f"{path}: {error}; {_kept(folder, words)}{words.again}") from None


_WAYS_OUT = {
    errno.ENOENT: "{again}, or choose another path",
    errno.ENOSPC: "make room and {again}",
    errno.EDQUOT: "make room and {again}",
    errno.EFBIG: "allow larger files and {again}",
    errno.EROFS: "choose a folder that can be written",
    errno.EACCES: "choose a folder that can be written",
    errno.EPERM: "choose a folder that can be written",
}


def _kept(folder: Path, words: Wording) -> str:
    try:
        found = words.kept(folder)
    except OSError:
        return ""
    return f"{found} are kept in {folder}: " if found else ""
