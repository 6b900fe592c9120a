"""The nodes of a trajectory as CSV, in degrees."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

from ampi.outputs import written
from ampi.physics.state import STATES, STEERED_STATES, STEERED_UNITS, STEERING

if TYPE_CHECKING:
    from ampi.onboard.reference import Reference
    from ampi.trajectory import Trajectory

PRINTED = {
    "m": "m",
    "m/s": "m_per_s",
    "rad": "deg",
    "rad/s": "deg_per_s",
}  # units, as in mission files
STATE_COLUMNS = [
    f"{name}_{PRINTED[unit]}" for name, unit in zip(STEERED_STATES, STEERED_UNITS, strict=True)
]
CONTROL_COLUMNS = [f"{name}_deg_per_s" for name in STEERING]
HEADER = ",".join(["time_s", *STATE_COLUMNS[: len(STATES)]])  # every one begins like this


def write_nodes(path: Path, flight: Trajectory | Reference) -> None:
    """A row for each node: time, states, rates of what is steered.

    Of a reference the bank rate alone: a table holds no other.
    """
    import numpy as np

    from ampi.trajectory import Trajectory

    if isinstance(flight, Trajectory):
        states, controls = flight.states, flight.controls
    else:
        states, controls = flight.layout.flight_states(flight.rows), flight.bank_rate[None]
    columns = ["time_s", *STATE_COLUMNS[: len(states)], *CONTROL_COLUMNS[: len(controls)]]
    values = np.vstack([flight.times, states, controls])
    angles = [name.endswith(("_deg", "_deg_per_s")) for name in columns]
    values[angles] = np.degrees(values[angles])
    with (
        written(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in values.T:
            writer.writerow([f"{value:.10g}" for value in row])
