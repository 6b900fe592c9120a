"""Liu et al. 2024, the table of results: modified hp with reduction against hp without."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ampi.missions.loading import load_mission
from ampi.papers.table import Reproduction, Row, numbers_of, solved, summary
from ampi.scp.refinement import RefinementSettings
from ampi.scp.solve import solve

ANGLES = ("longitude", "latitude", "flight_path_angle", "azimuth")
Numbers = dict[str, dict[str, Any]]


def liu2024(skip_slow: bool = False) -> Reproduction:
    """Solve, and hold against the table."""
    mission = load_mission("rlv_liu2024")
    solutions = {"reduced": solved(mission, "liu2024"), "hp": solved(mission, "liu2024_hp")}
    ours = solve(mission, refinement=RefinementSettings(tolerance=3e-4, limit_tolerance=1e-4))
    numbers = {label: numbers_of(mission, s) for label, s in solutions.items()}
    for label, s in solutions.items():
        numbers[label]["rounds"] = [asdict(r) for r in s.rounds]
    numbers["ours"] = summary(mission, ours)
    rows = (*_mesh_rows(numbers), *_error_rows(numbers))
    return Reproduction(
        "liu2024", "Liu et al. 2024, result table (RLV)", rows, numbers, solutions, {"ours": ours}
    )


def _mesh_rows(numbers: Numbers) -> tuple[Row, ...]:
    """Points and iterations."""
    reduced, hp, own = (numbers[k] for k in ("reduced", "hp", "ours"))
    return (
        Row("points", "258", str(reduced["nodes"]), str(own["nodes"]), "≤ 258",
            reduced["nodes"] <= 258),
        Row("points of hp without reduction", "548", str(hp["nodes"]), "", "more than reduced",
            hp["nodes"] > reduced["nodes"]),
        Row("iterations", "15", str(reduced["iterations"]), str(own["iterations"]), "≤ 15",
            reduced["iterations"] <= 15, "ours counts all rounds of refinement"),
    )  # fmt: skip


def _error_rows(numbers: Numbers) -> tuple[Row, ...]:
    """Errors of the flight flown again, limits between the nodes, objective."""
    reduced, own = numbers["reduced"], numbers["ours"]
    error, mine = reduced["end_error"], own["end_error"]
    angles = max(abs(error[f"{k}_deg"]) for k in ANGLES)
    return (
        Row("altitude error", "−27.75 m", f"{error['altitude_m']:.2f} m",
            f"{mine['altitude_m']:.2f} m", "< 28 m", abs(error["altitude_m"]) < 28.0),
        Row("speed error", "−6.22 m/s", f"{error['speed_m_per_s']:.2f} m/s",
            f"{mine['speed_m_per_s']:.2f} m/s", "≤ 6.3 m/s", abs(error["speed_m_per_s"]) <= 6.3),
        Row("greatest angle error", "0.03°", f"{angles:.3f}°", "", "≤ 0.04°", angles <= 0.04),
        Row("greatest use of a limit, between nodes", "–", f"{error['greatest_limit_use']:.4f}",
            f"{mine['greatest_limit_use']:.4f}", "≤ 1", error["greatest_limit_use"] <= 1.0),
        Row("objective, ∫|σ̇| dt", "199.41°", f"{reduced['cost']:.2f}°", f"{own['cost']:.2f}°",
            note="limits and schedule of the paper are unpublished: orders only"),
    )  # fmt: skip
