"""The literature's methods over time with a second control, the rate of the angle of attack.

Their optimum is that which IPOPT finds of the same transcription, and the condensed method on the same
mesh; DOP853 flies it again.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from ampi.missions import Mission, load_mission
from ampi.physics.state import ALTITUDE, ANGLE_OF_ATTACK, BANK, SPEED
from ampi.scp.literature.collocation import radau
from ampi.scp.literature.methods import METHODS, Solution, _assemble, solve_by
from ampi.scp.literature.sparse_subproblem import solve_sparse_subproblem
from ampi.scp.literature.sparse_subproblem_cvxpy import solve_sparse_subproblem_cvxpy
from ampi.scp.literature.starts import flown, straight_line, uniform
from ampi.scp.literature.successive import StateChange
from ampi.scp.literature.time_domain import TimeDomain
from ampi.scp.problem.capabilities import MethodError, check
from ampi.scp.solve import optimum, solve
from ampi.trajectory import Status
from tests.support.sparse_witness import Transcription, witness
from tests.support.steered_sections import steered_shefex3
from tests.support.witness import scale_of

DEGREE = float(np.pi / 180.0)
TIGHT = (5.0, 1e-5, 1e-5, 0.2, 1e-5, 1e-4, 1e-3, 1e-3)
RADAU = replace(
    METHODS["wang2020"],
    start=flown(uniform(6, 6)),
    trust_region=METHODS["liu2024"].trust_region,
    convergence=StateChange(TIGHT),
)
GIVEN = {
    "bank_angle_deg": -5.0,
    "bank_rate_deg_per_s": 0.05,
    "angle_of_attack_deg": 25.0,
    "angle_of_attack_rate_deg_per_s": 0.2,
}
BY_SPEED = {"lower_deg": [10.0, 25.0], "upper_deg": [20.0, 42.0], "over": "speed"}
FREE = {"position": "free", "speed_range_m_per_s": [500.0, 600.0]}
FINAL = {"cross_range": 0.01, "final_speed": 0.001}
CASES = {
    "given at the entry": {"entry": GIVEN},
    "bounds over speed": {"angle_of_attack": BY_SPEED | {"at": [1000.0, 3000.0]}},
    "cost of the final state": {"target": FREE, "objective": FINAL},
}


@pytest.fixture(scope="module")
def mission() -> Mission:
    """A bank rate and a rate of the angle of attack, both at a price."""
    return steered_shefex3()


@lru_cache(maxsize=1)
def solved(name: str) -> tuple[Mission, Solution]:
    """A case and its solution."""
    mission = steered_shefex3(**CASES[name])
    solution = solve_by(mission, RADAU)
    assert solution is not None
    assert solution.trajectory.status is Status.SOLVED
    return mission, solution


@pytest.mark.parametrize("name", CASES)
def test_the_optimum_is_that_of_the_transcription(name: str) -> None:
    mission, solution = solved(name)
    found = witness(mission, Transcription(radau=True), solution.iterate)
    assert found.status == "Solve_Succeeded"
    assert solution.trajectory.cost == pytest.approx(found.cost, rel=1e-4)
    error = np.abs(solution.iterate.states * scale_of(mission) - found.states).max(axis=0)
    assert np.all(error <= 10.0 * np.array(TIGHT))  # one small step is no bound on those left


def test_it_is_an_optimum_of_the_condensed_method_too() -> None:
    mission, solution = solved("cost of the final state")
    mission = mission.with_mesh(solution.iterate.mesh)
    condensed = optimum(mission, guess=solution.trajectory)  # in its valley
    assert condensed.status is Status.SOLVED
    assert condensed.cost == pytest.approx(solution.trajectory.cost, rel=1e-4)
    apart = np.abs(condensed.states.T - solution.iterate.states * scale_of(mission)).max(axis=0)
    assert np.all(apart <= 10.0 * np.array(TIGHT))


def test_the_optimum_is_flown_again_under_both_angles(mission: Mission) -> None:
    flight = solve(mission, method="liu2024")
    assert flight.status is Status.SOLVED  # flown again
    assert flight.controls.shape == (2, flight.mesh.n_nodes)
    slope = flight.mesh.derivative(flight.final_time) @ flight.states[ANGLE_OF_ATTACK]
    assert flight.controls[1, 1:] == pytest.approx(slope[1:], abs=1e-6)
    assert flight.statistics.flight is not None
    assert flight.statistics.flight.position_error < 100.0
    assert np.ptp(flight.states[ANGLE_OF_ATTACK]) > 5.0 * DEGREE


def test_both_forms_of_the_subproblem_agree_and_hold_what_is_given() -> None:
    mission = steered_shefex3(entry=GIVEN, **CASES["cost of the final state"])
    start = flown(uniform(4, 5))(mission)
    assert start is not None
    builder = _assemble(mission, RADAU, start.formulation, solve_sparse_subproblem).builder
    rule = radau(start.iterate.mesh)
    problem = builder.subproblem(rule, start.iterate, 0.1)
    ours, theirs = solve_sparse_subproblem(problem), solve_sparse_subproblem_cvxpy(problem)
    assert ours.usable
    assert ours.objective == pytest.approx(theirs.objective, rel=1e-4)
    assert np.abs(ours.states - theirs.states).max() < 1e-2
    at, rates = start.iterate.states + ours.states, start.iterate.controls + ours.controls
    assert at[0, BANK:] == pytest.approx([-5.0 * DEGREE, 25.0 * DEGREE], abs=1e-6)
    expected = np.tile([0.01, 0.04], (2, 1))  # of the first node, and by the polynomial
    assert rule.first_control @ rates == pytest.approx(expected, abs=1e-6)


def test_the_gradient_of_the_final_cost_is_that_of_its_value() -> None:
    mission = steered_shefex3(**CASES["cost of the final state"])
    form = TimeDomain.from_mission(mission)
    x = np.append(mission.entry_state, [0.1, 0.3]) / form.state_scale
    x[1:3] += 0.1
    _, gradient = form.terminal(x)
    steps = 1e-6 * np.eye(len(x))
    slopes = [(form.terminal(x + e)[0] - form.terminal(x - e)[0]) / 2e-6 for e in steps]
    assert gradient == pytest.approx(slopes, abs=1e-6)
    assert np.all(gradient[[1, 2, SPEED]] != 0.0)
    assert gradient[ALTITUDE] == 0.0


def test_a_descent_keeps_its_angle_of_attack_up_to_the_handover() -> None:
    text = {"entry": {"angle_of_attack_deg": 20.0}}
    mission = steered_shefex3(**text, target={"free": ["speed"]})
    start = straight_line(31, 600.0)(mission)
    assert start is not None
    form, at = start.formulation, start.iterate
    assert isinstance(form, TimeDomain)
    assert form.coast is not None
    assert form.coast.states[ANGLE_OF_ATTACK] == pytest.approx(20.0 * DEGREE)
    assert np.isnan(form.entry[BANK])
    assert form.entry[ANGLE_OF_ATTACK] == at.states[0, ANGLE_OF_ATTACK] == 20.0 * DEGREE
    assert at.states[-1, ANGLE_OF_ATTACK] == pytest.approx(26.0 * DEGREE)  # the middle
    flight = form.trajectory(at.mesh, at.states, at.controls, at.final)
    assert flight.angle_of_attack_rate is not None
    assert flight.states.shape == (8, len(flight.angle_of_attack_rate))


@pytest.mark.parametrize(
    ("method", "changes", "told"),
    [
        ("liu2015", {}, r"angle_of_attack: .*'liu2015' \(exact_hessian, zhou2021, .* know it\)"),
        ("zhou2021", {"entry": {"bank_angle_deg": 3.0}}, r"entry\.bank_angle: .*'zhou2021'"),
        ("wang2020", {"entry": {"time_s": 3.0}}, r"entry\.time: .*exact_hessian knows it"),
        ("zhou2021", CASES["cost of the final state"], r"cross_range: .*'zhou2021'"),
    ],
)
def test_what_a_method_does_not_know_is_refused(
    method: str, changes: dict[str, dict[str, object]], told: str
) -> None:
    with pytest.raises(MethodError, match=told):
        check(steered_shefex3(**changes), method)


def test_over_energy_no_angle_is_given_at_the_entry() -> None:
    bank_alone = load_mission("cavh_liu2015")
    check(bank_alone, "liu2015")
    entry = bank_alone.entry.model_copy(update={"bank_angle": 0.1})
    with pytest.raises(MethodError, match=r"entry\.bank_angle: .*'liu2015'"):
        check(bank_alone.model_copy(update={"entry": entry}), "liu2015")
