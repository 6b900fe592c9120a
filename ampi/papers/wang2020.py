"""Wang et al. 2020, Table 2: end errors and time per iteration of SCP, PSCP and hp-PSCP."""

from __future__ import annotations

from typing import Any

import numpy as np

from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.papers.table import Reproduction, Row, numbers_of, solved, summary
from ampi.scp.guess import ConstantBank
from ampi.scp.literature.methods import METHODS
from ampi.scp.refinement import RefinementSettings
from ampi.scp.solve import solve

SLOW = "PSCP"  # some minutes: one dense interval of 200 nodes
ONE_METRE = 5.24e-5  # k_Q of a nose radius of 1 m, √kg/m²: its limit cannot be kept
# of the constant bank angles that `solve` tries where a limit cannot be kept, it exceeds it least
LEAST_HOT = ConstantBank(np.radians(40.5))
COLUMNS = {  # method, and the errors of altitude (m), longitude, latitude (°), speed (m/s)
    "SCP": ("wang2020_scp", (-61.6, 1.61, 0.61, -1.34)),
    "PSCP": ("wang2020_pscp", (20.3, -0.007, 0.01, -1.42)),
    "hp-PSCP": ("wang2020", (25.3, -0.04, 0.05, -1.71)),
}


def wang2020(skip_slow: bool = False) -> Reproduction:
    """Solve, and hold against the table; `skip_slow` stops PSCP after two iterations."""
    mission = load_mission("cavh_wang2020")
    most = {label: METHODS[name].max_iterations for label, (name, _) in COLUMNS.items()}
    cut = SLOW if skip_slow else None
    solutions = {
        label: solved(mission, name, max_iterations=2 if label == cut else most[label])
        for label, (name, _) in COLUMNS.items()
    }
    ours = solve(mission, refinement=RefinementSettings(tolerance=2e-3, limit_tolerance=1e-3))
    numbers = {label: numbers_of(mission, s) for label, s in solutions.items()}
    numbers["ours"] = own = summary(mission, ours)
    rows = [
        _error_row(label, numbers[label], own["end_error"], stopped=label == cut)
        for label in COLUMNS
    ]
    seconds = [numbers[k]["seconds_per_subproblem"] for k in ("SCP", "hp-PSCP", "PSCP")]
    rows.append(
        Row("seconds per iteration: SCP, hp-PSCP, PSCP", "0.12, 0.21, 2.45",
            ", ".join(f"{s:.2f}" for s in seconds), "", "SCP < hp-PSCP ≪ PSCP",
            seconds[0] < seconds[1] and 4.0 * seconds[1] < seconds[2])
    )  # fmt: skip
    numbers["largest k_Q"] = largest = _largest_heat_flux_constant(mission)
    rows.append(
        Row("largest k_Q under 1.2 MW/m²", "unprinted", f"{largest['SCP']:.3g}",
            f"{largest['ours']:.3g}", "≥ the mission's",
            min(largest.values()) >= mission.vehicle.heat_flux_constant,
            f"the mission takes {mission.vehicle.heat_flux_constant:.3g}; {ONE_METRE:.3g} (nose "
            "radius 1 m) is out of reach, and the optimum depends on it once the limit is active")
    )  # fmt: skip
    return Reproduction(
        "wang2020", "Wang et al. 2020, Table 2 (CAV-H)", tuple(rows), numbers, solutions,
        {"ours": ours},
    )  # fmt: skip


def _largest_heat_flux_constant(mission: Mission) -> dict[str, float]:
    """The k_Q with which the least peak of heat flux, found with one that is too large, is the limit.

    The peak is k_Q times a property of the flight, and a limit that cannot be kept is exceeded as
    little as can be.
    """
    vehicle = mission.vehicle.model_copy(update={"heat_flux_constant": ONE_METRE})
    hot = mission.model_copy(update={"vehicle": vehicle})
    flights = {
        "SCP": solved(hot, "wang2020_scp").trajectory,
        "ours": solve(hot, guess=LEAST_HOT),
    }
    return {k: ONE_METRE / (1.0 + f.statistics.limit_excess[1]) for k, f in flights.items()}


def _error_row(label: str, found: dict[str, Any], own: dict[str, float], *, stopped: bool) -> Row:
    """One column of the table; hp-PSCP alone is judged, by the errors that the paper prints for it."""
    altitude, longitude, latitude, speed = COLUMNS[label][1]
    error = found["end_error"]
    within = (
        abs(error["altitude_m"]) <= 25.0
        and max(abs(error["longitude_deg"]), abs(error["latitude_deg"])) <= 0.05
        and abs(error["speed_m_per_s"]) <= 1.7
    )
    judged = label == "hp-PSCP"
    return Row(
        f"{label}: end errors (h, λ, φ, V)",
        f"{altitude} m, {longitude}°, {latitude}°, {speed} m/s",
        "stopped after 2 iterations" if stopped else _errors(error),
        _errors(own),
        "≤ 25 m, 0.05°, 1.7 m/s" if judged else "",
        within if judged else None,
        f"{found['iterations']} iterations, {found['status']}",
    )


def _errors(error: dict[str, float]) -> str:
    return (
        f"{error['altitude_m']:.1f} m, {error['longitude_deg']:.3f}°, "
        f"{error['latitude_deg']:.3f}°, {error['speed_m_per_s']:.2f} m/s"
    )
