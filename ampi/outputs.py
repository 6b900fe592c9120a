"""Files that a command is to write: looked at before the work, given their name when they are whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

FIGURES = (".png", ".pdf", ".svg")


def check_output(path: Path | None, *suffixes: str) -> None:
    """Raise ValueError if a result could not be written there, or would cost something else.

    Parameters
    ----------
    path
        The file; None for an option that was not given.
    suffixes
        What its name may end in; none: anything.
    """
    if path is None:
        return
    folder = path.absolute().parent
    if not folder.is_dir():
        raise ValueError(f"{path}: the folder {folder} does not exist")
    if path.is_dir():
        raise ValueError(f"{path}: expected a file to write, got a folder")
    if suffixes and path.suffix.lower() not in suffixes:
        raise ValueError(f"{path}: expected a name that ends in {', '.join(suffixes)}")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise ValueError(f"{path}: no permission to write there")
    if path.suffix == ".toml" and path.exists():
        raise ValueError(f"{path} is a mission file; nothing was overwritten: choose another path")
    if path.exists():
        from ampi.dataset import stored_mission

        if stored_mission(path) is not None:
            raise ValueError(
                f"{path} is a trajectory database; nothing was overwritten: choose another path"
            )


def check_folder(path: Path | None) -> None:
    """Raise ValueError if figures could not be written to this folder; it need not exist."""
    if path is not None and path.exists() and not path.is_dir():
        raise ValueError(f"{path}: expected a folder, got a file")


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
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)
