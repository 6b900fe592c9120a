"""A seal in front of an HDF5 file: the SHA-256 of all that follows, so that any flipped bit is found.

It lies in the user block, which readers skip, and is checked before HDF5 sees the file: its library may
crash on a damaged one.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import h5py

SEAL_BYTES = 512  # the smallest HDF5 user block


@dataclass(frozen=True)
class Seal:
    """Of files of one kind, which it names in words."""

    kind: str

    @property
    def text(self) -> bytes:
        """What it begins with."""
        return f"{self.kind}\nsha256 of what follows byte {SEAL_BYTES}: ".encode()

    def of(self, handle: IO[bytes]) -> bytes:
        """The user block that belongs in front of the content of an open file."""
        handle.seek(SEAL_BYTES)
        found = hashlib.file_digest(handle, "sha256").hexdigest()  # type: ignore[arg-type]
        return (self.text + found.encode() + b"\n").ljust(SEAL_BYTES, b"\n")

    def write(self, path: Path) -> None:
        """Seal a finished file, and flush it to disk."""
        with path.open("rb+") as handle:
            found = self.of(handle)
            handle.seek(0)
            handle.write(found)
            handle.flush()
            os.fsync(handle.fileno())

    def is_on(self, path: Path) -> bool:
        """Whether the file says that it is of this kind and sealed."""
        with path.open("rb") as handle:
            return handle.read(len(self.text)) == self.text

    def holds(self, path: Path) -> bool:
        """Whether the file is, to the byte, what was written."""
        with path.open("rb") as handle:
            return handle.read(SEAL_BYTES) == self.of(handle)


def opened(path: Path) -> h5py.File:
    """A file for reading, without HDF5's lock.

    Some file systems have no locks, and a reader needs none: what another program writes meanwhile
    breaks the seal.
    """
    return h5py.File(path, "r", locking=False)
