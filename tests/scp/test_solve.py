"""The solver on SHEFEX-3: laws of the optimum, warm starts, and every way to end."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.missions import Mission
from ampi.missions.family import MissionFamily
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.planet import great_circle_distance
from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.scp.condensed import exact_hessian as solver
from ampi.scp.condensed.elastic_target import ElasticSettings
from ampi.scp.condensed.exact_hessian import ExactHessianIteration
from ampi.scp.condensed.iterate import Point
from ampi.scp.condensed.quadratic_model import Multipliers
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.condensed.subproblem import ConvexSubproblem, Step, solve_subproblem
from ampi.scp.condensed.subproblem_cvxpy import solve_subproblem_cvxpy
from ampi.scp.condensed.trust_region import TrustRegionSettings
from ampi.scp.cone_program import ConeStatus
from ampi.scp.guess import ConstantBank, from_trajectory
from ampi.scp.problem.penalty import PenaltySettings
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.solve import optimum, solve, solve_family
from ampi.trajectory import Status, Trajectory

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
GUESS = ConstantBank(np.radians(-30.0))
DEGREE = np.pi / 180.0


def limited(mission: Mission, **limits: float) -> Mission:
    """The mission under other limits (SI)."""
    return mission.model_copy(update={"limits": mission.limits.model_copy(update=limits)})


def aimed(mission: Mission, **target: float) -> Mission:
    """The mission with another target (SI)."""
    return mission.model_copy(update={"target": mission.target.model_copy(update=target)})


def terminal_error(mission: Mission, trajectory: Trajectory) -> Array:
    """h, θ, φ, V at the end minus the target (SI)."""
    target = mission.target
    reference = [target.altitude, target.longitude, target.latitude, target.speed]
    return trajectory.states[:4, -1] - reference


def terminal_weights(mission: Mission) -> Array:
    """Weights of Eq. (1) in the same order (SI)."""
    objective = mission.objective
    return np.array(
        [
            objective.altitude_weight,
            objective.longitude_weight,
            objective.latitude_weight,
            objective.speed_weight,
        ]
    )


def over_limits(mission: Mission, trajectory: Trajectory) -> Array:
    """Path constraints over their limits (3, n)."""
    limits = mission.limits
    values = path_constraints(mission.flight_model, trajectory.states, trajectory.times)
    scale = [limits.dynamic_pressure, limits.heat_flux, limits.load_factor]
    return np.array(values) / np.array(scale)[:, None]


def reflown(mission: Mission, trajectory: Trajectory) -> Array:
    """Final state (6,) when the bank angle's polynomials are flown by DOP853."""
    x, final_time = trajectory.states[:6, 0], trajectory.final_time
    for s in trajectory.mesh.segments:
        start = s.start[0] + s.start[1] * final_time
        half = s.half_length[0] + s.half_length[1] * final_time
        bank = trajectory.states[6, s.nodes]

        def rates(tau: float, y: Array) -> Array:
            row = interpolation_matrix(s.rule.nodes, s.rule.barycentric, [tau])[0]  # noqa: B023
            state = np.append(y, row @ bank)  # noqa: B023
            time = start + half * (1.0 + tau)  # noqa: B023
            flow = equations_of_motion(mission.flight_model, state, 0.0, time)
            return half * np.array(flow[:6])  # noqa: B023

        x = solve_ivp(rates, (-1.0, 1.0), x, method="DOP853", rtol=1e-10, atol=1e-9).y[:, -1]
    return x


def test_the_constant_bank_guess_is_solved(mission: Mission, nominal: Trajectory) -> None:
    assert nominal.status is Status.SOLVED
    assert nominal.statistics.iterations <= 25
    assert nominal.statistics.iterations == len(nominal.statistics.log)
    assert nominal.mesh == mission.pseudospectral_mesh
    altitude, longitude, latitude, speed = terminal_error(mission, nominal)
    assert abs(altitude) < 1.0
    assert abs(longitude) * np.cos(mission.target.latitude) * 6.4e6 < 50.0
    assert abs(latitude) * 6.4e6 < 50.0
    assert abs(speed) < 0.1


