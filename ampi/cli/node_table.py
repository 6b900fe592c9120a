"""The nodes of a trajectory as CSV, in degrees."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

from ampi.outputs import written
from ampi.physics.state import CONTROL_UNITS, CONTROLS, STATE_UNITS, STATES

if TYPE_CHECKING:
    from ampi.onboard.reference import Reference
    from ampi.trajectory import Trajectory

PRINTED = {
    "m": "m",
    "m/s": "m_per_s",
    "rad": "deg",
    "rad/s": "deg_per_s",
}  # units, as in mission files
UNITS = ("s", *(PRINTED[unit] for unit in (*STATE_UNITS, *CONTROL_UNITS)))
COLUMNS = [f"{name}_{unit}" for name, unit in zip(("time", *STATES, *CONTROLS), UNITS, strict=True)]
HEADER = ",".join(COLUMNS)


def write_nodes(path: Path, flight: Trajectory | Reference) -> None:
    """A row for each node: time, states, bank rate."""
    import numpy as np

    values = np.vstack([flight.times, flight.states, flight.bank_rate])
    angles = [unit.startswith("deg") for unit in UNITS]
    values[angles] = np.degrees(values[angles])
    with (
        written(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for row in values.T:
            writer.writerow([f"{value:.10g}" for value in row])
