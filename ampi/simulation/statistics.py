"""The verdict on a campaign: counts, percentages and misses with their intervals, footprint.

The estimates are those of ampi/simulation/estimates. The footprint is the area of the covariance
ellipse that holds 95 % of a bivariate normal, and its ratio between two campaigns flown on the same
draws carries a paired bootstrap interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.reference import Mode
from ampi.simulation.estimates.bootstrap import Estimate, mean_of
from ampi.simulation.estimates.ellipses import (
    ELLIPSE,
    Ellipse,
    containing_ellipse,
    ellipse_area,
)
from ampi.simulation.estimates.failures import counts
from ampi.simulation.estimates.proportions import Fraction
from ampi.simulation.estimates.spreads import Sizes, Spread
from ampi.simulation.flights import Flights

__all__ = [
    "ELLIPSE",
    "TABLE_5_RADII",
    "AreaRatio",
    "Fraction",
    "Spread",
    "Verdict",
    "ellipse_area",
    "footprint_ratio",
    "judge",
    "ratio_to_nominal",
]

Array = NDArray[np.float64]

BOOTSTRAPS = 2000
FEWEST_FOR_RATIO = 30  # flights; below it the bootstrap draws degenerate ellipses
TABLE_5_RADII = (25e3, 50e3, 75e3)  # m, Sagliano et al. 2016, Table 5


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
    miss: Spread  # m, of the flights that reached the target speed
    misses: Sizes  # m, of all flights: the others count as infinitely far
    altitude: Spread  # m
    speed: Spread  # m/s
    peak: dict[str, Spread]  # greatest use of each limit, per flight
    limits_kept: Fraction
    footprint_area: float  # m²
    containment: Ellipse | None  # holds 95 % of all flights; None: too few arrived, or on a line
    classes: dict[str, Fraction] | None  # `FailureClass` → flights, all told; None: not classified
    means: dict[str, Estimate]  # of numbers that every flight has: saturation, activity

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""

        def plain(value: Any) -> Any:
            if is_dataclass(value):
                return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
            if isinstance(value, dict):
                return {str(k): plain(v) for k, v in value.items()}
            if isinstance(value, tuple):
                return [plain(v) for v in value]
            return value

        return {k: plain(v) for k, v in vars(self).items()}


def judge(
    flights: Flights,
    *,
    classes: NDArray[np.int64] | None = None,
    per_flight: Mapping[str, Array] | None = None,
) -> Verdict:
    """Statistics of one campaign. A flight that did not reach the target speed is in no circle.

    `classes` (n,), of `failures.classify`; `per_flight`: name → (n,) numbers whose means are asked.
    """
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
        misses=Sizes.of(miss),
        altitude=Spread.of(flights.altitude_error[good]),
        speed=Spread.of(flights.speed_error[good]),
        peak={name: Spread.of(flights.peak[:, i]) for i, name in enumerate(flights.limits)},
        limits_kept=Fraction.of(~np.any([faults[name] for name in flights.limits], axis=0)),
        footprint_area=ellipse_area(flights.along[good], flights.across[good]),
        containment=containing_ellipse(*np.where(good, (flights.across, flights.along), np.nan)),
        classes=None if classes is None else {k.name: f for k, f in counts(classes).items()},
        means={name: mean_of(values) for name, values in (per_flight or {}).items()},
    )


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
