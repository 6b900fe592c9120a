"""The nodes of a trajectory as CSV, in degrees."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

from ampi.outputs import written

if TYPE_CHECKING:
    from ampi.onboard.reference import Reference
    from ampi.trajectory import Trajectory

HEADER = (
    "time_s,altitude_m,longitude_deg,latitude_deg,speed_m_per_s,flight_path_angle_deg,azimuth_deg,"
    "bank_angle_deg,bank_rate_deg_per_s"
)


def write_nodes(path: Path, flight: Trajectory | Reference) -> None:
    """A row for each node: time, states, bank rate."""
    import numpy as np

    columns = HEADER.split(",")
    values = np.vstack([flight.times, flight.states, flight.bank_rate])
    angles = ["_deg" in column for column in columns]
    values[angles] = np.degrees(values[angles])
    with (
        written(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in values.T:
            writer.writerow([f"{value:.10g}" for value in row])
