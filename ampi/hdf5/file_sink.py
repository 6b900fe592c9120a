"""A file for HDF5 to write to, which takes a full disk calmly.

HDF5 cannot close a file that it fails to flush: it prints, keeps the file open and may crash the process
at exit. So the sink accepts every write, remembers the first failure, and its owner asks for it after
HDF5 has closed in good order.
"""

from __future__ import annotations

import io
from typing import Any


class FileSink(io.FileIO):
    """A file open for reading and writing whose writes fail later, in `check`."""

    failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of `data`, or remember why not."""
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while rest and self.failure is None:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.failure = error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Set the length, or remember why not."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0

    def check(self) -> None:
        """Raise the first failure."""
        if self.failure is not None:
            raise self.failure
