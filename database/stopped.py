"""What stops a build from outside, in one sentence that says how to go on."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ampi.workers.job import JobError
from database.records.campaign import BuildError
from database.records.lock import LockedError, NoLocksError
from database.records.record_files import count_records


@contextmanager
def told(folder: Path, path: Path) -> Iterator[None]:
    """What the block raises because of a disk, a lock or a worker, as a BuildError."""
    try:
        yield
    except LockedError as locked:
        raise BuildError(
            f"{path} is being built by {locked.holder}; wait for it, or choose another path"
        ) from None
    except NoLocksError as error:
        raise BuildError(
            f"{folder}: its file system has no locks ({error}), so nothing would keep two builds of one "
            "file apart; choose a path on another file system, or mount this one with locks"
        ) from None
    except OSError as error:
        reason = error.strerror or str(error)
        way_out = _WAYS_OUT.get(error.errno or 0, "run the same build again when that is mended")
        raise BuildError(
            f"{error.filename or folder}: {reason}; {_kept(folder)}{way_out}"
        ) from None
    except JobError as error:
        raise BuildError(f"{path}: {error}; {_kept(folder)}run the same build again") from None


_WAYS_OUT = {
    errno.ENOENT: "run the same build again, or choose another path",
    errno.ENOSPC: "make room and run the same build again",
    errno.EDQUOT: "make room and run the same build again",
    errno.EFBIG: "allow larger files and run the same build again",
    errno.EROFS: "choose a folder that can be written",
    errno.EACCES: "choose a folder that can be written",
    errno.EPERM: "choose a folder that can be written",
}


def _kept(folder: Path) -> str:
    try:
        count = count_records(folder)
    except OSError:
        return ""
    return f"{count} finished cases are kept in {folder}: " if count else ""
