"""What the campaigns proved, as tables of text: one source for the terminal and for the page.

Columns are campaigns, then the paper's printed numbers where it prints any for this mission. Every
percentage carries its exact 95 % interval, the paper's too (computed here from its counts of 1000).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ampi.correction.corrector import CorrectionOutcome
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.report.cells import NOTHING, Cell, Group, estimate_cell, number
from ampi.report.published import PAPER, PAPER_FLIGHTS, PAPER_WORLD, Printed, is_of_the_paper
from ampi.report.quantities import KILO
from ampi.report.scheme_groups import is_corrected, words
from ampi.simulation.estimates.ellipses import ellipse_area_estimate
from ampi.simulation.estimates.spreads import Sizes
from ampi.simulation.flights import Flights
from ampi.simulation.plant import FlightStatus
from ampi.simulation.statistics import (
    TABLE_5_RADII,
    Fraction,
    Spread,
    Verdict,
    judge,
    ratio_to_nominal,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VerdictTable:
    """Groups with the same columns, and what a reader must know to read them."""

    title: str
    note: str
    groups: tuple[Group, ...]
    flown: tuple[str, ...]
    printed: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Column labels: our campaigns, then the paper's."""
        return self.flown + self.printed


def verdict_tables(mission: Mission, campaigns: Mapping[str, Flights]) -> tuple[VerdictTable, ...]:
    """Judge every campaign and set the verdicts side by side."""
    verdicts = {name: judge(flights) for name, flights in campaigns.items()}
    paper = PAPER if is_like_the_paper(mission, campaigns) else ()
    flown, printed = tuple(campaigns), tuple(p.label for p in paper)
    distances = (_rings(verdicts, paper), _within(verdicts, paper))
    return (
        VerdictTable(
            "Passed or failed",
            f"Passed: {requirement(mission)} A flight may fail by more than one of them.",
            _passed(verdicts),
            flown,
        ),
        VerdictTable(
            "Distance from the target",
            "A flight that did not reach the target speed is outside every circle.",
            distances if paper else distances[1:],
            flown,
            printed,
        ),
        VerdictTable(
            "Size of the final errors",
            "Over the flights that reached the target speed. A flight ends where its speed equals "
            "the target's, so our speed errors are those of locating that instant. The worst of a "
            "campaign has no interval.",
            _spreads(campaigns, verdicts, paper),
            flown,
            printed,
        ),
        VerdictTable(
            "Footprint",
            "Area of the 95 % covariance ellipse, and its ratio to nominal tracking on the same "
            "draws with a paired bootstrap interval. "
            + ("The paper does not say how it measured area. " if paper else "")
            + "A covariance follows its outliers: read the area beside the circles.",
            (_footprints(campaigns, paper),),
            flown,
            printed,
        ),
        VerdictTable(
            "Limits, hypercube and failures",
            "Limits are read at every plant step. Nominal tracking does not look at the hypercube.",
            (*_health(campaigns, verdicts), *corrections(campaigns)),
            flown,
        ),
    )


def is_like_the_paper(mission: Mission, campaigns: Mapping[str, Flights]) -> bool:
    """Whether the paper's numbers may stand beside these: its mission, in the world that it flew in."""
    in_its_world = all(flights.world == PAPER_WORLD for flights in campaigns.values())
    return in_its_world and is_of_the_paper(mission)


def requirement(mission: Mission) -> str:
    """What a flight must do to pass, by the mission's own tolerances."""
    target = mission.target
    place = f"{target.position_tolerance * KILO:g} km of the target, "
    return (
        f"within {place if target.position == 'fixed' else ''}"
        f"{target.altitude_tolerance * KILO:g} km of its altitude and "
        f"{target.speed_tolerance:g} m/s of its speed, and every limit kept."
    )


def coincident(campaigns: Mapping[str, Flights]) -> tuple[str, ...]:
    """A sentence for each campaign whose flights are those of an earlier one: their marks cover it."""
    found, seen = [], dict[str, Flights]()
    for name, flights in campaigns.items():
        twin = next((n for n, other in seen.items() if _are_same(flights, other)), None)
        if twin is None:
            seen[name] = flights
        else:
            found.append(
                f"{name} coincides with {twin}: every flight ends within a metre of its own."
            )
    return tuple(found)


def _are_same(flights: Flights, other: Flights) -> bool:
    if not np.array_equal(flights.parameters, other.parameters):
        return False
    pairs = ((flights.along, other.along), (flights.across, other.across))
    return all(np.allclose(a, b, rtol=0.0, atol=1.0, equal_nan=True) for a, b in pairs)


def _printed_fraction(count: int) -> Cell:
    return Cell.of(Fraction.of(np.arange(PAPER_FLIGHTS) < count))


def _passed(verdicts: Mapping[str, Verdict]) -> tuple[Group, ...]:
    reasons = next(iter(verdicts.values())).failed_by
    return (
        Group(
            "Flights passed, % [95 % interval]",
            ("passed",),
            {name: (Cell.of(v.passed),) for name, v in verdicts.items()},
        ),
        Group(
            "Failed by, % of flights [95 % interval]",
            tuple(map(words, reasons)),
            {
                name: tuple(Cell.of(v.failed_by[reason]) for reason in reasons)
                for name, v in verdicts.items()
            },
        ),
    )