def test_the_optimum_keeps_every_bound(mission: Mission, nominal: Trajectory) -> None:
    assert nominal.states[:6, 0] == pytest.approx(mission.entry_state, rel=1e-14)
    assert np.abs(nominal.states[6]).max() <= mission.limits.bank_angle * (1.0 + 1e-9)
    assert np.abs(nominal.bank_rate).max() <= mission.limits.bank_rate * (1.0 + 1e-9)
    assert over_limits(mission, nominal).max() < 1.0
    assert nominal.statistics.limit_excess == (0.0, 0.0, 0.0)


def test_the_cost_is_that_of_eq_1(mission: Mission, nominal: Trajectory) -> None:
    terminal = terminal_weights(mission) @ terminal_error(mission, nominal) ** 2
    effort = 0.0
    for s in nominal.mesh.segments:
        half = s.half_length[0] + s.half_length[1] * nominal.final_time
        rate = nominal.bank_rate[1:][s.collocation] / DEGREE
        effort += half * s.rule.weights @ rate**2
    assert nominal.cost == pytest.approx(
        terminal + mission.objective.bank_rate_effort * effort, rel=1e-9
    )


def test_the_bank_rate_is_the_derivative_of_the_bank_angle(nominal: Trajectory) -> None:
    for s in nominal.mesh.segments:
        half = s.half_length[0] + s.half_length[1] * nominal.final_time
        slope = s.rule.derivative @ nominal.states[6, s.nodes] / half
        assert slope == pytest.approx(nominal.bank_rate[1:][s.collocation], abs=1e-9)


def test_the_optimum_flies(mission: Mission, nominal: Trajectory) -> None:
    final = reflown(mission, nominal)
    there = nominal.states[:6, -1]
    assert abs(final[0] - there[0]) < 50.0
    assert great_circle_distance(*final[1:3], *there[1:3], 6.378e6) < 50.0
    assert abs(final[3] - there[3]) < 1.0


def test_the_price_of_the_target_is_its_multiplier(mission: Mission, nominal: Trajectory) -> None:
    # Envelope theorem: dJ*/d(target) = −2 w e, by solving again on either side.
    multiplier = 2.0 * terminal_weights(mission) * terminal_error(mission, nominal)
    names = ("altitude", "longitude", "latitude", "speed")
    for k, (name, shift) in enumerate(zip(names, (50.0, 1e-4, 1e-4, 1.0), strict=True)):
        reference = getattr(mission.target, name)
        costs = []
        for sign in (1.0, -1.0):
            other = solve(aimed(mission, **{name: reference + sign * shift}), guess=nominal)
            assert other.status is Status.SOLVED
            costs.append(other.cost)
        slope = (costs[0] - costs[1]) / (2.0 * shift)
        assert slope == pytest.approx(-multiplier[k], rel=1e-2)


def test_the_merit_falls_while_price_and_penalty_stand(nominal: Trajectory) -> None:
    merit = [row.merit for row in nominal.statistics.log]
    assert np.all(np.diff(merit) <= 1e-12)
    for row in nominal.statistics.log:
        assert row.step <= row.trust_radius * (1.0 + 1e-6)
    assert nominal.statistics.log[-1].step < 1e-4


def test_convergence_at_the_end_is_superlinear(nominal: Trajectory) -> None:
    steps = [row.step for row in nominal.statistics.log]
    assert steps[-1] < 0.05 * steps[-2]


@pytest.mark.parametrize("bank_deg", [-20.0, -40.0])
def test_other_guesses_find_the_same_optimum(
    mission: Mission, nominal: Trajectory, bank_deg: float
) -> None:
    other = solve(mission, guess=ConstantBank(np.radians(bank_deg)))
    assert other.status is Status.SOLVED
    assert other.cost == pytest.approx(nominal.cost, rel=1e-5)
    assert other.states[6] == pytest.approx(nominal.states[6], abs=1e-4)


