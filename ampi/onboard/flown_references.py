"""The references of n flights that are being flown, and their rows at one instant each.

A look-up is by any number that increases along a reference, its time or the energy it has spent. All
memory is allocated when the flights begin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.reference import Reference
from ampi.onboard.row_layout import RowLayout

Array = NDArray[np.float64]


class FlownReferences:
    """m points of r rows for each of n flights."""

    def __init__(self, n: int, points: int, layout: RowLayout) -> None:
        self.layout = layout
        self.times = np.zeros((n, points))
        self.rows = np.zeros((n, points, len(layout)))
        self.final_time = np.zeros(n)
        self.health = np.zeros(n, dtype=np.int64)
        self.clipped, self.hole = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        self._first = np.arange(n, dtype=np.intp) * points
        self._pointer = np.zeros(n, dtype=np.intp)

    def __len__(self) -> int:
        return len(self.final_time)

    def set(self, flight: int, reference: Reference) -> None:
        """Fly `reference` from now on."""
        self.times[flight] = reference.times
        self.rows[flight] = reference.rows.T
        self.final_time[flight] = reference.final_time
        self.health[flight] = int(reference.health)
        self.clipped[flight], self.hole[flight] = not reference.inside, reference.hole

    def rewind(self) -> None:
        """The next look-up is at the begin: it need not walk there."""
        self._pointer[:] = 0

    def at(self, along: Array, value: Array) -> Array:
        """Rows (r, n) where `along` (n, m), increasing, is `value` (n,); held at both ends."""
        points, last = along.ravel(), along.shape[1] - 2
        rows = self.rows.reshape(len(points), -1)
        for _ in range(last + 1):  # bounded: a pointer passes every point once, mostly none
            here = self._first + self._pointer
            begin, end = points.take(here), points.take(here + 1)
            forward, back = end <= value, begin > value
            forward &= self._pointer < last
            back &= self._pointer > 0
            if not (forward.any() or back.any()):
                break
            self._pointer += forward
            self._pointer -= back
        w = np.minimum(np.maximum((value - begin) / (end - begin), 0.0), 1.0)[:, None]
        between = (1.0 - w) * rows.take(here, axis=0) + w * rows.take(here + 1, axis=0)
        return np.ascontiguousarray(between.T)
