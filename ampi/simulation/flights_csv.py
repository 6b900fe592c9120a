"""Flights as a table for other programs: CSV, one row per campaign and flight, units in the header."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from ampi.missions.mission import Mission
from ampi.outputs import written
from ampi.simulation.closed_loop import FlightStatus
from ampi.simulation.flights import Flights


def write_flights_csv(path: str | Path, mission: Mission, campaigns: Mapping[str, Flights]) -> None:
    """Write campaigns (name → flights of `mission`) as CSV.

    Parameters stand in the units of the mission's grid, peaks as shares of their limits; a flight that
    has not passed names every reason. What is not known of a flight is `nan`.
    """
    limits = next((flights.limits for flights in campaigns.values()), ())
    for name, flights in campaigns.items():
        if flights.mission_sha256 != mission.digest:
            raise ValueError(
                f"campaigns: expected flights of {mission.name}, got {name} of {flights.mission}, "
                "or of an earlier version of it"
            )
    header = [
        "campaign",
        "flight",
        *(parameter.key for parameter in mission.parameters),
        "outside_hypercube",
        "in_a_hole",
        "status",
        "passed",
        "failed_by",
        "miss_m",
        "along_m",
        "across_m",
        "altitude_error_m",
        "speed_error_m_per_s",
        "final_time_s",
        *(f"peak_{limit}_over_limit" for limit in limits),
    ]
    with (
        written(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(header)
        for name, flights in campaigns.items():
            writer.writerows(_rows(name, mission, flights))


def _rows(name: str, mission: Mission, flights: Flights) -> Iterator[list[str]]:
    parameters = flights.parameters / [p.number.per_unit for p in mission.parameters]
    numbers = np.column_stack(
        [
            flights.miss,
            flights.along,
            flights.across,
            flights.altitude_error,
            flights.speed_error,
            flights.final_time,
            flights.peak,
        ]
    )
    faults = flights.faults
    for i in range(flights.n):
        reasons = [reason for reason, failed in faults.items() if failed[i]]
        yield [
            name,
            str(i),
            *(f"{value:.12g}" for value in parameters[i]),
            "yes" if flights.clipped[i] else "no",
            "yes" if flights.hole[i] else "no",
            FlightStatus(flights.status[i]).name,
            "no" if reasons else "yes",
            ";".join(reasons),
            *(f"{value:.10g}" for value in numbers[i]),
        ]
