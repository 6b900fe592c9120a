"""The verdict on a campaign: counts, percentages with confidence intervals, footprint.

Percentages carry the exact (Clopper–Pearson) 95 % interval. The footprint is the area of the
covariance ellipse that holds 95 % of a bivariate normal, and its ratio between two campaigns flown on
the same draws carries a paired bootstrap interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.reference import Mode
from ampi.simulation.flights import Flights

Array = NDArray[np.float64]

CONFIDENCE = 0.95
ELLIPSE = -2.0 * math.log(1.0 - CONFIDENCE)  # squared Mahalanobis radius: χ² of two numbers
BOOTSTRAPS = 2000
FEWEST_FOR_RATIO = 30  # flights; below it the bootstrap draws degenerate ellipses
TABLE_5_RADII = (25e3, 50e3, 75e3)  # m, Sagliano et al. 2016, Table 5


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
        from scipy.special import betaincinv  # after the flights: what flies does without scipy

        count, n = int(np.count_nonzero(hits)), len(hits)
        tail = 0.5 * (1.0 - CONFIDENCE)
        low = 0.0 if count == 0 else betaincinv(count, n - count + 1, tail)
        high = 1.0 if count == n else betaincinv(count + 1, n - count, 1.0 - tail)
        return cls(count, n, float(low), float(high))

    @property
    def percent(self) -> float:
        """In percent."""
        return 100.0 * self.count / self.n

    def __str__(self) -> str:
        return f"{self.percent:.1f} % [{100 * self.low:.1f}, {100 * self.high:.1f}]"


@dataclass(frozen=True)
class Spread:
    """Size of an error over the flights that reached the target speed."""

    median: float
    percentile_99: float
    worst: float

    @classmethod
    def of(cls, error: Array) -> Spread:
        """From signed or unsigned errors."""
        size = np.abs(error[np.isfinite(error)])
        if len(size) == 0:
            return cls(np.nan, np.nan, np.nan)
        return cls(float(np.median(size)), float(np.percentile(size, 99)), float(size.max()))


@dataclass(frozen=True)
class Verdict:
    """One campaign, judged."""

    mode: str
    n: int
    passed: Fraction  # within every tolerance of the mission, with every limit kept
    failed_by: dict[str, Fraction]  # reason (`Flights.faults`) → flights; one may have several
    reached: Fraction
    clipped: Fraction
    hole: Fraction  # on references that are borrowed from beside an unsolved case
    rings: tuple[Fraction, ...]  # Table 5: within 25 km, 25–50, 50–75, outside
    within: dict[float, Fraction]  # radius of the mission (m) → flights within it
    miss: Spread  # m
    altitude: Spread  # m
    speed: Spread  # m/s
    peak: dict[str, Spread]  # greatest use of each limit, per flight
    limits_kept: Fraction
    footprint_area: float  # m²

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""

        def plain(value: Any) -> Any:
            if isinstance(value, Fraction | Spread):
                return dict(vars(value))
            if isinstance(value, dict):
                return {str(k): plain(v) for k, v in value.items()}
            if isinstance(value, tuple):
                return [plain(v) for v in value]
            return value

        return {k: plain(v) for k, v in vars(self).items()}


def judge(flights: Flights) -> Verdict:
    """Statistics of one campaign. A flight that did not reach the target speed is in no circle."""
    if not isinstance(flights, Flights):
        raise ValueError(f"flights: expected Flights, from ampi.fly, got {flights!r:.60}")
    good = flights.reached
    miss = np.where(good, flights.miss, np.inf)
    edges = (0.0, *TABLE_5_RADII, np.inf)
    rings = tuple(
        Fraction.of((miss >= a) & (miss < b) if np.isfinite(b) else miss >= a)
        for a, b in pairwise(edges)
    )
    faults = flights.faults
    return Verdict(
        mode=flights.mode.value,
        n=flights.n,
        passed=Fraction.of(flights.passed),
        failed_by={reason: Fraction.of(failed) for reason, failed in faults.items()},
        reached=Fraction.of(good),
        clipped=Fraction.of(flights.clipped),
        hole=Fraction.of(flights.hole),
        rings=rings,
        within={radius: Fraction.of(miss < radius) for radius in flights.radii.tolist()},
        miss=Spread.of(flights.miss[good]),
        altitude=Spread.of(flights.altitude_error[good]),
        speed=Spread.of(flights.speed_error[good]),
        peak={name: Spread.of(flights.peak[:, i]) for i, name in enumerate(flights.limits)},
        limits_kept=Fraction.of(~np.any([faults[name] for name in flights.limits], axis=0)),
        footprint_area=ellipse_area(flights.along[good], flights.across[good]),
    )


def ellipse_area(along: Array, across: Array) -> float:
    """Area (m²) of the 95 % covariance ellipse of a footprint."""
    if len(along) < 3:
        return float("nan")
    covariance = np.cov(along, across)
    return float(np.pi * ELLIPSE * np.sqrt(max(np.linalg.det(covariance), 0.0)))


@dataclass(frozen=True)
class AreaRatio:
    """Footprint of one campaign over another's, with its 95 % bootstrap interval."""

    ratio: float
    low: float
    high: float

    def __str__(self) -> str:
        shown = [_two_digits(100.0 * value) for value in (self.ratio, self.low, self.high)]
        return f"{shown[0]} % [{shown[1]}, {shown[2]}]"


def _two_digits(value: float) -> str:
    """At least two, and no power of ten above one."""
    return f"{value:,.0f}" if abs(value) >= 99.5 else f"{value:.2g}"


def footprint_ratio(flights: Flights, baseline: Flights) -> AreaRatio:
    """Paired by draw: both campaigns must share seed and entry states."""
    if flights.n != baseline.n or not np.array_equal(flights.parameters, baseline.parameters):
        raise ValueError("footprint_ratio: the two campaigns were not flown on the same draws")
    both = flights.reached & baseline.reached
    if np.count_nonzero(both) < FEWEST_FOR_RATIO:
        raise ValueError(
            f"footprint_ratio: {np.count_nonzero(both)} common flights are too few, "
            f"{FEWEST_FOR_RATIO} are needed"
        )
    points = [np.stack([f.along[both], f.across[both]]) for f in (flights, baseline)]
    rng = np.random.default_rng(np.random.SeedSequence(flights.seed, spawn_key=(0,)))
    samples = np.empty(BOOTSTRAPS)
    for i in range(BOOTSTRAPS):
        pick = rng.integers(0, points[0].shape[1], points[0].shape[1])
        samples[i] = ellipse_area(*points[0][:, pick]) / ellipse_area(*points[1][:, pick])
    low, high = np.percentile(samples, [2.5, 97.5])
    return AreaRatio(ellipse_area(*points[0]) / ellipse_area(*points[1]), float(low), float(high))


def ratio_to_nominal(flights: Flights, campaigns: Mapping[str, Flights]) -> AreaRatio | None:
    """Footprint over that of nominal tracking among `campaigns`.

    None where nominal tracking was not flown, not on the same draws, or too few flights reached both.
    """
    baseline = next((f for f in campaigns.values() if f.mode is Mode.NOMINAL), None)
    if baseline is None or flights is baseline:
        return None
    same = np.array_equal(flights.parameters, baseline.parameters)
    if not same or np.count_nonzero(flights.reached & baseline.reached) < FEWEST_FOR_RATIO:
        return None
    return footprint_ratio(flights, baseline)
