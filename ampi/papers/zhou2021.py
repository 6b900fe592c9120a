"""Zhou et al. 2021, Tables 1–6: adaptive against fixed mesh, and the two convergence conditions.

Its flight times, 2092.27 and 2095.69 s, are within 1 % of ours or explained. Two things are open in
the paper. It plans the glide alone and does not say whether its clock starts there or at the entry
interface; ours counts the coast. And Δτ̄ in Σ |u_j| Δτ̄ of Eq. (38) is no step of the mesh, for the sum
"depends mainly on the number of mesh points". From the index that it prints, 86.8 with η = 0.1766 on
237 points and 306.6 more on 400, that sum is about 67 and 380, of the order of one unit a point, where
∫ |u| dτ is 4 or less. Beside C₃ η = 100 η the small one hardly counts: an exact price on the step stops
the iteration where the target is met, far above the least ∫ |u| dτ. So the fixed mesh is solved once
more with one unit a point. As in the paper that flight ends too high, for there C₂ is no exact price.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.papers.table import UNITS, Reproduction, Row, numbers_of, solved, summary
from ampi.physics.state import ALTITUDE, BANK
from ampi.scp.literature.methods import METHODS, Solution
from ampi.scp.literature.successive import StateChange
from ampi.scp.refinement import RefinementSettings
from ampi.scp.solve import solve

POINTS = 400
Numbers = dict[str, dict[str, Any]]


def zhou2021(skip_slow: bool = False) -> Reproduction:
    """Solve, and hold against the tables."""
    mission = load_mission("cavh_zhou2021")
    method = METHODS["zhou2021"]
    by_step = StateChange((*method.convergence.tolerance, np.inf))
    by_point = POINTS * (method.own_cost_unit or 1.0)
    solutions = {
        "adaptive": solved(mission, "zhou2021"),
        "fixed": solved(mission, "zhou2021_fixed"),
        "adaptive, condition 1": solved(mission, "zhou2021", convergence=by_step),
        "fixed, one unit a point": solved(mission, "zhou2021_fixed", own_cost_unit=by_point),
    }
    ours = solve(mission, refinement=RefinementSettings(tolerance=2e-3, limit_tolerance=2e-3))
    numbers = {name: _numbers(mission, s) for name, s in solutions.items()}
    numbers["ours"] = summary(mission, ours)
    rows = (*_mesh_rows(numbers), *_time_rows(numbers), *_condition_rows(numbers))
    return Reproduction(
        "zhou2021", "Zhou et al. 2021, Tables 1–6 (CAV-H)", rows, numbers, solutions, {"ours": ours}
    )


def _numbers(mission: Mission, solution: Solution) -> dict[str, Any]:
    """`numbers_of`, with the global error of Eq. (41) and what the log says."""
    error = np.array(solution.log[-1].global_error)[:BANK]
    return {
        **numbers_of(mission, solution),
        "global_error": error.tolist(),
        "global_error_norm": float(np.linalg.norm(error / UNITS)),
        "mean_nodes": float(np.mean([row.nodes for row in solution.log])),
        "glide_seconds": solution.log[-1].final,
        "final_altitude": float(solution.trajectory.states[ALTITUDE, -1]),
    }


def _mesh_rows(numbers: Numbers) -> tuple[Row, ...]:
    """Tables 1 to 3: iterations, points, errors."""
    adaptive, fixed, own = (numbers[k] for k in ("adaptive", "fixed", "ours"))
    norm = own["end_error"]["norm"]
    return (
        Row("iterations, adaptive", "9", str(adaptive["iterations"]), str(own["iterations"]),
            "≤ 9", adaptive["iterations"] <= 9, "ours counts all rounds of refinement"),
        Row("iterations, fixed", "11", str(fixed["iterations"]), "", "≤ 11",
            fixed["iterations"] <= 11),
        Row("converged number of points", "237", str(adaptive["nodes"]), str(own["nodes"]),
            "≤ 237; ours ≤ 120", adaptive["nodes"] <= 237 and own["nodes"] <= 120),
        Row("mean number of points", "316", f"{adaptive['mean_nodes']:.0f}", ""),
        Row("global error, adaptive", "0.0904", f"{adaptive['global_error_norm']:.4f}",
            f"{norm:.1e}", "≤ 0.0904; ours ≤ 0.005",
            adaptive["global_error_norm"] <= 0.0904 and norm <= 0.005),
        Row("global error, fixed", "0.0549", f"{fixed['global_error_norm']:.4f}", "", "≤ 0.0549",
            fixed["global_error_norm"] <= 0.0549),
        Row("time per subproblem, adaptive / fixed", "0.94",
            f"{adaptive['seconds_per_subproblem'] / fixed['seconds_per_subproblem']:.2f}", "",
            note="a ratio: the machines differ"),
        Row("re-integrated: altitude, speed", "151 m, 68 m/s",
            f"{adaptive['end_error']['altitude_m']:.0f} m, "
            f"{adaptive['end_error']['speed_m_per_s']:.1f} m/s",
            f"{own['end_error']['altitude_m']:.1f} m, "
            f"{own['end_error']['speed_m_per_s']:.2f} m/s"),
    )  # fmt: skip


def _time_rows(numbers: Numbers) -> tuple[Row, ...]:
    """Section 5.1: flight times, and the final altitude where the control term weighs as printed."""
    schedule = "the angle-of-attack schedule is unpublished; several optima lie within 4 %"
    point = "fixed, one unit a point"
    return (
        _time_row(numbers, "adaptive", 2092.2707, schedule),
        _time_row(numbers, "fixed", 2095.6861, schedule),
        _time_row(numbers, point, 2095.6861, "the control term of the order that the paper prints"),
        Row(f"final altitude, {point} (m)", "27961", f"{numbers[point]['final_altitude']:.0f}", "",
            "above the target's 27000", numbers[point]["final_altitude"] > 27000.0,
            "both end too high: C₂ is no exact price for such a control term"),
    )  # fmt: skip


def _time_row(numbers: Numbers, name: str, paper: float, note: str) -> Row:
    found = numbers[name]["flight_time_s"]
    off = found / paper - 1.0
    coast = found - numbers[name]["glide_seconds"]
    return Row(
        f"flight time, {name} (s)",
        f"{paper:.2f}",
        f"{found:.2f}",
        f"{numbers['ours']['flight_time_s']:.2f}",
        "within 1 %, or explained",
        True if abs(off) <= 0.01 else None,
        f"{100 * off:+.1f} %, coast of {coast:.0f} s included; {note}",
    )


def _condition_rows(numbers: Numbers) -> tuple[Row, ...]:
    """Tables 4 to 6: convergence by the step (Eq. 44) instead of the end error (Eq. 43)."""
    adaptive, step = numbers["adaptive"], numbers["adaptive, condition 1"]
    return (
        Row("iterations, condition 1 (Eq. 44)", "22", str(step["iterations"]), "",
            "more than condition 2", step["iterations"] >= adaptive["iterations"],
            f"status {step['status']}"),
        Row("points, condition 1", "114", str(step["nodes"]), "", "fewer than condition 2",
            step["nodes"] <= adaptive["nodes"]),
    )  # fmt: skip
