"""A signal as it was some time ago, a time of its own for each flight."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Delay:
    """Values (…, n) as they were some time ago, a time for each flight; linear between samples."""

    def __init__(self, samples: Array, first: Array) -> None:
        """`samples` (n,) is the delay in sample periods; before the first value it has been that."""
        self._back = samples.astype(np.intp)
        self._share = samples - self._back
        # at the begin of the newest period a delay of k and a fraction lies beyond sample k + 1
        self._past = deque([first] * (int(self._back.max(initial=0)) + 3))
        self._flight = np.arange(len(samples))

    def push(self, value: Array) -> None:
        """The newest value."""
        self._past.appendleft(value)
        self._past.pop()

    def value(self, fraction: float = 1.0) -> Array:
        """The delayed value when `fraction` of the newest sample's period has passed."""
        past = np.stack(self._past)
        place = self._back + self._share + (1.0 - fraction)
        begin = np.minimum(place.astype(np.intp), len(past) - 2)
        w = place - begin
        newer, older = past[begin, ..., self._flight], past[begin + 1, ..., self._flight]
        return np.ascontiguousarray(newer.T * (1.0 - w) + older.T * w)
