"""Longitude, azimuth and bank angle are the same modulo a turn, for every method."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ampi.missions import Mission, load_mission
from ampi.missions.family import MissionFamily
from ampi.missions.final_states import FinalState
from ampi.physics.angles import wrapped
from ampi.physics.state import CIRCULAR_STATES
from ampi.scp.guess import ConstantBank, from_trajectory
from ampi.scp.literature.starts import straight_line
from ampi.scp.problem.convergence import ConvergenceSettings, converged_status
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.problem.shortfall import shortfall
from ampi.scp.solve import solve, solve_family
from ampi.trajectory import Status, Trajectory
from tests.scp.conftest import GUESS
from tests.support.missions import SCALE

TURN = 2.0 * np.pi


def turned(mission: Mission, **turns: float) -> Mission:
    """`mission` with whole turns added to numbers: entry__azimuth=1."""
    sections: dict[str, Any] = {}
    for key, count in turns.items():
        section, _, name = key.partition("__")
        before = sections.get(section, getattr(mission, section))
        value = getattr(before, name) + count * TURN
        sections[section] = before.model_copy(update={name: value})
    return mission.model_copy(update=sections)


def assert_same_flight(one: Trajectory, other: Trajectory, *, rel: float = 1e-7) -> None:
    assert (one.status, one.final_time) == (other.status, pytest.approx(other.final_time, rel=rel))
    assert one.cost == pytest.approx(other.cost, rel=rel)
    off = one.states - other.states
    off[list(CIRCULAR_STATES)] = wrapped(off[list(CIRCULAR_STATES)])
    assert np.abs(off / SCALE[:, None]).max() < 1e-5


TURNS: list[dict[str, float]] = [
    {"target__longitude": 1},
    {"entry__longitude": 1},
    {"entry__azimuth": 1, "guess__bank_angle": -1},
]


@pytest.fixture(scope="module")
def shipped(mission: Mission) -> Trajectory:
    """The optimum from the mission's own guess."""
    return solve(mission)


@pytest.mark.parametrize("turns", TURNS, ids=str)
def test_an_optimum_does_not_depend_on_the_turn(
    mission: Mission, shipped: Trajectory, turns: dict[str, float]
) -> None:
    assert_same_flight(solve(turned(mission, **turns)), shipped)


def test_a_flight_across_the_date_line(mission: Mission, nominal: Trajectory) -> None:
    # the planet is the same all around
    there = np.radians(-170.0)
    entry = mission.entry.model_copy(update={"longitude": there})
    longitude = wrapped(there + mission.target.longitude - mission.entry.longitude)
    assert longitude > 0.0
    target = mission.target.model_copy(update={"longitude": longitude})
    found = solve(mission.model_copy(update={"entry": entry, "target": target}), guess=GUESS)
    assert found.final_time == pytest.approx(nominal.final_time, rel=1e-9)


def test_a_neighbour_on_another_turn_is_as_good_a_guess(
    mission: Mission, nominal: Trajectory
) -> None:
    states = nominal.states.copy()
    states[list(CIRCULAR_STATES)] += TURN * np.array([[1.0], [-1.0], [2.0]])
    neighbour = replace(nominal, states=states)
    here = turned(mission, target__longitude=1)
    assert from_trajectory(neighbour, here).states == pytest.approx(nominal.states.T, abs=1e-12)
    assert_same_flight(solve(here, guess=neighbour), nominal)
    (together,) = solve_family(MissionFamily.of([here]), [neighbour])
    assert together is not None
    assert_same_flight(together, nominal)


def test_a_bank_angle_and_one_a_turn_further_are_one_guess(mission: Mission) -> None:
    assert ConstantBank(GUESS.bank_angle + TURN).bank_angle == pytest.approx(GUESS.bank_angle)
    assert solve(mission, guess=ConstantBank(GUESS.bank_angle - TURN)).status is Status.SOLVED


def test_a_final_azimuth_may_be_asked_for_on_any_turn(
    mission: Mission, nominal: Trajectory
) -> None:
    final = float(nominal.states[5, -1])
    costs = []
    for turns in (0, 1):
        span = tuple(np.radians([-6.0, -3.0]) + final + turns * TURN)
        target = mission.target.model_copy(update={"azimuth": span})
        asked = mission.model_copy(update={"target": target})
        found = solve(asked, guess=GUESS)
        assert found.status is Status.SOLVED
        assert wrapped(found.states[5, -1] - span[1]) == pytest.approx(0.0, abs=1e-6)
        costs.append(found.cost)
        missed = replace(nominal, status=Status.TARGET_MISSED)
        assert shortfall(asked, missed) == ["the final azimuth is 3° off"]
        assert shortfall(asked, replace(found, status=Status.TARGET_MISSED)) == []
    assert costs[0] == pytest.approx(costs[1], rel=1e-9)


def test_the_methods_over_energy_do_not_depend_on_the_turn() -> None:
    mission = load_mission("x33_liu2015")
    other = turned(mission, entry__azimuth=1, target__longitude=-1)
    assert_same_flight(solve(other, method="liu2015"), solve(mission, method="liu2015"))


def test_straight_lines_go_the_short_way() -> None:
    mission, widths = load_mission("cavh_zhou2021"), []
    for turns in ({}, {"target__longitude": -1}, {"entry__longitude": 1, "entry__azimuth": 1}):
        start = straight_line(5, 1700.0)(turned(mission, **turns))
        assert start is not None
        line = start.iterate.states[:, 1]
        widths.append(line[-1] - line[0])
    assert 1.2 < widths[0] < 1.3  # rad: of the 80° from entry to target some are coasted
    assert widths == pytest.approx([widths[0]] * 3, abs=1e-9)


def test_a_final_angle_of_the_literature_is_reached_the_short_way() -> None:
    held = FinalState(1, 3.0, 3.2, is_circular=True)
    assert held.change(3.1 - TURN) == pytest.approx((-0.1, 0.1))
    assert held.change(2.9 + 2.0 * TURN) == pytest.approx((0.1, 0.3))
    assert FinalState(2, 3.0, 3.2).change(3.1 - TURN) == pytest.approx((TURN - 0.1, TURN + 0.1))


def test_a_miss_near_the_pole_is_a_distance(mission: Mission) -> None:
    # 500 m beyond the pole, on the meridian opposite to a target 400 m before it
    target = mission.target.model_copy(update={"latitude": 0.5 * np.pi - 400.0 / 6378137.0})
    problem = OptimalControlProblem.of(mission.model_copy(update={"target": target}))
    final = np.zeros(7)
    final[problem.target.state] = problem.target.reference
    final[1], kept = target.longitude + np.pi, np.zeros(3)
    settings = ConvergenceSettings()
    for beyond, status in ((500.0, Status.SOLVED), (700.0, Status.TARGET_MISSED)):
        final[2] = 0.5 * np.pi - beyond / 6378137.0
        assert converged_status(settings, problem, final, kept, bought_off=False) is status
