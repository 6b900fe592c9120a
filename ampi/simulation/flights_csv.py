"""Flights as a table for other programs: CSV, one row per campaign and flight, units in the header."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.units import si_key
from ampi.outputs import written
from ampi.simulation.estimates.failures import FailureClass
from ampi.simulation.flights import Flights
from ampi.simulation.plant import FlightStatus
from ampi.simulation.uncertainties import CATALOGUE

ENDS = {  # of the numbers of a flight: column → name in `Flights`
    "miss_m": "miss",
    "along_m": "along",
    "across_m": "across",
    "altitude_error_m": "altitude_error",
    "speed_error_m_per_s": "speed_error",
    "final_time_s": "final_time",
    "saturated_share": "saturation",
    "bank_activity_rad": "activity",
    "rebound_m": "rebound",
    "distance_at_entry_m": "distance",
    "least_range_m": "least_range",
    "greatest_range_m": "greatest_range",
}


def write_flights_csv(path: str | Path, mission: Mission, campaigns: Mapping[str, Flights]) -> None:
    """Write campaigns (name → flights of `mission`) as CSV.

    Parameters stand in the units of the mission's grid, what else was uncertain in any of the campaigns
    in SI units, peaks as shares of their limits; a flight that has not passed has a class of failure and
    names every reason. What is not known of a flight is `nan`.
    """
    for name, flights in campaigns.items():
        if flights.mission_sha256 != mission.digest:
            raise ValueError(
                f"campaigns: expected flights of {mission.name}, got {name} of {flights.mission}, "
                "or of an earlier version of it"
            )
    varied = _varied(list(campaigns.values()))
    tables = [_columns(name, mission, flights, varied) for name, flights in campaigns.items()]
    with (
        written(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(tables[0] if tables else [])
        for columns in tables:
            writer.writerows(zip(*columns.values(), strict=True))


def _varied(campaigns: Sequence[Flights]) -> dict[str, int]:
    """Column, with its unit, and place in the catalogue of all that is not nominal in every flight."""
    found = {}
    for i, uncertainty in enumerate(CATALOGUE):
        if any(np.any(flights.numbers[:, i] != uncertainty.nominal) for flights in campaigns):
            dimension = uncertainty.dimension
            unit = "" if dimension is None else f"_{si_key(dimension)}"
            found[uncertainty.name + unit] = i
    return found


def _columns(
    name: str, mission: Mission, flights: Flights, varied: Mapping[str, int]
) -> dict[str, list[str]]:
    """Header → values of all flights of a campaign."""
    of_all = {
        "campaign": name,
        "law": flights.law,
        "reference": flights.mode.value,
        "world": flights.world,
    }
    faults = flights.faults
    reasons = [[why for why, failed in faults.items() if failed[i]] for i in range(flights.n)]
    return {
        **{column: [word] * flights.n for column, word in of_all.items()},
        "flight": [str(i) for i in range(flights.n)],
        **{
            parameter.key: _decimal(flights.parameters[:, i] / parameter.number.per_unit, 12)
            for i, parameter in enumerate(mission.parameters)
        },
        **{column: _decimal(flights.numbers[:, i], 12) for column, i in varied.items()},
        "outside_hypercube": _yes_or_no(flights.clipped),
        "in_a_hole": _yes_or_no(flights.hole),
        "status": [FlightStatus(status).name for status in flights.status],
        "passed": _yes_or_no(flights.passed),
        "failure": [FailureClass(kind).name for kind in flights.failures],
        "failed_by": [";".join(why) for why in reasons],
        **{column: _decimal(getattr(flights, own), 10) for column, own in ENDS.items()},
        **{
            f"peak_{limit}_over_limit": _decimal(flights.peak[:, i], 10)
            for i, limit in enumerate(flights.limits)
        },
    }


def _decimal(values: NDArray[np.float64], digits: int) -> list[str]:
    return [f"{value:.{digits}g}" for value in values]


def _yes_or_no(values: NDArray[np.bool_]) -> list[str]:
    return ["yes" if value else "no" for value in values]