def test_no_guess_is_needed(mission: Mission, nominal: Trajectory) -> None:
    # Two optima reach the target, one banked to either side at first; the mission names its own.
    alone = solve(mission)
    assert alone.status is Status.SOLVED
    assert nominal.cost * (1.0 - 1e-6) < alone.cost < 2.0 * nominal.cost


def test_a_solve_repeats_itself_to_the_bit(mission: Mission, nominal: Trajectory) -> None:
    again = solve(mission, guess=GUESS)
    assert np.array_equal(again.states, nominal.states)
    assert again.cost == nominal.cost


def test_the_optimum_is_its_own_neighbour(mission: Mission, nominal: Trajectory) -> None:
    again = solve(mission, guess=nominal)
    assert again.status is Status.SOLVED
    assert again.statistics.iterations <= 2
    assert again.cost == pytest.approx(nominal.cost, rel=1e-8)


@pytest.mark.parametrize(
    "corner", [(0,) * 6, (-1,) * 6, (0, -1, 0, -1, 0, -1), (-1, 0, 0, 0, -1, -1)]
)
def test_a_corner_of_the_hexeract_from_the_nominal(
    mission: Mission, nominal: Trajectory, corner: tuple[int, ...]
) -> None:
    entry = [axis[k] for axis, k in zip(mission.grid_axes, corner, strict=True)]
    there = solve(mission.with_entry(entry), guess=nominal)
    assert there.status is Status.SOLVED
    assert there.statistics.iterations <= 8
    assert there.states[:6, 0] == pytest.approx(entry, rel=1e-13)
    assert over_limits(mission, there).max() <= 1.0 + 1e-4


OUT_OF_REACH = {
    "too far": {"longitude": np.radians(-70.0)},
    "too far north": {"latitude": np.radians(80.0)},
    "too far south": {"latitude": np.radians(55.0)},
    "too high": {"altitude": 35e3},
    "too fast": {"speed": 1500.0},
}


@pytest.mark.parametrize("case", OUT_OF_REACH)
def test_a_target_out_of_reach_is_missed(mission: Mission, case: str) -> None:
    far = aimed(mission, **OUT_OF_REACH[case])
    missed = solve(far, guess=GUESS)
    assert missed.status is Status.TARGET_MISSED
    assert not missed.status.ok
    assert np.all(np.isfinite(missed.states))
    assert missed.cost > 1.0
    # It is a flight all the same, and keeps what it can keep.
    assert missed.states[:6, 0] == pytest.approx(mission.entry_state, rel=1e-14)
    assert np.abs(missed.states[6]).max() <= far.limits.bank_angle * (1.0 + 1e-9)
    assert over_limits(far, missed).max() <= 1.0 + 1e-4


@pytest.mark.parametrize("share", [0.98, 0.9])
def test_a_dynamic_pressure_limit_below_the_peak_is_kept(
    mission: Mission, nominal: Trajectory, share: float
) -> None:
    peak = mission.limits.dynamic_pressure * over_limits(mission, nominal)[0].max()
    soft = limited(mission, dynamic_pressure=share * peak)
    kept = optimum(soft, guess=GUESS)  # between the nodes: tests/scp/test_flown_again.py
    assert kept.status is Status.SOLVED
    assert over_limits(soft, kept)[0].max() == pytest.approx(1.0, abs=1e-6)
    assert kept.cost > nominal.cost
    assert kept.statistics.iterations <= 25
    assert max(kept.statistics.limit_excess) < 1e-6


def test_a_heat_flux_limit_below_the_peak_is_kept(mission: Mission, nominal: Trajectory) -> None:
    # The dearest of limits: its multiplier asks for a penalty that may grow more than once.
    peak = mission.limits.heat_flux * over_limits(mission, nominal)[1].max()
    cool = limited(mission, heat_flux=0.9995 * peak)
    kept = optimum(cool, guess=GUESS)
    assert kept.status is Status.SOLVED
    assert over_limits(cool, kept)[1].max() == pytest.approx(1.0, abs=1e-6)
    assert kept.cost > nominal.cost
    assert max(kept.statistics.limit_excess) < 1e-6


