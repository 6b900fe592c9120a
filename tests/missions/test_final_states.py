"""The target's rows are stated once: every formulation holds the same final states."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ampi.missions.final_states import FinalState, TargetMiss, final_states, held_states
from ampi.missions.loading import load_mission, shipped_missions
from ampi.missions.mission import Mission
from ampi.missions.path_limits import LimitKind, PathLimits
from ampi.physics.state import (
    ALTITUDE,
    AZIMUTH,
    FLIGHT_PATH_ANGLE,
    LATITUDE,
    LONGITUDE,
    N_STATES,
    SPEED,
)
from ampi.scp.literature.coast import Coast
from ampi.scp.literature.energy_domain import STATE_OF, EnergyDomain
from ampi.scp.literature.time_domain import TimeDomain
from ampi.scp.problem.scaled_problem import OptimalControlProblem

PLACE = (ALTITUDE, LONGITUDE, LATITUDE, SPEED)


def with_section(mission: Mission, section: str, **values: Any) -> Mission:
    changed = getattr(mission, section).model_copy(update=values)
    return mission.model_copy(update={section: changed})


@pytest.fixture(scope="module")
def mission() -> Mission:
    return load_mission("cavh_liu2015")


@pytest.mark.parametrize("name", shipped_missions())
def test_every_formulation_holds_the_states_of_the_mission(name: str) -> None:
    mission = load_mission(name)
    assert tuple(OptimalControlProblem.of(mission).target.state) == held_states(mission)
    over_time = TimeDomain.from_mission(mission)
    assert tuple(held.state for held in over_time.target) == held_states(mission)
    coast = Coast(np.zeros(1), np.append(mission.entry_state, 0.0)[:, None])
    over_energy = EnergyDomain(mission, coast, 1.0, 1.0)
    without_speed = tuple(state for state in held_states(mission) if state != SPEED)
    assert tuple(STATE_OF[held.state] for held in over_energy.target) == without_speed
    assert over_time.limit_names == PathLimits.of(mission).on_the_path
    assert sorted(over_energy.limit_names) == sorted(over_time.limit_names)


def test_what_is_free_and_what_is_given_decides(mission: Mission) -> None:
    bare = with_section(mission, "target", flight_path_angle=None, azimuth=None)
    assert held_states(bare) == PLACE
    assert held_states(with_section(bare, "target", position="free")) == (ALTITUDE, SPEED)
    angles = with_section(bare, "target", flight_path_angle=(-0.2, -0.1), azimuth=(3.0, 3.2))
    assert held_states(angles) == (*PLACE, FLIGHT_PATH_ANGLE, AZIMUTH)
    *place, path, azimuth = final_states(angles)
    assert all(held.lower == held.upper == held.middle for held in place)
    assert path == FinalState(FLIGHT_PATH_ANGLE, -0.2, -0.1)
    assert azimuth == FinalState(AZIMUTH, 3.0, 3.2, is_circular=True)
    weights = dict.fromkeys(("longitude_weight", "latitude_weight", "altitude_weight"), 1.0)
    soft = with_section(bare, "objective", **weights, speed_weight=0.0)
    assert held_states(soft) == (ALTITUDE, LONGITUDE, LATITUDE)


def test_a_miss_is_measured_where_the_target_is_held(mission: Mission) -> None:
    target = mission.target
    final = np.zeros(N_STATES)
    final[list(PLACE)] = target.altitude, target.longitude, target.latitude, target.speed
    mission = with_section(mission, "target", flight_path_angle=None, azimuth=(3.0, 3.2))
    final[AZIMUTH] = 3.3 - 2.0 * np.pi  # of an angle, the short way
    exact = TargetMiss.of(mission, final)
    assert exact == TargetMiss(0.0, 0.0, 0.0, {"azimuth": pytest.approx(0.1)}, is_met=True)
    final[LATITUDE] += 2e3 / mission.flight_model.planet.equatorial_radius
    final[ALTITUDE] -= 1.01 * target.altitude_tolerance
    off = TargetMiss.of(mission, final)
    assert off.horizontal == pytest.approx(2e3, rel=1e-6)
    assert off.altitude == pytest.approx(-1.01 * target.altitude_tolerance)
    assert not off.is_met
    free = TargetMiss.of(with_section(mission, "target", position="free"), final)
    assert free == replace(off, horizontal=0.0)
    nowhere = TargetMiss.of(mission, np.full(N_STATES, np.nan))
    assert not nowhere.is_met


def test_limits_are_told_apart_by_kind(mission: Mission) -> None:
    kinds = PathLimits.of(mission).kinds
    assert list(kinds.values()) == [
        *[LimitKind.LOAD] * 3,
        LimitKind.DRAG_FLOOR,
        *[LimitKind.NO_FLY_ZONE] * 2,
        *[LimitKind.CONTROL] * 2,
    ]
    assert tuple(PathLimits().kinds.values()) == (LimitKind.LOAD,) * 3 + (LimitKind.CONTROL,) * 2


def test_the_drag_floor_over_time_is_that_of_every_verdict(mission: Mission) -> None:
    """But for the step at its speed, which the methods over time smooth."""
    form, limits = TimeDomain.from_mission(mission), PathLimits.of(mission)
    speed = 7380.0 + np.array([-1000.0, -400.0, 400.0, 1000.0])
    states = np.zeros((4, N_STATES))
    states[:, ALTITUDE], states[:, SPEED] = 60e3, speed
    states[:, LATITUDE] = np.radians(30.0)
    found = form.limits(states / form.state_scale, np.zeros((4, 1)), np.zeros(4))
    expected = np.array(limits.path(mission.flight_model, states.T, 0.0)).T
    assert 1.0 < expected[0, 3] < 2.0  # the third after the loads
    expected[2:, 3] = 1.0  # where there is no floor: kept, and at the limit
    assert found == pytest.approx(expected, rel=1e-12)
