"""Files that are written: given their name when they are whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4


@contextmanager
def written(path: str | Path) -> Iterator[Path]:
    """A new name beside `path` to write to; it becomes `path` when the block ends, at once.

    What fails leaves the file that was there, and nothing half written. Two processes that write the
    same file each write their own: one of the two stays, whole.

    Raises
    ------
    OSError
        Naming `path`: no room, no permission.
    """
    target = Path(path).resolve()  # a link stays one
    temporary = target.with_name(f".{uuid4().hex}{target.suffix}")
    try:
        yield temporary
        temporary.replace(target)
    except OSError as error:
        if error.errno is None:
            raise
        reason = (
            f"{os.strerror(error.errno)}; nothing was written: make room, or choose another folder"
        )
        raise OSError(error.errno, reason, str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)
