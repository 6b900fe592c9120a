"""The verdict on a campaign: counts, percentages and misses with their intervals, footprint.

The estimates are those of ampi/simulation/estimates. The footprint is the area of the covariance
ellipse that holds 95 % of a bivariate normal, and its ratio between two campaigns flown on the same
draws carries a paired bootstrap interval.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.reference import Mode
from ampi.shown import Shown
from ampi.simulation.estimates.bootstrap import Estimate, mean_of
from ampi.simulation.estimates.ellipses import Ellipse, containing_ellipse, ellipse_area
from ampi.simulation.estimates.failures import counts
from ampi.simulation.estimates.paired import Flown, PairedDifference, paired
from ampi.simulation.estimates.proportions import Fraction
from ampi.simulation.estimates.spreads import Sizes, Spread
from ampi.simulation.flights import Flights

__all__ = [
    "TABLE_5_RADII",
    "AreaRatio",
    "Fraction",
    "Spread",
    "Verdict",
    "as_plain",
    "ellipse_area",
    "footprint_ratio",
    "judge",
    "paired_with_nominal",
    "ratio_to_nominal",
]

Array = NDArray[np.float64]

BOOTSTRAPS = 2000
FEWEST_FOR_RATIO = 30  # flights; below it the bootstrap draws degenerate ellipses
MEANS = ("saturation", "activity")  # of `Flights`, numbers that every flight has
TABLE_5_RADII = (25e3, 50e3, 75e3)  # m, Sagliano et al. 2016, Table 5


@dataclass(frozen=True)
class Verdict(Shown):
    """One campaign, judged."""

    law: str
    mode: str
    world: str
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
    classes: dict[str, Fraction]  # `FailureClass` → flights, all told
    means: dict[str, Estimate]  # `MEANS`: share of the cycles; rad

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {name: as_plain(value) for name, value in vars(self).items()}


def as_plain(value: Any) -> Any:
    """Estimates, whatever holds them, as what JSON has: objects, lists, numbers and words."""
    if is_dataclass(value):
        return {field.name: as_plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): as_plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [as_plain(item) for item in value]
    return value


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
        law=flights.law,
        mode=flights.mode.value,
        world=flights.world,
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
        classes={kind.name: share for kind, share in counts(flights.failures).items()},
        means={name: mean_of(getattr(flights, name)) for name in MEANS},
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

    None where nominal tracking was not flown on the same draws, or too few flights reached both.
    """
    baseline = _nominal_beside(flights, campaigns)
    if baseline is None or np.count_nonzero(flights.reached & baseline.reached) < FEWEST_FOR_RATIO:
        return None
    return footprint_ratio(flights, baseline)


def paired_with_nominal(
    flights: Flights, campaigns: Mapping[str, Flights], radii: Iterable[float]
) -> PairedDifference | None:
    """Misses less those of nominal tracking among `campaigns`, flight by flight; `radii` in m.

    None where nominal tracking was not flown on the same draws.
    """
    baseline = _nominal_beside(flights, campaigns)
    return None if baseline is None else compare(flights, baseline, radii)


def compare(
    flights: Flights, baseline: Flights, radii: Iterable[float] = (5e3, 25e3)
) -> PairedDifference:
    """Misses of one campaign less those of another on the same draws, flight by flight; `radii` in m.

    Raises
    ------
    ValueError
        If what was true of the flights differs: entries, uncertainties or seeds.
    """
    one, other = (
        Flown(
            np.column_stack([f.parameters, f.numbers, f.seeds.astype(float)]),
            np.where(f.reached, f.miss, np.inf),
        )
        for f in (flights, baseline)
    )
    return paired(one, other, radii)


def _nominal_beside(flights: Flights, campaigns: Mapping[str, Flights]) -> Flights | None:
    """What differs in the reference alone: nominal tracking by the same law, of the same draws."""
    if flights.mode is Mode.NOMINAL:
        return None
    return next((f for f in campaigns.values() if _is_nominal_of(f, flights)), None)


def _is_nominal_of(other: Flights, flights: Flights) -> bool:
    alike = ("law", "correction", "cycle", "world_sha256", "seed", "pool")
    return (
        other.mode is Mode.NOMINAL
        and all(getattr(other, name) == getattr(flights, name) for name in alike)
        and np.array_equal(other.parameters, flights.parameters)
        and np.array_equal(other.numbers, flights.numbers)
        and np.array_equal(other.seeds, flights.seeds)
    )
