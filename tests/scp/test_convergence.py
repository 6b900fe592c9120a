"""The verdict on a converged iterate, and the excess of the path limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.missions.path_limits import KEPT
from ampi.scp.problem.convergence import ConvergenceSettings, converged_status
from ampi.scp.problem.penalty import limit_excess
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.trajectory import Status

EARTH = 6.378137e6
NONE = np.zeros(3)


def final_state(
    problem: OptimalControlProblem,
    east: float = 0.0,
    north: float = 0.0,
    up: float = 0.0,
    faster: float = 0.0,
) -> np.ndarray:
    """A scaled final state off the target by metres and m/s."""
    h, lon, lat, v = problem.target.reference
    lat = lat + north / EARTH
    lon = lon + east / (EARTH * np.cos(lat))
    return np.array([h + up / 1e4, lon, lat, v + faster / 1e3, -0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("offset", "status"),
    [
        ({}, Status.SOLVED),
        ({"east": 990.0}, Status.SOLVED),
        ({"east": -1010.0}, Status.TARGET_MISSED),
        ({"north": -990.0}, Status.SOLVED),
        ({"north": 1010.0}, Status.TARGET_MISSED),
        ({"east": 800.0, "north": 800.0}, Status.TARGET_MISSED),
        ({"up": 2490.0}, Status.SOLVED),
        ({"up": -2510.0}, Status.TARGET_MISSED),
        ({"faster": -24.9}, Status.SOLVED),
        ({"faster": 25.1}, Status.TARGET_MISSED),
    ],
)
def test_the_target_is_met_within_its_tolerances(
    problem: OptimalControlProblem, offset: dict[str, float], status: Status
) -> None:
    final = final_state(problem, **offset)
    assert converged_status(ConvergenceSettings(), problem, final, NONE, bought_off=False) is status


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_an_exceeded_limit_speaks_first(problem: OptimalControlProblem, kind: int) -> None:
    excess = np.zeros(3)
    excess[kind] = 1.1 * KEPT
    far = final_state(problem, up=1e4)
    cases = ((excess, Status.LIMITS_EXCEEDED), (0.9 * 0.9 * excess, Status.TARGET_MISSED))
    for over, status in cases:
        for bought_off in (False, True):
            got = converged_status(ConvergenceSettings(), problem, far, over, bought_off=bought_off)
            assert got is status


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_a_target_that_is_bought_off_is_missed(problem: OptimalControlProblem, kind: int) -> None:
    # On the very target: bought off it counts as missed, unless a limit is exceeded.
    settings, final = ConvergenceSettings(), final_state(problem)
    excess = np.zeros(3)
    excess[kind] = 1.1 * KEPT
    assert converged_status(settings, problem, final, NONE, bought_off=False) is Status.SOLVED
    assert converged_status(settings, problem, final, NONE, bought_off=True) is Status.TARGET_MISSED
    for bought_off in (False, True):
        got = converged_status(settings, problem, final, excess, bought_off=bought_off)
        assert got is Status.LIMITS_EXCEEDED


def test_what_is_not_a_number_is_no_solution(problem: OptimalControlProblem) -> None:
    settings, final = ConvergenceSettings(), final_state(problem)
    lost = np.array([0.0, np.nan, 0.0])
    assert (
        converged_status(settings, problem, final, lost, bought_off=False) is Status.LIMITS_EXCEEDED
    )
    for state in range(4):
        off = final.copy()
        off[state] = np.nan
        assert (
            converged_status(settings, problem, off, NONE, bought_off=False) is Status.TARGET_MISSED
        )


def test_bought_off_must_be_said_by_its_name(problem: OptimalControlProblem) -> None:
    arguments = (ConvergenceSettings(), problem, final_state(problem), NONE)
    with pytest.raises(TypeError):
        converged_status(*arguments)  # type: ignore[call-arg]
    with pytest.raises(TypeError):
        converged_status(*arguments, False)  # type: ignore[misc]


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 2**32 - 1))
def test_excess_is_the_greatest_over_the_nodes(seed: int) -> None:
    path = np.random.default_rng(seed).uniform(0.0, 1.3, (20, 3))
    excess = limit_excess(path)
    for k in range(3):
        over = [g - 1.0 for g in path[:, k] if g > 1.0]
        assert excess[k] == pytest.approx(max(over, default=0.0))
    assert np.all(limit_excess(np.minimum(path, 1.0)) == 0.0)


@pytest.mark.parametrize("status", list(Status))
def test_every_status_has_a_sentence(status: Status) -> None:
    assert status.sentence.endswith(".")
    assert status.ok is (status is Status.SOLVED)
