"""Files that a command is to write: looked at before the work, so that it costs nothing else."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

FIGURES = (".png", ".pdf", ".svg")
HDF5 = b"\x89HDF\r\n\x1a\n"  # where a file begins, or what follows its seal
FLIGHTS = b"ampi flights\n"  # where a file of flights begins (ampi.simulation.flights_schema)
END_BYTES = 2048


def check_output(
    path: Path | None,
    *suffixes: str,
    force: bool = False,
    made_by: str | None = None,
    others: Iterable[str | Path | None] = (),
) -> None:
    """Raise ValueError if a result could not be written there, or would cost something else.

    Parameters
    ----------
    path
        The file; None for an option that was not given.
    suffixes
        What its name may end in; none: anything.
    force
        Whether any file that is there may be replaced. Never a mission or a database: they are not
        results of the commands that ask here.
    made_by
        What stands near the beginning or the end of an earlier result of the same kind, which is
        replaced without a word; None for a result that is too dear for that.
    others
        What the command reads, and its other outputs: never the same file.
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
    if path.exists():
        _check_kind(path)
    if any(other is not None and _is_same(path, Path(other)) for other in others):
        raise ValueError(
            f"{path}: the command needs this file for something else; choose another path"
        )
    if path.exists() and not force and not _is_made_by(path, made_by):
        raise ValueError(
            f"{path} is already there; nothing was overwritten: choose another path, or add --force"
        )
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise ValueError(f"{path}: no permission to write there")


def _check_kind(path: Path) -> None:
    if not path.is_file():
        raise ValueError(f"{path}: expected a file to write, got a device or a pipe")
    if path.resolve().suffix.lower() == ".toml":
        raise ValueError(f"{path} is a mission file; nothing was overwritten: choose another path")
    head = _ends(path)[0]
    if HDF5 in head and not head.startswith(
        FLIGHTS
    ):  # a damaged one, or one that is open elsewhere, is a database too
        raise ValueError(
            f"{path} is a trajectory database; nothing was overwritten: choose another path"
        )


def _is_same(path: Path, other: Path) -> bool:
    if path.exists() and other.exists():
        return path.samefile(other)
    return path.resolve() == other.resolve()


def _is_made_by(path: Path, made_by: str | None) -> bool:
    return made_by is not None and any(made_by.encode() in end for end in _ends(path))


def _ends(path: Path) -> tuple[bytes, bytes]:
    with path.open("rb") as file:
        head = file.read(END_BYTES)
        file.seek(max(0, path.stat().st_size - END_BYTES))
        return head, file.read(END_BYTES)


def check_figure(
    path: Path | None,
    *,
    made_by: str,
    force: bool = False,
    others: Iterable[str | Path | None] = (),
) -> None:
    """Raise ValueError if a figure could not be drawn, or not be written there."""
    check_output(path, *FIGURES, force=force, made_by=made_by, others=others)
    check_drawing(path)


def check_figures(
    folder: Path | None, names: Iterable[str], *, made_by: str, force: bool = False
) -> None:
    """Raise ValueError if figures could not be drawn, or not be written to a folder, there or not."""
    if folder is None:
        return
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: expected a folder, got a file")
    if folder.is_dir():
        for name in names:
            check_output(folder / name, force=force, made_by=made_by)
    check_drawing(folder)


def check_drawing(wanted: Path | None) -> None:
    """Raise ValueError if what draws is not installed. It draws in no window, whatever is set."""
    if wanted is None:
        return
    # matplotlib refuses to be imported under one that is not there
    os.environ["MPLBACKEND"] = "agg"
    try:
        import jinja2  # noqa: F401
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise ValueError(
            f"{wanted}: drawing needs {error.name}, which is not installed; "
            "try: pip install 'ampi[report]'"
        ) from None
    except UnicodeDecodeError as error:
        raise ValueError(
            f"matplotlibrc: expected UTF-8, got {error.reason} at byte {error.start}; mend or move "
            "the file of this name in the working folder or in matplotlib's configuration folder"
        ) from None
