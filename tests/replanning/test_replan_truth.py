"""The optimiser beside the corrector, of one state."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import ampi
from ampi.correction.plan import equivalent_speed, plans_through
from ampi.estimation.estimate import ESTIMATED, Estimate
from ampi.estimation.settings import EstimatorSettings
from ampi.missions.mission import Mission
from ampi.onboard_model import correction_of
from ampi.physics.state import ALTITUDE, BANK, SPEED
from ampi.simulation.replan_truth import Told, Witness, alike, compared
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

TIME = 200.0  # s


@pytest.fixture(scope="module")
def mission() -> Mission:
    return ampi.load_mission("shefex3")


@pytest.fixture(scope="module")
def plan(mission: Mission) -> Trajectory:
    return ampi.solve(mission)


def told(mission: Mission, plan: Trajectory, density: float) -> Told:
    """A state of the plan in other air, and the plan as the corrector flies it."""
    states, rate = plan.at(np.linspace(TIME, plan.final_time, 60))
    gravity, target = mission.flight_model.planet.surface_gravity, mission.target
    speed = equivalent_speed(gravity, target.altitude, states[ALTITUDE], states[SPEED])
    slow, most = np.array([target.speed]), np.array([mission.limits.bank_angle])
    laid = plans_through(speed[:, None], states[BANK][:, None], speed[:1], slow, most)
    mean = np.zeros((len(ESTIMATED), 1))
    mean[0] = np.log(density)
    none = np.zeros((len(ESTIMATED), len(ESTIMATED), 1))
    estimate = Estimate(mean, none, states[ALTITUDE, :1], EstimatorSettings())
    return Told(0, TIME, np.append(states[:, 0], rate[0]), laid, estimate)


def test_both_say_that_the_target_is_in_reach(mission: Mission, plan: Trajectory) -> None:
    given = told(mission, plan, density=1.05)
    correction = correction_of(mission, angle_of_attack=False)
    found, replanned = compared(Witness.of(mission), correction, given, plan)
    assert found.verdict == "agree" and found.solved_by == "3 iterations"
    assert replanned is not None and max(found.corrector, found.optimiser) < 50.0


def test_what_is_alike() -> None:
    assert alike(10.0, 90.0) and alike(20e3, 20.9e3)
    assert not alike(10.0, 150.0) and not alike(500.0, np.inf)
    assert not alike(np.inf, np.inf)
