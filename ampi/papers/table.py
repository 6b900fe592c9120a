"""One table of a reproduction: paper, ours by the same method, ours by our method; and its numbers.

Each row says what must hold and whether it does. Every solution is re-integrated (DOP853, along its own
bank angle) and the errors at the end stand in the table. Where an input of a paper is unpublished the
row says so and is not judged.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.angles import wrapped
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import BANK
from ampi.propagation.reintegration import reintegrate
from ampi.scp.literature.methods import CIRCULAR_SPEED, EARTH_RADIUS, METHODS, Solution, solve_by
from ampi.trajectory import Trajectory

UNITS = np.array([EARTH_RADIUS, 1.0, 1.0, CIRCULAR_SPEED, 1.0, 1.0])  # of Zhou's normalised norm


@dataclass(frozen=True)
class Row:
    """One line of a table."""

    quantity: str
    paper: str
    same_method: str
    our_method: str
    must_hold: str = ""
    holds: bool | None = None  # None: not judged
    note: str = ""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """One paper: its table and the trajectories behind it."""

    paper: str
    title: str
    rows: tuple[Row, ...]
    numbers: dict[str, Any]
    solutions: dict[str, Solution]
    ours: dict[str, Trajectory]

    @property
    def holds(self) -> bool:
        """Whether every judged row does."""
        return all(row.holds for row in self.rows if row.holds is not None)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        rows = [asdict(row) for row in self.rows]
        return {"title": self.title, "holds": self.holds, "rows": rows, "numbers": self.numbers}


def end_errors(mission: Mission, trajectory: Trajectory) -> dict[str, float]:
    """Re-integrated minus optimised state at the end, and the greatest use of a limit on the way."""
    flown, limits = reintegrate(mission, trajectory), PathLimits.of(mission)
    error = flown.states[0, :, -1] - trajectory.states[:BANK, -1]
    error[[1, 5]] = wrapped(error[[1, 5]])
    radius = mission.flight_model.planet.equatorial_radius
    final = trajectory.states[:, -1]
    away = great_circle_distance(
        final[1], final[2], final[1] + error[1], final[2] + error[2], radius
    )
    degrees = np.degrees(error)
    return {
        "altitude_m": float(error[0]),
        "longitude_deg": float(degrees[1]),
        "latitude_deg": float(degrees[2]),
        "speed_m_per_s": float(error[3]),
        "flight_path_angle_deg": float(degrees[4]),
        "azimuth_deg": float(degrees[5]),
        "horizontal_m": float(away),
        "norm": float(np.linalg.norm(error / UNITS)),
        "greatest_limit_use": float(flown.peak[0, : len(limits.on_the_path)].max()),
    }


def heat_load(mission: Mission, trajectory: Trajectory) -> float:
    """∫ Q̇ dt of the re-integrated flight from the entry interface, MJ/m²."""
    flown = reintegrate(mission, trajectory)
    heat_flux = flown.fine_path[0, 1] * mission.limits.heat_flux
    return float(np.trapezoid(heat_flux, flown.fine_times[0])) / 1e6


def summary(mission: Mission, trajectory: Trajectory) -> dict[str, Any]:
    """What a table may print of a trajectory."""
    statistics = trajectory.statistics
    return {
        "status": trajectory.status.name,
        "iterations": statistics.iterations,
        "nodes": trajectory.mesh.n_nodes,
        "flight_time_s": trajectory.final_time,
        "cost": trajectory.cost,
        "seconds": statistics.solve_seconds,
        "seconds_per_subproblem": statistics.subproblem_seconds / max(1, statistics.iterations),
        "end_error": end_errors(mission, trajectory),
    }


def numbers_of(mission: Mission, solution: Solution) -> dict[str, Any]:
    """`summary` of a method's solution, with the nodes that it optimised."""
    found = summary(mission, solution.trajectory)
    return {**found, "nodes": solution.iterate.mesh.n_nodes}


def solved(mission: Mission, name: str, **parts: Any) -> Solution:
    """The solution by method `name`, with other `parts` where given."""
    found = solve_by(mission, replace(METHODS[name], **parts))
    if found is None:
        raise ValueError(f"{name}: its guess does not fly on {mission.name}")
    return found
