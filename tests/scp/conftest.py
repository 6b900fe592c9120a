"""The SHEFEX-3 problem, its constant-bank flight and its optimum, shared by the solver's tests."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.missions import Mission, load_mission
from ampi.missions.loading import parse_mission
from ampi.scp.condensed.iterate import Flight, Point, RestorationSettings
from ampi.scp.guess import ConstantBank, constant_bank_guess, from_trajectory
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.solve import optimum as optimum_of
from ampi.scp.solve import solve
from ampi.trajectory import Trajectory

GUESS = ConstantBank(np.radians(-30.0))


@pytest.fixture(scope="session")
def mission() -> Mission:
    """SHEFEX-3 as shipped."""
    return load_mission("shefex3")


@pytest.fixture(scope="session")
def problem(mission: Mission) -> OptimalControlProblem:
    """Its scaled problem."""
    return OptimalControlProblem.of(mission)


@pytest.fixture(scope="session")
def flight(problem: OptimalControlProblem) -> Flight:
    """Its flight, restored far enough for finite differences."""
    return Flight.of(problem, RestorationSettings(tolerance=1e-12, corrections=20))


@pytest.fixture(scope="session")
def constant_bank_point(flight: Flight, mission: Mission) -> Point:
    """The flight at −30° of bank, restored on the mesh."""
    guess = constant_bank_guess(mission, GUESS)
    assert guess is not None
    point = flight.first_point(guess)
    assert point is not None
    return point


@pytest.fixture(scope="session")
def nominal(mission: Mission) -> Trajectory:
    """The optimum from that flight."""
    return solve(mission, guess=GUESS)


@pytest.fixture(scope="session")
def centre(mission: Mission) -> Trajectory:
    """The optimum of the mission's own branch, clear of all limits."""
    return optimum_of(mission)


@pytest.fixture(scope="session")
def optimum(flight: Flight, mission: Mission, nominal: Trajectory) -> Point:
    """The optimum as a point of `flight`."""
    point = flight.first_point(from_trajectory(nominal, mission))
    assert point is not None
    return point


@pytest.fixture(scope="session")
def drifting(mission: Mission) -> tuple[Flight, Point]:
    """A flight whose angle of attack changes up to the free final time, 20° to 15° in 2,000 s.

    There the physics depends on time at nodes that move with t_f; on SHEFEX-3 itself it does not.
    """
    text = mission.toml
    for old, new in (
        ("start = 58.0", "start = 0.0"),
        ("end = 88.0", "end = 2000.0"),
        ("start_angle_deg = 42.0", "start_angle_deg = 20.0"),
        ("end_angle_deg = 17.5", "end_angle_deg = 15.0"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    other = parse_mission(text)
    flight = Flight.of(
        OptimalControlProblem.of(other),
        RestorationSettings(tolerance=1e-12, corrections=20),
    )
    guess = constant_bank_guess(other, GUESS)
    assert guess is not None
    point = flight.first_point(guess)
    assert point is not None
    return flight, point
