"""A flight told cycle by cycle, as CSV: what was flown, and what it was to follow."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from ampi.outputs import written
from ampi.physics.state import STATE_UNITS, STATES
from ampi.simulation.flights import Flights


def write_log(path: str | Path, flights: Mapping[str, Flights]) -> None:
    """Write single flights (name → a campaign of one), a row per recorded point; SI and rad."""
    with written(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        limits = next(iter(flights.values())).limits
        keys = [f"{n}_{u.replace('/', '_per_')}" for n, u in zip(STATES, STATE_UNITS, strict=True)]
        writer.writerow(
            [
                "time_s",
                "scheme",
                *keys,
                *(f"reference_{key}" for key in keys),
                "bank_rate_rad_per_s",
                "angle_of_attack_change_rad",
                *(f"{limit}_over_limit" for limit in limits),
            ]
        )
        for name, one in flights.items():
            writer.writerows(_rows(name, one))


def _rows(name: str, flights: Flights) -> Iterator[list[str]]:
    states, references, path = flights.states[0], flights.reference_states[0], flights.path[0]
    rate, angle = flights.bank_rate[0], flights.angle_of_attack[0]
    for k in np.flatnonzero(np.isfinite(states[0])):
        numbers = [*states[:, k], *references[:, k], rate[k], angle[k], *path[:, k]]
        yield [f"{flights.times[k]:.6f}", name, *(repr(float(value)) for value in numbers)]
