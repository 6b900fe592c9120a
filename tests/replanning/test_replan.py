"""A plan for the rest of a flight flies and is optimal; what happens in flight is no exception."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import ampi
from ampi.estimation.estimate import Estimate
from ampi.estimation.settings import EstimatorSettings
from ampi.missions.mission import Mission
from ampi.onboard.flight_model import Factors
from ampi.propagation.reintegration import flown_again
from ampi.replanning.front_door import replan
from ampi.replanning.iteration import ReplanSettings, _size
from ampi.replanning.outcome import ReplanOutcome
from ampi.replanning.rest_of_flight import estimated, from_here
from ampi.scp.condensed.newton_system import NewtonStep
from ampi.scp.problem.capabilities import MethodError
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

OFF = np.array([150.0, 5e-4, 5e-4, 8.0, 1e-3, 1e-3, 0.0, 0.0])  # 3 km aside, and slow
FACTORS = Factors(density=1.02, lift=0.99, drag=0.99)
UNDER_WAY = (70.0, 200.0, 400.0)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return ampi.load_mission("shefex3")


@pytest.fixture(scope="module")
def plan(mission: Mission) -> Trajectory:
    return ampi.solve(mission)


def state_at(plan: Trajectory, time: float) -> Array:
    states, rate = plan.at(time)
    return np.append(states[:, 0], rate)


@pytest.mark.parametrize("time", UNDER_WAY)
def test_a_plan_flies_from_the_state_to_the_target(
    mission: Mission, plan: Trajectory, time: float
) -> None:
    here = state_at(plan, time) + OFF * (1.0 - time / plan.final_time)
    found = replan(mission, here, plan, FACTORS, time=time)
    assert found.status is ReplanOutcome.REPLANNED and found.trajectory is not None
    np.testing.assert_allclose(found.trajectory.states[:, 0], here[:7], rtol=1e-12)
    assert found.trajectory.bank_rate[0] == pytest.approx(here[7], abs=1e-9)
    # the witness is another integrator under the plan's bank angle, in the estimated model
    rest = from_here(estimated(mission, FACTORS), here, time)
    flight = flown_again(rest, found.trajectory).statistics.flight
    assert flight is not None and flight.position_error < 20.0 and not flight.exceeded
    assert found.horizontal_miss < 100.0 and abs(found.altitude_miss) < 1.0


def test_a_plan_is_the_optimum_of_the_whole_method(mission: Mission, plan: Trajectory) -> None:
    here, time = state_at(plan, 150.0) + OFF, 150.0
    exact = ReplanSettings(step=1e-3)
    found = replan(mission, here, plan, FACTORS, time=time, settings=exact)
    optimum = ampi.solve(from_here(estimated(mission, FACTORS), here, time), guess=plan)
    assert found.trajectory is not None
    assert found.trajectory.cost == pytest.approx(optimum.cost, rel=1e-4)
    assert np.abs(found.trajectory.states[6] - optimum.states[6]).max() < 2e-3


@pytest.mark.parametrize("time", UNDER_WAY)
def test_a_plan_that_is_optimal_stays(mission: Mission, plan: Trajectory, time: float) -> None:
    # Bellman: the rest of an optimum is the optimum of the rest
    found = replan(mission, state_at(plan, time), plan, time=time)
    assert found.status is ReplanOutcome.REPLANNED and found.trajectory is not None
    there = np.linspace(time, min(plan.final_time, found.trajectory.final_time), 50)
    bank = found.trajectory.at(there)[0][6]
    assert np.abs(bank - plan.at(there)[0][6]).max() < 5e-3


def test_a_plan_is_planned_on(mission: Mission, plan: Trajectory) -> None:
    first = replan(mission, state_at(plan, 100.0) + OFF, plan, FACTORS, time=100.0)
    assert first.trajectory is not None
    here = state_at(first.trajectory, 110.0)
    second = replan(mission, here, first.trajectory, FACTORS, time=110.0, iterations=1)
    assert second.status is ReplanOutcome.REPLANNED and second.trajectory is not None
    assert second.trajectory.final_time == pytest.approx(first.trajectory.final_time, abs=0.2)


def test_a_target_that_moves_is_followed(mission: Mission, plan: Trajectory) -> None:
    target = mission.target.model_copy(update={"latitude": mission.target.latitude + 0.003})
    moved = mission.model_copy(update={"target": target})
    found = replan(moved, state_at(plan, 100.0), plan, time=100.0, iterations=6)
    assert found.status is ReplanOutcome.REPLANNED and found.trajectory is not None
    assert found.trajectory.states[2, -1] == pytest.approx(target.latitude, abs=1e-4)


def test_a_target_out_of_reach_is_approached(mission: Mission, plan: Trajectory) -> None:
    here = state_at(plan, 400.0)
    here[3] -= 250.0
    found = replan(mission, here, plan, time=400.0, iterations=10)
    assert found.status is not ReplanOutcome.REPLANNED
    assert not found.horizontal_miss < 1e3


def test_what_is_measured_beyond_a_limit_counts_as_the_limit(
    mission: Mission, plan: Trajectory
) -> None:
    here, most = state_at(plan, 200.0), mission.limits.bank_angle
    here[6:] = 1.1 * most, 0.2
    found = replan(mission, here, plan, time=200.0, iterations=6)
    assert found.status.has_plan and found.trajectory is not None
    assert np.abs(found.trajectory.states[6]).max() <= most + 1e-4


def test_a_spent_budget_says_so(mission: Mission, plan: Trajectory) -> None:
    here = state_at(plan, 200.0) + 4.0 * OFF
    found = replan(mission, here, plan, time=200.0, iterations=1)
    assert found.status in (ReplanOutcome.BUDGET_SPENT, ReplanOutcome.NO_STEP)
    assert found.statistics.iterations == 1


def test_an_estimate_counts_at_the_altitude_of_the_state(
    mission: Mission, plan: Trajectory
) -> None:
    here, mean = state_at(plan, 200.0), np.array([[0.02], [0.0], [-0.03], [0.0], [0.0], [0.002]])
    estimate = Estimate(mean, np.zeros((6, 6, 1)), here[:1], EstimatorSettings())
    factors = Factors(density=np.exp(0.02), lift=np.exp(-0.03), angle_of_attack=0.002)
    one, other = (replan(mission, here, plan, e, time=200.0) for e in (estimate, factors))
    assert one.trajectory is not None and other.trajectory is not None
    np.testing.assert_array_equal(one.trajectory.states, other.trajectory.states)


def test_what_happens_in_flight_is_a_status(mission: Mission, plan: Trajectory) -> None:
    here = state_at(plan, 200.0)
    numb, low, slow, turned, away = (here.copy() for _ in range(5))
    numb[2], low[0], slow[3], turned[5], away[1] = np.nan, -10.0, 500.0, here[5] + np.pi, 1.0
    coarse = plan.mesh.after(100.0)
    statuses = {
        "no number": replan(mission, numb, plan, time=200.0).status,
        "no time": replan(mission, here, plan, time=np.nan).status,
        "below the ground": replan(mission, low, plan, time=200.0).status,
        "slow": replan(mission, slow, plan, time=200.0).status,
        "turned": replan(mission, turned, plan, time=200.0).status,
        "no estimate": replan(mission, here, plan, Factors(density=np.nan), time=200.0).status,
        "no air": replan(mission, here, plan, Factors(density=-1.0), time=200.0).status,
        "another flight": replan(mission, away, plan, time=200.0).status,
        "another mesh": replan(mission, here, replace(plan, mesh=coarse), time=200.0).status,
        "no plan": replan(mission, here, replace(plan, final_time=np.nan), time=200.0).status,
    }
    assert statuses == {
        "no number": ReplanOutcome.NO_STATE,
        "no time": ReplanOutcome.NO_STATE,
        "below the ground": ReplanOutcome.NO_STATE,
        "slow": ReplanOutcome.AT_THE_END,
        "turned": ReplanOutcome.TARGET_BEHIND,
        "no estimate": ReplanOutcome.NO_ESTIMATE,
        "no air": ReplanOutcome.NO_ESTIMATE,
        "another flight": ReplanOutcome.ANOTHER_PLAN,
        "another mesh": ReplanOutcome.ANOTHER_PLAN,
        "no plan": ReplanOutcome.NO_PLAN,
    }


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"mission": "shefex3"}, "mission: expected a Mission"),
        ({"state": np.zeros(5)}, r"state: expected shape \(6,\), \(7,\) or \(8,\), got \(5,\)"),
        ({"plan": None}, "plan: expected a reference or a Trajectory"),
        ({"estimate": 1.0}, "estimate: expected Factors, an Estimate or None"),
        ({"iterations": 0}, "iterations: expected a whole number of at least 1, got 0"),
    ],
)
def test_misuse_is_refused(
    mission: Mission, plan: Trajectory, changed: dict[str, object], sentence: str
) -> None:
    given = {"mission": mission, "state": state_at(plan, 200.0), "plan": plan, "estimate": None}
    given |= {"time": 200.0, "iterations": 3} | changed
    with pytest.raises(MethodError, match=sentence):
        replan(**given)  # type: ignore[arg-type]


def test_states_of_every_kind_are_no_exception(mission: Mission, plan: Trajectory) -> None:
    draw = np.random.default_rng(1)
    scale = np.array([2e4, 0.05, 0.05, 800.0, 0.2, 0.5, 1.5, 0.2])
    for _ in range(12):
        time = float(draw.uniform(1.0, 550.0))
        here = state_at(plan, time) + scale * draw.standard_normal(8)
        found = replan(mission, here, plan, time=time, iterations=2)
        assert found.status.has_plan == (found.trajectory is not None)


def test_a_step_whose_limits_do_not_settle_has_no_size() -> None:
    none, change = np.full((1, 5), np.nan), np.zeros((7, 1, 4))  # as NewtonSystem.solution tells it
    assert np.isnan(_size(NewtonStep(none, change, none, none), np.zeros((1, 3, 7))))
