"""The verdict names what is open: the limit and by how much, the distance to the target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.missions import Mission
from ampi.missions.flight_sections import NoFlyZoneSection
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import LOADS
from ampi.scp.problem.shortfall import outcome_sentence, shortfall
from ampi.trajectory import Statistics, Status, Trajectory


def with_section(mission: Mission, section: str, **values: object) -> Mission:
    """The mission with other numbers (SI) in a section."""
    changed = getattr(mission, section).model_copy(update=values)
    return mission.model_copy(update={section: changed})


def test_a_solution_leaves_nothing_open(mission: Mission, nominal: Trajectory) -> None:
    assert shortfall(mission, nominal) == []
    flight = nominal.statistics.flight
    assert flight is not None
    assert outcome_sentence(mission, nominal) == (
        f"{Status.SOLVED.sentence} Flown again, it lies at most {flight.position_error:.3g} m from its "
        f"nodes and uses {100.0 * max(flight.use.values()):.4g} % of bank_angle, its nearest limit."
    )
    unflown = replace(nominal, statistics=replace(nominal.statistics, flight=None))
    assert outcome_sentence(mission, unflown) == Status.SOLVED.sentence


@pytest.mark.parametrize("kind", range(3))
def test_an_exceeded_limit_is_named(mission: Mission, nominal: Trajectory, kind: int) -> None:
    peak = path_constraints(mission.flight_model, nominal.states, nominal.times)[kind].max()
    tight = with_section(mission, "limits", **{LOADS[kind]: peak / 1.25})
    assert shortfall(tight, nominal) == [f"{LOADS[kind]} is 25 % above its limit"]


def test_a_zone_that_is_entered_is_named(mission: Mission, nominal: Trajectory) -> None:
    longitude, latitude = nominal.states[1:3, 30]
    zone = NoFlyZoneSection.model_construct(longitude=longitude, latitude=latitude, radius=50e3)
    closed = mission.model_copy(update={"no_fly_zone": (zone,)})
    assert shortfall(closed, nominal) == [
        "no_fly_zone 1 is entered, as near to its centre as 0.00 of its radius"
    ]


def test_drag_below_its_floor_is_named(mission: Mission, nominal: Trajectory) -> None:
    floor = with_section(mission, "limits", drag_floor=100.0, drag_floor_speed=7000.0)
    (phrase,) = shortfall(floor, nominal)
    assert phrase.startswith("drag is ")
    assert phrase.endswith("% below the drag_floor")


def test_each_final_state_that_is_off_is_named(mission: Mission, nominal: Trajectory) -> None:
    target = mission.target
    elsewhere = with_section(
        mission,
        "target",
        latitude=target.latitude + np.radians(2.0),
        altitude=target.altitude + 5e3,
        speed=target.speed - 300.0,
        flight_path_angle=(0.1, 0.2),
    )
    place, height, speed, angle = shortfall(elsewhere, nominal)
    assert place == "the flight ends 223 km from the target"
    assert height == "5 km too low"
    assert speed == "300 m/s too fast"
    assert angle.startswith("the final flight_path_angle is ")
    assert angle.endswith("° off")


def test_the_verdict_joins_the_sentence_and_what_is_open(
    mission: Mission, nominal: Trajectory
) -> None:
    away = with_section(mission, "target", latitude=mission.target.latitude + np.radians(2.0))
    unflown = replace(nominal.statistics, flight=None)
    missed = replace(nominal, status=Status.TARGET_MISSED, statistics=unflown)
    assert outcome_sentence(away, missed) == (
        f"{Status.TARGET_MISSED.sentence} Open: the flight ends 223 km from the target."
    )


def test_where_there_is_no_flight_there_is_nothing_to_say(
    mission: Mission, nominal: Trajectory
) -> None:
    nowhere = np.full_like(nominal.states, np.nan)
    nothing = replace(nominal, states=nowhere, status=Status.GUESS_FAILED, statistics=Statistics())
    assert outcome_sentence(mission, nothing) == Status.GUESS_FAILED.sentence
