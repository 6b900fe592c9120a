"""Missions that several rooms test with, and the units in which their states are near one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission

SCALE = np.array([1e4, 1.0, 1.0, 1e3, 1.0, 1.0, 1.0])  # of the seven states: m, rad, m/s
SMALL_GRID = """[grid]
speed_m_per_s = [-70.0, 0.0, 70.0]
flight_path_angle_deg = [-0.5, 0.0, 0.5]
"""


def text_on_grid(grid: str, mission: str | Path = "shefex3") -> str:
    """The text of a mission with another [grid] table."""
    others, _, _ = load_mission(mission).toml.partition("[grid]")
    return others + grid


def coarse(shefex3: str) -> str:
    """The text of SHEFEX-3 with 47 nodes instead of 64: for optimisers that work long and in vain."""
    for degrees, fewer in (("[5, 8]", "[4, 6]"), ("[8]", "[6]"), ("[14, 14, 14]", "[10, 10, 10]")):
        old = f"degrees = {degrees}\n"
        assert shefex3.count(old) == 1
        shefex3 = shefex3.replace(old, f"degrees = {fewer}\n")
    return shefex3


def small_mission() -> Mission:
    """SHEFEX-3 on nine cases: speed × flight-path angle."""
    return parse_mission(text_on_grid(SMALL_GRID))
