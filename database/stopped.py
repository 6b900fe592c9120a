"""What stops a build from outside, in one sentence that says how to go on."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

from ampi.workers.stopped import Wording
from ampi.workers.stopped import told as told_of
from database.records.campaign import BuildError
from database.records.record_files import count_records


def told(folder: Path, path: Path) -> AbstractContextManager[None]:
    """What the block raises because of a disk, a lock or a worker, as a BuildError."""
    words = Wording(BuildError, "built", "run the same build again", "two builds", _kept)
    return told_of(folder, path, words)


def _kept(folder: Path) -> str:
    count = count_records(folder)
    return f"{count} finished cases" if count else ""
