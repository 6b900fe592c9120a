"""Betts 2010, Section 6.1: the Space Shuttle's greatest cross-range, free and under a heating limit."""

from __future__ import annotations

from typing import Any

import numpy as np

from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.papers.table import Reproduction, Row, summary
from ampi.physics.state import LATITUDE
from ampi.scp.solve import solve
from ampi.trajectory import Trajectory

NO_LIMIT = 1e8  # W/m²: fifty times what the free optimum meets
CASES = {"free": 34.1412, "heating limit": 30.6255}  # degrees, as printed
WITHIN = 1e-3  # degrees


def betts2010_case(case: str) -> Mission:
    """The mission of a case."""
    mission = load_mission("shuttle_betts2010")
    if case == "heating limit":
        return mission
    limits = mission.limits.model_copy(update={"heat_flux": NO_LIMIT})
    return mission.model_copy(update={"limits": limits})


def betts2010(skip_slow: bool = False) -> Reproduction:
    """Section 6.1: both optima by our method; his is a direct transcription, too, and has no other."""
    rows, numbers, ours = list[Row](), dict[str, Any](), dict[str, Trajectory]()
    for case, printed in CASES.items():
        mission = betts2010_case(case)
        ours[case] = found = solve(mission)
        numbers[case] = own = summary(mission, found)
        own["latitude_deg"] = latitude = float(np.degrees(found.states[LATITUDE, -1]))
        rows += [
            Row(f"{case}: final latitude", f"{printed:.4f}°", "", f"{latitude:.4f}°", "within 0.001°",
                abs(latitude - printed) <= WITHIN),
            Row(f"{case}: flight time", "2008.6 s" if case == "free" else "–", "",
                f"{found.final_time:.1f} s"),
            Row(f"{case}: re-integrated end", "–", "", f"{own['end_error']['horizontal_m']:.0f} m away",
                "≤ 50 m", own["end_error"]["horizontal_m"] <= 50.0,
                f"{own['nodes']} nodes, {own['iterations']} iterations"),
        ]  # fmt: skip
    title = "Betts 2010, Section 6.1 (Space Shuttle, two controls)"
    return Reproduction("betts2010", title, tuple(rows), numbers, {}, ours)
