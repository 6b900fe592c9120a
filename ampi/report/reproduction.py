"""The tables of the four optimiser papers: paper, ours by the same method, ours by our method.

Zhou 2021, Wang 2020 and Liu 2024 stand in `reproduction_zhou2021` and the like, Liu 2015 here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ampi.missions.mission import Mission, load_mission
from ampi.report.reproduction_liu2024 import liu2024
from ampi.report.reproduction_table import Reproduction, Row, heat_load, summary
from ampi.report.reproduction_table import numbers_of as _of
from ampi.report.reproduction_table import solved as _solved
from ampi.report.reproduction_wang2020 import wang2020
from ampi.report.reproduction_zhou2021 import zhou2021
from ampi.scp.methods import Solution, loose_nodes
from ampi.scp.solve import solve
from ampi.trajectory import Trajectory

LIU_CASES: dict[str, tuple[dict[str, float], str, float | None]] = {
    "minimum time": ({"flight_time": 1.0, "heat_load": 0.0}, "1214 s", 1214.0),
    "maximum time": ({"flight_time": -1.0, "heat_load": 0.0}, "1344 s", 1344.0),
    "minimum heat load": ({"flight_time": 0.0, "heat_load": 1.0}, "530.1 MJ/m²", None),
}


def liu2015_case(case: str) -> Mission:
    """The X-33 mission under the objective of a case."""
    mission = load_mission("x33_liu2015")
    objective = mission.objective.model_copy(update=LIU_CASES[case][0])
    return mission.model_copy(update={"objective": objective})


def liu2015(skip_slow: bool = False) -> Reproduction:
    """Table 2 and Section V.B: X-33; and what the CAV-H between no-fly zones gives."""
    rows, numbers = list[Row](), dict[str, Any]()
    solutions, ours = dict[str, Solution](), dict[str, Trajectory]()
    for case, (_, paper, _) in LIU_CASES.items():
        mission = liu2015_case(case)
        solutions[case] = found = _solved(mission, "liu2015")
        wide = mission.limits.model_copy(update={"bank_angle_minimum": 0.0})
        ours[case] = own = solve(mission.model_copy(update={"limits": wide}))
        numbers[case] = same = _of(mission, found)
        numbers[f"{case}, ours"] = mine = summary(mission, own)
        numbers[case]["loose_nodes"] = loose = loose_nodes(found).tolist()
        heat = case == "minimum heat load"
        same["heat_load"] = heat_load(mission, found.trajectory)
        mine["heat_load"] = heat_load(mission, own)
        value = "heat_load" if heat else "flight_time_s"
        near = abs(same[value] / mine[value] - 1.0) <= 0.01
        rows += [
            Row(case, paper,
                f"{same['heat_load']:.1f} MJ/m²" if heat else f"{same['flight_time_s']:.1f} s",
                f"{mine['heat_load']:.1f} MJ/m²" if heat else f"{mine['flight_time_s']:.1f} s",
                "within 1 % of ours", near,
                "surrogate vehicle: compare the two of ours; ours, without the 15° minimum bank, is "
                "IPOPT's optimum on its transcription (tests/scp/test_nlp_witness.py)"),
            Row(f"{case}: iterations", "6", str(same["iterations"]), str(mine["iterations"]),
                "≤ 6", same["iterations"] <= 6),
            Row(f"{case}: loose nodes of 201", "at reversals", str(len(loose)), "",
                "only at reversals", len(loose) <= _reversals(found)),
            Row(f"{case}: re-integrated altitude, speed", "–",
                f"{same['end_error']['altitude_m']:.0f} m, "
                f"{same['end_error']['speed_m_per_s']:.1f} m/s",
                f"{mine['end_error']['altitude_m']:.0f} m, "
                f"{mine['end_error']['speed_m_per_s']:.1f} m/s"),
        ]  # fmt: skip
    mission = load_mission("cavh_liu2015")
    solutions["no-fly zones"] = zones = _solved(mission, "liu2015")
    numbers["no-fly zones"] = same = _of(mission, zones)
    numbers["no-fly zones"]["loose_nodes"] = loose = loose_nodes(zones).tolist()
    rows.append(
        Row("no-fly zones: iterations", "6", f"{same['iterations']} ({same['status']})", "", "≤ 6",
            same["iterations"] <= 6,
            f"{len(loose)} loose nodes: with the surrogate the vehicle must shed range, and the "
            "relaxed problem does it by less lift")
    )  # fmt: skip
    return Reproduction(
        "liu2015", "Liu, Shen, Lu 2015, Table 2 (X-33)", tuple(rows), numbers, solutions, ours
    )


def _reversals(solution: Solution) -> int:
    """Sign changes of the bank angle along the nodes."""
    sine = solution.iterate.controls[:, 1]
    return int(np.count_nonzero(np.diff(np.sign(sine))))


PAPERS: dict[str, Callable[[bool], Reproduction]] = {
    "zhou2021": zhou2021,
    "liu2015": liu2015,
    "wang2020": wang2020,
    "liu2024": liu2024,
}