def _rings(verdicts: Mapping[str, Verdict], paper: tuple[Printed, ...]) -> Group:
    edges = [f"{radius * KILO:g}" for radius in TABLE_5_RADII]
    between = [f"{a} to {b} km" for a, b in pairwise(edges)]
    cells = {name: tuple(Cell.of(f) for f in v.rings) for name, v in verdicts.items()}
    cells |= {p.label: tuple(_printed_fraction(c) for c in p.rings) for p in paper}
    return Group(
        "Circles of Table 5, % of flights [95 % interval]",
        (f"within {edges[0]} km", *between, "outside"),
        cells,
    )


def _within(verdicts: Mapping[str, Verdict], paper: tuple[Printed, ...]) -> Group:
    radii = tuple(next(iter(verdicts.values())).within)  # of the one mission that all flew
    cells = {name: tuple(map(Cell.of, v.within.values())) for name, v in verdicts.items()}
    for p in paper:
        cells[p.label] = tuple(
            _printed_fraction(p.within[r]) if r in p.within else Cell(NOTHING) for r in radii
        )
    return Group(
        "Within a radius, % of flights [95 % interval]",
        tuple(f"within {radius * KILO:g} km" for radius in radii),
        cells,
    )


def _spreads(
    campaigns: Mapping[str, Flights], verdicts: Mapping[str, Verdict], paper: tuple[Printed, ...]
) -> tuple[Group, ...]:
    def group(name: str, error: str, worst: Mapping[str, float]) -> Group:
        cells = {
            key: _sizes(getattr(flights, error)[flights.reached], getattr(verdicts[key], of[error]))
            for key, flights in campaigns.items()
        }
        for key, value in worst.items():
            cells[key] = (Cell(NOTHING), Cell(NOTHING), Cell(number(value)))
        return Group(name, ("median", "99 %", "worst"), cells)

    of = {"miss": "miss", "altitude_error": "altitude", "speed_error": "speed"}
    unprinted = {p.label: float("nan") for p in paper}
    altitude = {p.label: p.worst_altitude for p in paper}
    speed = {p.label: p.worst_speed for p in paper}
    return (
        group("Miss distance (m)", "miss", unprinted),
        group("Altitude error (m)", "altitude_error", altitude),
        group("Speed error (m/s)", "speed_error", speed),
    )


def _sizes(errors: Array, spread: Spread) -> tuple[Cell, ...]:
    """Median and 99th percentile with their intervals; the worst has none."""
    if not len(errors):
        return (Cell(NOTHING),) * 3
    found = Sizes.of(errors)
    own = (found.median, found.percentile_99)
    return *(estimate_cell(one, 1.0) for one in own), Cell(number(spread.worst))


def _footprints(campaigns: Mapping[str, Flights], paper: tuple[Printed, ...]) -> Group:
    cells = {
        name: (_area(flights), _ratio(flights, campaigns)) for name, flights in campaigns.items()
    }
    for p in paper:
        cells[p.label] = (Cell(number(p.area)), Cell(p.area_ratio or NOTHING))
    return Group("Covariance ellipse of 95 %", ("area (km²)", "of nominal's area"), cells)


def _area(flights: Flights) -> Cell:
    good = flights.reached
    return estimate_cell(ellipse_area_estimate(flights.along[good], flights.across[good]), KILO**2)


def _ratio(flights: Flights, campaigns: Mapping[str, Flights]) -> Cell:
    ratio = ratio_to_nominal(flights, campaigns)
    return Cell(NOTHING) if ratio is None else Cell(str(ratio))


def _health(campaigns: Mapping[str, Flights], verdicts: Mapping[str, Verdict]) -> tuple[Group, ...]:
    shares, peaks, failures = {}, {}, {}
    failed = {s: words(s.name) for s in FlightStatus if s is not FlightStatus.REACHED_SPEED}
    for name, v in verdicts.items():
        flights = campaigns[name]
        outside = Cell(NOTHING) if flights.mode is Mode.NOMINAL else Cell.of(v.clipped)
        shares[name] = (Cell.of(v.reached), Cell.of(v.limits_kept), outside)
        peaks[name] = tuple(Cell(f"{100.0 * s.worst:.1f}") for s in v.peak.values())
        failures[name] = tuple(Cell.of(Fraction.of(flights.status == int(s))) for s in failed)
    loads = next(iter(verdicts.values())).peak
    return (
        Group(
            "% of flights [95 % interval]",
            ("target speed reached", "all limits kept", "outside hypercube"),
            shares,
        ),
        Group("Worst use of a limit, %", tuple(map(words, loads)), peaks),
        Group("Failures, % of flights [95 % interval]", tuple(failed.values()), failures),
    )


def corrections(campaigns: Mapping[str, Flights]) -> tuple[Group, ...]:
    """What has become of the corrections of all flights, if any campaign corrects its plans."""
    correcting = {n: f.corrections for n, f in campaigns.items() if is_corrected(f)}
    if not correcting:
        return ()
    came = [own for own in CorrectionOutcome if any(c[:, own].any() for c in correcting.values())]
    lost = CorrectionOutcome.OUT_OF_REACH
    cells = dict.fromkeys(campaigns, (Cell(NOTHING),) * (len(came) + 1)) | {
        name: (
            *(Cell(f"{counts[:, own].sum():,}") for own in came),
            Cell.of(Fraction.of(counts[:, lost] > 0)),
        )
        for name, counts in correcting.items()
    }
    quantities = (*(words(own.name) for own in came), "flights ever out of reach")
    return (Group("Corrections by their outcomes", quantities, cells),)
