"""The numbers printed in Sagliano, Mooij and Theil, AIAA 2016-2115: Table 5, Sections V.A and VI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ampi.missions.loading import load_mission, shipped_missions
from ampi.missions.mission import Mission

PAPER_MISSION = "shefex3"
PAPER_WORLD = "entry"  # Eq. (34)
PAPER_LAW = "drag_sliding_mode"  # the kind of its tracker
# what makes a mission the one of its name; grid, mesh and optimum are the user's
_PHYSICAL = {"name", "planet", "atmosphere", "vehicle", "entry", "target", "limits", "no_fly_zone"}
PAPER_FLIGHTS = 1000


@dataclass(frozen=True)
class Printed:
    """One guidance mode of the paper, on its 1000 flights."""

    label: str
    rings: tuple[int, ...]  # Table 5, flights
    within: Mapping[float, int]  # radius (m) → flights
    worst_altitude: float  # m
    worst_speed: float  # m/s
    area: float  # km²
    area_ratio: str = ""


PAPER = (
    Printed(
        label="AMPI 2016",
        rings=(1000, 0, 0, 0),
        within={6.5e3: 740, 13e3: 985, 25e3: 1000},
        worst_altitude=200.0,
        worst_speed=2.0,
        area=214.0,
        area_ratio="4.2 %",
    ),
    Printed(
        label="nominal 2016",
        rings=(746, 242, 12, 0),
        within={6.5e3: 163, 13e3: 400, 25e3: 746},
        worst_altitude=1500.0,
        worst_speed=3.0,
        area=5032.0,
    ),
)


def is_shipped(mission: Mission) -> bool:
    """Whether it is a mission of this package, whatever its grid: a name alone says nothing."""
    if mission.name not in shipped_missions():
        return False
    shipped = load_mission(mission.name)
    return mission.model_dump(include=_PHYSICAL) == shipped.model_dump(include=_PHYSICAL)


def is_of_the_paper(mission: Mission) -> bool:
    """Whether the paper's numbers may stand beside those of this mission."""
    return mission.name == PAPER_MISSION and is_shipped(mission)