def test_a_hopeless_limit_is_exceeded_by_what_is_reported(
    mission: Mission, nominal: Trajectory
) -> None:
    peak = mission.limits.heat_flux * over_limits(mission, nominal)[1].max()
    cold = limited(mission, heat_flux=0.9 * peak)
    hot = solve(cold, guess=GUESS)
    assert hot.status is Status.LIMITS_EXCEEDED
    excess = np.maximum(over_limits(cold, hot).max(axis=1) - 1.0, 0.0)
    assert hot.statistics.limit_excess == pytest.approx(excess, rel=1e-9, abs=1e-12)
    assert hot.statistics.limit_excess[1] > 0.05
    assert over_limits(cold, hot)[1].max() < 1.0 / 0.9  # cooler than the unlimited optimum
    assert np.abs(terminal_error(cold, hot)[[0, 3]]).max() < 1.0


def test_a_guess_that_cannot_be_flown(mission: Mission) -> None:
    leaving = mission.entry_state.copy()
    leaving[3], leaving[4] = 9000.0, 0.3
    for guess in (GUESS, None):
        failed = solve(mission.with_entry(leaving), guess=guess)
        assert failed.status is Status.GUESS_FAILED
        assert failed.statistics.iterations == 0
        assert np.all(np.isnan(failed.states))
        assert np.isnan(failed.cost)
        assert failed.states.shape == (7, mission.pseudospectral_mesh.n_nodes)


def test_the_iteration_limit_returns_the_flight_so_far(mission: Mission) -> None:
    stopped = solve(mission, guess=GUESS, settings=SolverSettings(max_iterations=2))
    assert stopped.status is Status.ITERATION_LIMIT
    assert stopped.statistics.iterations == 2
    assert np.all(np.isfinite(stopped.states))


def test_the_time_limit_returns_the_flight_so_far(mission: Mission, nominal: Trajectory) -> None:
    settings = SolverSettings(time_limit=1e-9)
    for guess in (GUESS, nominal, None):
        stopped = solve(mission, guess=guess, settings=settings)
        assert stopped.status is Status.TIME_LIMIT
        assert np.all(np.isfinite(stopped.states))
        assert stopped.statistics.iterations == 0
    with pytest.raises(ValueError, match="time_limit"):
        SolverSettings(time_limit=0.0)


def test_a_constraint_of_the_users_own_holds(mission: Mission, nominal: Trajectory) -> None:
    """In every step, also beside a solved neighbour: here that the entry bank angle stays."""
    held = partial(solve_subproblem_cvxpy, extra_constraints=lambda z: [z[-1] == 0.0])
    found = solve(mission, guess=GUESS, subproblem=held)
    assert found.status is Status.SOLVED
    assert found.states[6, 0] == pytest.approx(GUESS.bank_angle, abs=1e-7)
    assert found.cost > nominal.cost
    entry = mission.entry.model_copy(update={"bank_angle": GUESS.bank_angle})
    asked = mission.model_copy(update={"entry": entry})
    (near,) = solve_family(MissionFamily.of([asked]), [found])
    assert near is not None
    for other in (near, solve(asked, guess=GUESS)):
        assert found.cost == pytest.approx(other.cost, rel=1e-6)
    beside = solve(mission, guess=replace(found, states=nominal.states), subproblem=held)
    assert beside.states[6, 0] == pytest.approx(nominal.states[6, 0], abs=1e-7)


def test_a_collapsed_trust_region_is_a_stall(mission: Mission) -> None:
    settings = SolverSettings(trust_region=TrustRegionSettings(initial=0.01, smallest=0.1))
    assert solve(mission, guess=GUESS, settings=settings).status is Status.STALLED


