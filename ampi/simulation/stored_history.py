"""A history that stays in its file until it is looked at: of 100,000 flights it exceeds the memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ampi.hdf5.seal import opened


@dataclass(frozen=True, eq=False)
class StoredHistory:
    """An array of a file as far as an index asks for it; `[()]` is all.

    The file is open only while it is read: neither HDF5 nor another process minds, and this can be
    pickled.
    """

    path: Path
    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    stamp: tuple[int, ...]  # of the file that was checked

    @classmethod
    def of(cls, path: Path, dataset: h5py.Dataset) -> StoredHistory:
        """A dataset of the open file at `path`."""
        path = path.absolute()
        return cls(path, dataset.name, dataset.shape, dataset.dtype, _stamp(path))

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> Any:
        if _stamp(self.path) != self.stamp:
            raise OSError(f"{self.path}: the file has changed since it was loaded; load it again")
        with opened(self.path) as file:
            return file[self.name][key]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[()], dtype)


def _stamp(path: Path) -> tuple[int, ...]:
    found = path.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns
