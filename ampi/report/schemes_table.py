"""One table over all schemes and worlds: tracking law × reference × world, a row each.

Every number is over all flights: one that did not reach the target speed is in no circle, and counts as
infinitely far. Differences are against nominal tracking by the same law on the same draws.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ampi.missions.mission import Mission
from ampi.report.cells import NOTHING, Cell, Group, estimate_cell, share_cell
from ampi.report.correlations import correlations
from ampi.report.quantities import DEGREES, KILO
from ampi.report.scheme_groups import scheme_groups, words
from ampi.report.verdict_tables import requirement
from ampi.simulation.estimates.failures import FailureClass
from ampi.simulation.estimates.paired import PairedDifference
from ampi.simulation.estimates.proportions import Fraction
from ampi.simulation.estimates.spreads import Sizes
from ampi.simulation.flights import Flights
from ampi.simulation.statistics import (
    AreaRatio,
    Verdict,
    as_plain,
    judge,
    paired_with_nominal,
    ratio_to_nominal,
)

RADII = (1e3, 5e3, 25e3)  # m: of the circles that schemes are compared by
COMPARED = 5e3  # m: of the one that differences are told of
SMALLEST_P = 1e-3  # that is printed as a number
NOTE = (
    "Over all flights: one that did not reach the target speed is in no circle and counts as "
    "infinitely far (∞). CVaR: mean miss of the worst 5 %. Saturation: share of the guidance cycles "
    "with bank angle or bank rate at its limit. Bank activity: ∫ |dσ/dt| dt. Differences: less "
    "nominal tracking by the same law on the same draws, flight by flight; p by McNemar's exact "
    "test. Intervals hold 95 %."
)


@dataclass(frozen=True)
class Scheme:
    """One campaign among others."""

    verdict: Verdict
    within: dict[float, Fraction]  # radius (m) → flights within it
    altitude: Sizes  # m, of the error at the end
    against_nominal: PairedDifference | None  # None: there is none on the same draws
    footprint_ratio: AreaRatio | None  # of nominal tracking's; likewise

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {
            **self.verdict.as_dict(),
            "within": as_plain({**self.verdict.within, **self.within}),
            "altitudes": as_plain(self.altitude),
            "against_nominal": as_plain(self.against_nominal),
            "footprint_ratio": as_plain(self.footprint_ratio),
        }


@dataclass(frozen=True)
class SchemesTable:
    """Rows by world and law, columns by group."""

    title: str
    note: str
    rows: Mapping[str, Mapping[str, str]]  # world and law → name of a campaign → its label
    groups: tuple[Group, ...]  # cells by the names of the campaigns


def schemes(campaigns: Mapping[str, Flights]) -> dict[str, Scheme]:
    """Every campaign judged beside the others."""
    found = {}
    for name, flights in campaigns.items():
        good = flights.reached
        miss = np.where(good, flights.miss, np.inf)
        found[name] = Scheme(
            verdict=judge(flights),
            within={radius: Fraction.of(miss < radius) for radius in RADII},
            altitude=Sizes.of(np.where(good, flights.altitude_error, np.inf)),
            against_nominal=paired_with_nominal(flights, campaigns, RADII),
            footprint_ratio=ratio_to_nominal(flights, campaigns),
        )
    return found


def schemes_table(campaigns: Mapping[str, Flights]) -> SchemesTable:
    """The table in words, worlds that differ from the model first."""
    judged = schemes(campaigns)
    rows = {
        group.title: dict(zip(group.names, group.campaigns, strict=True))
        for group in scheme_groups(campaigns)
    }
    groups = (
        _within(judged),
        _misses(judged),
        _steering(judged),
        _failures(judged),
        _differences(judged),
    )
    return SchemesTable("Worlds, laws and references", NOTE, rows, groups)


def schemes_as_dict(mission: Mission, campaigns: Mapping[str, Flights]) -> dict[str, Any]:
    """The same as plain numbers for JSON, with what is asked of a flight and what misses come from.

    Infinite numbers and those that are none are to be written as null.
    """
    return {
        "mission": mission.name,
        "passed": requirement(mission),
        "schemes": {
            name: {
                **scheme.as_dict(),
                "rank_correlations": as_plain(correlations(mission, campaigns[name])),
            }
            for name, scheme in schemes(campaigns).items()
        },
    }


def _within(judged: Mapping[str, Scheme]) -> Group:
    def row(scheme: Scheme) -> tuple[Cell, ...]:
        shares = (share_cell(fraction) for fraction in scheme.within.values())
        return Cell(str(scheme.verdict.n)), *shares

    return Group(
        "Within a distance of the target, % of flights",
        ("flights", *(f"{radius * KILO:g} km" for radius in RADII)),
        {name: row(scheme) for name, scheme in judged.items()},
    )


def _misses(judged: Mapping[str, Scheme]) -> Group:
    def row(misses: Sizes) -> tuple[Cell, ...]:
        own = (misses.median, misses.percentile_95, misses.percentile_99, misses.worst_mean)
        return tuple(estimate_cell(estimate, KILO) for estimate in own)

    return Group(
        "Miss, km",
        ("median", "95 %", "99 %", "CVaR"),
        {name: row(scheme.verdict.misses) for name, scheme in judged.items()},
    )


def _steering(judged: Mapping[str, Scheme]) -> Group:
    def row(scheme: Scheme) -> tuple[Cell, ...]:
        means = scheme.verdict.means
        return (
            estimate_cell(scheme.altitude.percentile_99, KILO),
            estimate_cell(means["saturation"], 100.0),
            estimate_cell(means["activity"], DEGREES),
        )

    return Group(
        "Altitude error and steering",
        ("altitude, 99 % (km)", "saturation (%)", "bank activity (deg)"),
        {name: row(scheme) for name, scheme in judged.items()},
    )


def _failures(judged: Mapping[str, Scheme]) -> Group:
    """Flights that passed, and those of each class that has any."""
    verdicts = {name: scheme.verdict.classes for name, scheme in judged.items()}
    kinds = [
        kind.name
        for kind in FailureClass
        if kind is FailureClass.NONE or any(v[kind.name].count for v in verdicts.values())
    ]
    return Group(
        "Why flights failed, % of flights",
        tuple("passed" if k == FailureClass.NONE.name else words(k) for k in kinds),
        {name: tuple(share_cell(v[k]) for k in kinds) for name, v in verdicts.items()},
    )


def _differences(judged: Mapping[str, Scheme]) -> Group:
    def row(paired: PairedDifference | None) -> tuple[Cell, ...]:
        if paired is None:
            return (Cell(NOTHING),) * 3
        share = paired.within[COMPARED]
        p = f"{share.p_value:.2g}" if share.p_value >= SMALLEST_P else f"< {SMALLEST_P:g}"
        return estimate_cell(paired.median, KILO), estimate_cell(share.difference, 100.0), Cell(p)

    return Group(
        "Less nominal tracking on the same draws",
        ("median (km)", f"within {COMPARED * KILO:g} km (% points)", "p"),
        {name: row(scheme.against_nominal) for name, scheme in judged.items()},
    )
