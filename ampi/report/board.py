"""What a review board asks first: what was asked, what came of it in each world, and what decides it.

A scheme is called the best of its world if the most of its flights pass; among equals, the one whose
median miss is the smallest. It is chosen on the flights that judge it, and its share reads the better
for that: the table beside it has all of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.report.cells import Cell, Group, estimate_cell, share_cell
from ampi.report.quantities import KILO
from ampi.report.scheme_groups import (
    UNCORRECTED,
    by_world,
    differs_from_model,
    is_corrected,
    words,
)
from ampi.report.verdict_tables import requirement
from ampi.simulation.estimates.bootstrap import Estimate
from ampi.simulation.estimates.proportions import Fraction
from ampi.simulation.estimates.spreads import Sizes
from ampi.simulation.flights import Flights

NOTE = (
    "Over all flights: one that did not reach the target speed has passed by nothing and counts as "
    "infinitely far (∞). Brackets hold 95 %."
)


@dataclass(frozen=True)
class Board:
    """One paragraph and one table."""

    sentences: tuple[str, ...]
    rows: Mapping[str, Mapping[str, str]]  # world → name of a campaign → its scheme in words
    group: Group  # cells by the names of the campaigns
    note: str = NOTE


@dataclass(frozen=True, eq=False)
class _Judged:
    """What the board sees of one campaign."""

    flights: Flights
    scheme: str
    passed: Fraction
    misses: Sizes  # m

    @property
    def rank(self) -> tuple[float, float]:
        """The greatest is the best."""
        return self.passed.count / self.passed.n, -self.misses.median.value


def board(mission: Mission, campaigns: Mapping[str, Flights]) -> Board:
    """Of all campaigns, worlds that differ from the model first."""
    several = len({flights.law for flights in campaigns.values()}) > 1
    worlds = {
        world: {name: _judged(flights, several) for name, flights in own.items()}
        for world, own in by_world(campaigns).items()
    }
    told = [_of_world(world, list(own.values())) for world, own in worlds.items()]
    judged = {name: one for own in worlds.values() for name, one in own.items()}
    return Board(
        (f"A flight has passed if it ends {requirement(mission)}", *told),
        {world: {name: one.scheme for name, one in own.items()} for world, own in worlds.items()},
        Group(
            "Flights",
            ("flights", "passed (%)", "limits kept (%)", "median miss (km)", "95 % within (km)"),
            {name: _row(one) for name, one in judged.items()},
        ),
    )


def scheme_words(flights: Flights, with_law: bool) -> str:
    """Reference, what corrects it, and the law that tracks it."""
    law = f"{words(flights.law)}, " if with_law else ""
    corrected = f", corrected by {words(flights.correction)}" if is_corrected(flights) else ""
    return f"{law}{flights.mode.value}{corrected}"


def _judged(flights: Flights, with_law: bool) -> _Judged:
    miss = np.where(flights.reached, flights.miss, np.inf)
    scheme = scheme_words(flights, with_law)
    return _Judged(flights, scheme, Fraction.of(flights.passed), Sizes.of(miss))


def _row(one: _Judged) -> tuple[Cell, ...]:
    faults = [one.flights.faults[name] for name in one.flights.limits]
    kept = ~np.any(faults, axis=0) if faults else np.ones(one.flights.n, dtype=bool)
    return (
        Cell(f"{one.flights.n:,}"),
        share_cell(one.passed),
        share_cell(Fraction.of(kept)),
        estimate_cell(one.misses.median, KILO),
        estimate_cell(one.misses.percentile_95, KILO),
    )


def _of_world(world: str, judged: list[_Judged]) -> str:
    """The best scheme of a world in numbers, and what it is to be held against."""
    best = max(judged, key=lambda one: one.rank)
    kind = "which differs from the model" if differs_from_model(best.flights) else "as modelled"
    does = "does best" if len(judged) > 1 else "flies"
    near, far = (_distance(one) for one in (best.misses.median, best.misses.percentile_95))
    parts = (
        f"In the world {world}, {kind}, {best.scheme} {does}: {_passes(best)}.",
        f"Half of its flights end within {near} of the target, 95 % within {far}.",
        _why(best),
        _against(best, judged),
    )
    return " ".join(part for part in parts if part)


def _passes(one: _Judged) -> str:
    return f"{one.passed} of {one.flights.n:,} flights pass"


def _distance(estimate: Estimate) -> str:
    unit, per_si = ("m", 1.0) if estimate.value < 1e3 else ("km", KILO)
    cell = estimate_cell(estimate, per_si)
    return f"{cell.value} {unit} {cell.interval}".strip()


def _against(best: _Judged, judged: list[_Judged]) -> str:
    """The same without correction, else nominal tracking."""
    corrected = is_corrected(best.flights)
    mode = best.flights.mode if corrected else Mode.NOMINAL
    wanted = (best.flights.law, mode, UNCORRECTED)
    others = (one for one in judged if one is not best)
    for other in others:
        flights = other.flights
        if (flights.law, flights.mode, flights.correction) == wanted:
            how = "Without correction" if corrected else "By nominal tracking"
            return f"{how} {_passes(other)}."
    return ""


def _why(best: _Judged) -> str:
    """What the best scheme fails by."""
    counts = {words(reason): int(np.sum(hits)) for reason, hits in best.flights.faults.items()}
    failed = [f"{reason} ({count})" for reason, count in counts.items() if count]
    return f"The others fail by {', '.join(failed)}." if failed else ""
