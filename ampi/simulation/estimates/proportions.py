"""Shares of flights, with the exact interval of Clopper and Pearson (1934)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95  # of every interval


@dataclass(frozen=True)
class Fraction:
    """A count of n with its 95 % interval (fractions, 0 … 1)."""

    count: int
    n: int
    low: float
    high: float

    @classmethod
    def of(cls, hits: NDArray[np.bool_]) -> Fraction:
        """From one truth value per flight."""
        return cls.counted(int(np.count_nonzero(hits)), len(hits))

    @classmethod
    def counted(cls, count: int, n: int) -> Fraction:
        """From the number of hits among n flights."""
        from scipy.special import betaincinv  # after the flights: what flies does without scipy

        tail = 0.5 * (1.0 - CONFIDENCE)
        low = 0.0 if count == 0 else betaincinv(count, n - count + 1, tail)
        high = 1.0 if count == n else betaincinv(count + 1, n - count, 1.0 - tail)
        return cls(count, n, float(low), float(high))

    @property
    def percent(self) -> float:
        """In percent."""
        return 100.0 * self.count / self.n

    @property
    def width(self) -> float:
        """Of the interval (0 … 1)."""
        return self.high - self.low

    def __str__(self) -> str:
        return f"{self.percent:.1f} % [{100 * self.low:.1f}, {100 * self.high:.1f}]"