def test_a_failed_subproblem_is_a_status(mission: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(problem: ConvexSubproblem) -> Step:
        return replace(solve_subproblem(problem), status=ConeStatus.NUMERICAL_ERROR)

    monkeypatch.setattr(solver, "solve_subproblem", broken)
    failed = solve(mission, guess=GUESS)
    assert failed.status is Status.SUBPROBLEM_FAILED
    assert np.all(np.isfinite(failed.states))


def test_prices_grow_only_where_something_is_open(
    problem: OptimalControlProblem, optimum: Point
) -> None:
    settings = SolverSettings(elastic=ElasticSettings(growth=3.0))
    run = ExactHessianIteration(problem, settings)
    run.multipliers = Multipliers.first(problem, optimum)
    run.weights.price, run.weights.penalty = np.array([1.0, 2.0, 3.0, 4.0]), 5.0
    assert not run.grow_penalties(optimum)  # nothing is open
    run.multipliers = replace(run.multipliers, target=np.array([0.5, -2.0, 0.0, 4.0]))
    assert run.grow_penalties(optimum)
    assert run.weights.price == pytest.approx([1.0, 6.0, 3.0, 12.0])
    run.multipliers = replace(run.multipliers, target=np.array([0.5, 0.0, 0.0, 12.0]))
    assert not run.grow_penalties(optimum)  # once, then the target counts as out of reach
    assert run.weights.penalty == 5.0


def test_price_and_penalty_grow_on_their_own_counts(
    problem: OptimalControlProblem, optimum: Point
) -> None:
    settings = SolverSettings(
        elastic=ElasticSettings(growth=3.0, growths=1),
        penalty=PenaltySettings(growth=10.0, growths=4),
    )
    run = ExactHessianIteration(problem, settings)
    run.multipliers = Multipliers.first(problem, optimum)
    run.weights.price, run.weights.penalty = np.ones(4), 5.0
    run.multipliers = replace(run.multipliers, target=np.array([0.0, 1.0, 0.0, 0.0]))
    assert run.grow_penalties(optimum)
    run.multipliers = replace(run.multipliers, target=np.zeros(4))
    exceeded = replace(optimum, excess=np.array([0.0, 1e-5, 0.0]))
    grown = 0
    while run.grow_penalties(exceeded):
        grown += 1
    assert grown == 4  # then the limit counts as one that cannot be kept
    assert run.weights.penalty == pytest.approx(5e4)
    assert run.weights.price == pytest.approx([1.0, 3.0, 1.0, 1.0])


def test_a_neighbour_brings_its_multipliers(
    mission: Mission, problem: OptimalControlProblem, nominal: Trajectory, optimum: Point
) -> None:
    # In the solver's units: the first model is already Newton's.
    run = ExactHessianIteration(problem, SolverSettings())
    run.first_model(optimum, from_trajectory(nominal, mission))
    scale = np.array(problem.scaling.states)[:4] / problem.objective.cost_scale
    assert nominal.target_multipliers is not None
    assert run.multipliers.target == pytest.approx(nominal.target_multipliers * scale, rel=1e-14)
    assert np.all(run.weights.price > np.abs(run.multipliers.target))
    # λ = 2 w e of the terminal errors: where nothing else is known, and at an optimum the same
    anonymous = replace(nominal, target_multipliers=None)
    run.first_model(optimum, from_trajectory(anonymous, mission))
    known = 2.0 * terminal_weights(mission) * terminal_error(mission, nominal)
    assert run.multipliers.target == pytest.approx(known * scale, rel=1e-7)
    assert nominal.target_multipliers == pytest.approx(known, rel=1e-5)


def test_the_log_says_where_the_time_went(nominal: Trajectory) -> None:
    statistics = nominal.statistics
    assert 0.0 < statistics.subproblem_seconds < statistics.solve_seconds
    assert [row.iteration for row in statistics.log] == list(range(1, statistics.iterations + 1))
    assert statistics.log[-1].cost == pytest.approx(nominal.cost)
    assert nominal.summary()["status"] == "SOLVED"
