"""Two schemes on the same draws: flight by flight, which removes what the draws have in common.

Shares within a radius differ by (b − c)/n, where b flights of n arrive by the first scheme alone and c
by the second alone. That they arrive equally often is tested by McNemar's exact test: b is binomial
of b + c with ½. The interval is Newcombe's (1998, method 10): Wilson's limits of either share, joined
with the correlation of the pairs. The misses themselves are compared by the difference of medians,
resampled in pairs, and by Wilcoxon's signed ranks, where a lost flight is farther than every other.

References
----------
McNemar (1947), Psychometrika 12. Newcombe (1998), Statistics in Medicine 17, 2635–2650.
Wilcoxon (1945), Biometrics Bulletin 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.shown import Shown
from ampi.simulation.estimates.bootstrap import Estimate, resampled_flights
from ampi.simulation.estimates.proportions import CONFIDENCE
from ampi.simulation.estimates.spreads import all_flights

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Flown:
    """What one scheme made of its draws."""

    draws: Array  # (n, d), that which makes the flights the same: parameters, or uniform numbers
    miss: Array  # (n,), m; infinite or NaN: it did not arrive

    def __post_init__(self) -> None:
        if self.draws.ndim != 2 or self.miss.shape != self.draws.shape[:1] or not len(self.miss):
            raise ValueError(
                "flown: expected draws (n, d) and misses (n,) of at least one flight, got "
                f"{self.draws.shape} and {self.miss.shape}"
            )


@dataclass(frozen=True)
class ShareDifference:
    """Share of hits of one scheme less that of another, on n draws."""

    difference: Estimate  # −1 … 1
    first_alone: int  # flights that only the first scheme brings there
    second_alone: int
    p_value: float  # McNemar, exact, two-sided


@dataclass(frozen=True)
class PairedDifference(Shown):
    """One scheme less another on the same n draws: it is better by negative misses, positive shares."""

    n: int
    median: Estimate  # m, of the medians; NaN where both are infinite
    within: dict[float, ShareDifference]  # radius (m) → flights within it
    p_value: float  # Wilcoxon's signed ranks, two-sided


def paired(
    first: Flown, second: Flown, radii: Iterable[float] = (), *, seed: int = 0
) -> PairedDifference:
    """Compare two schemes; `radii` in m."""
    if not np.array_equal(first.draws, second.draws):
        raise ValueError(
            "paired: expected two schemes on the same draws, got "
            f"{len(first.draws)} and {len(second.draws)} draws that differ"
        )
    misses = np.stack([all_flights(first.miss), all_flights(second.miss)])
    return PairedDifference(
        n=misses.shape[1],
        median=_median_difference(misses, seed),
        within={radius: share_difference(*(misses < radius)) for radius in radii},
        p_value=_signed_ranks(misses[0], misses[1]),
    )


def share_difference(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> ShareDifference:
    """From one truth value per draw, (n,), of either scheme."""
    from scipy.stats import binomtest

    one, other = int(np.sum(first & ~second)), int(np.sum(~first & second))
    both, neither = int(np.sum(first & second)), int(np.sum(~first & ~second))
    p_value = binomtest(one, one + other).pvalue if one + other else 1.0
    difference = _newcombe(both, one, other, neither)
    return ShareDifference(difference, one, other, float(p_value))


def _newcombe(a: int, b: int, c: int, d: int) -> Estimate:
    """Difference (b − c)/n of the paired 2 × 2 table with its interval (method 10)."""
    n, margins = a + b + c + d, (a + b) * (c + d) * (a + c) * (b + d)
    agreement = float(a * d - b * c)
    if agreement > 0:
        agreement = max(agreement - n / 2, 0.0)  # Newcombe's correction for continuity
    phi = agreement / np.sqrt(float(margins)) if margins else 0.0
    p1, (low1, high1) = (a + b) / n, _wilson(a + b, n)
    p2, (low2, high2) = (a + c) / n, _wilson(a + c, n)

    def joined(one: float, other: float) -> float:
        return float(np.sqrt(max(one**2 - 2.0 * phi * one * other + other**2, 0.0)))

    difference = p1 - p2
    below, above = joined(p1 - low1, high2 - p2), joined(high1 - p1, p2 - low2)
    return Estimate(difference, difference - below, difference + above)


def _wilson(count: int, n: int) -> tuple[float, float]:
    """Score interval of a proportion (Wilson 1927)."""
    from scipy.special import ndtri

    z = float(ndtri(0.5 + 0.5 * CONFIDENCE))
    centre, size = count + 0.5 * z**2, z * np.sqrt(count * (n - count) / n + 0.25 * z**2)
    return float((centre - size) / (n + z**2)), float((centre + size) / (n + z**2))


def _median_difference(misses: Array, seed: int) -> Estimate:
    with np.errstate(invalid="ignore"):  # both infinite: no number
        resampled = [
            np.subtract(*np.median(misses[:, flights], axis=2))
            for flights in resampled_flights(misses.shape[1], seed)
        ]
        return Estimate.between(
            float(np.subtract(*np.median(misses, axis=1))), np.concatenate(resampled)
        )


def _signed_ranks(first: Array, second: Array) -> float:
    """Two-sided p-value; pairs that are equal, two lost flights among them, decide nothing."""
    from scipy.stats import wilcoxon

    decided = first != second
    if not np.any(decided):
        return 1.0
    difference = first[decided] - second[decided]
    finite = np.isfinite(difference)
    farthest = 1.0 + np.max(np.abs(difference[finite]), initial=0.0)
    difference = np.where(finite, difference, np.sign(difference) * farthest)  # ranks alone count
    return float(wilcoxon(difference).pvalue)
