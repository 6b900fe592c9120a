"""A number with its bootstrap interval, by the percentile method.

Percentiles rather than BCa: BCa takes its acceleration from a jackknife, which is inconsistent for a
median and undefined where a flight counts as infinitely far.

References
----------
Efron, Tibshirani (1993), An Introduction to the Bootstrap, Sections 11.6, 13.3, 14.3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.simulation.estimates.proportions import CONFIDENCE

Array = NDArray[np.float64]

RESAMPLES = 2000
DRAWN_AT_ONCE = 2_000_000  # numbers: memory does not grow with the flights


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, in the unit of what it was estimated from; may be infinite."""

    value: float
    low: float
    high: float

    @classmethod
    def between(cls, value: float, resampled: Array) -> Estimate:
        """With percentiles of its bootstrap distribution, not interpolated: some may be infinite."""
        tail = 0.5 * (1.0 - CONFIDENCE)
        low = np.quantile(resampled, tail, method="lower")
        high = np.quantile(resampled, 1.0 - tail, method="higher")
        return cls(float(value), float(low), float(high))

    def __str__(self) -> str:
        return f"{self.value:.4g} [{self.low:.4g}, {self.high:.4g}]"


def resampled_flights(n: int, seed: int) -> Iterator[NDArray[np.unsignedinteger]]:
    """Blocks (b, n) of flights drawn with replacement, `RESAMPLES` rows in all; deterministic."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    kind = np.uint16 if n <= 2**16 else np.uint32  # short numbers sort fast
    rows = max(1, DRAWN_AT_ONCE // n)
    for first in range(0, RESAMPLES, rows):
        yield rng.integers(0, n, (min(rows, RESAMPLES - first), n), dtype=kind)


def mean_of(values: Array, seed: int = 0) -> Estimate:
    """Mean of one finite number per flight, with its interval."""
    if len(values) == 0 or not np.all(np.isfinite(values)):
        raise ValueError(f"values: expected finite numbers, one per flight, got {values!r:.60}")
    resampled = [values[flights].mean(axis=1) for flights in resampled_flights(len(values), seed)]
    return Estimate.between(float(values.mean()), np.concatenate(resampled))
