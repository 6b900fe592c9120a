"""The convex subproblem: its optimality laws, and Clarabel's form against the cvxpy form."""

from __future__ import annotations

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.scp.condensed.elastic_target import elastic_cost, is_elastic, reference_price
from ampi.scp.condensed.iterate import Flight, Point, RestorationSettings
from ampi.scp.condensed.quadratic_model import (
    CurvatureSettings,
    Multipliers,
    quadratic_subproblem,
    with_merit,
)
from ampi.scp.condensed.subproblem import ConvexSubproblem, Step, solve_subproblem
from ampi.scp.condensed.subproblem_cvxpy import solve_subproblem_cvxpy
from ampi.scp.cone_program import ConeStatus
from ampi.scp.problem.scaled_problem import OptimalControlProblem, Target

Array = NDArray[np.float64]


def model_at(
    flight: Flight, point: Point, *, gauss_newton: bool, radius: float, price: float
) -> ConvexSubproblem:
    """The solver's subproblem at `point`, elastic price in units of its reference."""
    problem, t = flight.problem, flight.transcription
    zero = Multipliers.first(problem, point)
    known = np.clip(2.0 * problem.target.weight * point.target_error, -1e3, 1e3)
    multipliers = zero if gauss_newton else replace(zero, target=known)
    linearised = flight.linearise(point.iterate)
    convex = quadratic_subproblem(
        flight,
        point,
        linearised,
        multipliers,
        met=None if gauss_newton else np.ones(4, dtype=bool),
        settings=CurvatureSettings(),
    )
    final_time = point.iterate.final_time
    effort = problem.reference_cost(final_time)
    curvature = 2.0 * problem.objective.effort[0] * t.half_lengths(final_time) * t.weights
    scale = reference_price(convex.target_map[:, :-2], curvature, 2.0 * effort)
    return with_merit(convex, radius=radius, price=price * scale, penalty=20.0 * effort)


def under_heat_limit(mission: Mission, heat_flux: float) -> Flight:
    """The flight of the mission under another heat-flux limit (W/m²)."""
    limits = mission.limits.model_copy(update={"heat_flux": heat_flux})
    problem = OptimalControlProblem.of(mission.model_copy(update={"limits": limits}))
    return Flight.of(problem, RestorationSettings())


CASES = ["elastic", "met", "path limit kept", "path limit exceeded", "no path rows"]


@pytest.fixture(params=CASES)
def convex(
    request: pytest.FixtureRequest,
    mission: Mission,
    flight: Flight,
    constant_bank_point: Point,
    optimum: Point,
) -> ConvexSubproblem:
    """Subproblems of SHEFEX-3 in which different rows decide."""
    case = request.param
    here, best = constant_bank_point.iterate, optimum.iterate
    if case == "elastic":
        return model_at(flight, constant_bank_point, gauss_newton=True, radius=0.3, price=6.0)
    near = flight.restore(replace(best, controls=0.99 * best.controls), None)
    assert near is not None
    if case == "met":
        return model_at(flight, near, gauss_newton=False, radius=0.3, price=100.0)
    if case == "no path rows":
        cool = model_at(flight, near, gauss_newton=True, radius=0.3, price=100.0)
        return replace(
            cool,
            path_rows=cool.path_rows[:0],
            path_room=cool.path_room[:0],
            path_kind=cool.path_kind[:0],
            path_node=cool.path_node[:0],
        )
    if case == "path limit kept":
        peak = mission.limits.heat_flux * near.path[:, 1].max()
        limited = under_heat_limit(mission, 0.9999 * peak)
        point = limited.evaluate(near.iterate)
        tight = model_at(limited, point, gauss_newton=True, radius=0.3, price=100.0)
        return replace(tight, limit_penalty=100.0 * tight.limit_penalty)
    peak = mission.limits.heat_flux * constant_bank_point.path[:, 1].max()
    limited = under_heat_limit(mission, 0.95 * peak)
    return model_at(limited, limited.evaluate(here), gauss_newton=True, radius=0.3, price=6.0)


def objective(convex: ConvexSubproblem, z: Array) -> float:
    """Eq. (1) with e, v and s minimised out."""
    excess = np.zeros(convex.n_limits)
    np.maximum.at(excess, convex.path_kind, convex.path_rows @ z - convex.path_room)
    return float(
        0.5 * z @ convex.hessian @ z
        + convex.gradient @ z
        + convex.absolute_weight @ np.abs(convex.absolute_value + convex.absolute_rows @ z)
        + elastic_cost(
            convex.target_error + convex.target_map @ z, convex.target, convex.target_price
        )
        + convex.limit_penalty * excess.sum()
    )


def violation(convex: ConvexSubproblem, z: Array) -> float:
    """Greatest violation of the hard bounds."""
    rate = np.abs(convex.rate + convex.rate_rows @ z) - 1.0
    bank = convex.angle_rows @ z
    outside = np.maximum(bank - convex.angle_upper, convex.angle_lower - bank)
    final_time = abs(z[convex.final_time_column]) - convex.radius
    return float(max(rate.max(), outside.max(), final_time))


def test_the_step_keeps_the_hard_bounds(convex: ConvexSubproblem) -> None:
    step = solve_subproblem(convex)
    assert step.usable
    assert violation(convex, step.z) < 1e-6


def test_no_nearby_feasible_step_is_better(convex: ConvexSubproblem) -> None:
    # Convexity: towards any feasible point the objective does not fall.
    step = solve_subproblem(convex)
    best = objective(convex, step.z)
    assert best < objective(convex, np.zeros_like(step.z))
    rng = np.random.default_rng(4)
    tried = 0
    for size in (1e-4, 1e-3, 1e-2, 1e-1):
        for _ in range(25):
            other = step.z * (1.0 - size) + size * rng.normal(size=len(step.z)) * 0.01
            if violation(convex, other) <= 0.0:
                tried += 1
                assert objective(convex, other) >= best - 1e-6 * abs(best)
    assert tried > 50


def test_stationarity_of_the_lagrangian(convex: ConvexSubproblem) -> None:
    # With the bank rate and δt_f inside their bounds, the multipliers of `Step` are all there are.
    step = solve_subproblem(convex)
    assert np.abs(convex.rate + convex.rate_rows @ step.z).max() < 0.99
    assert abs(step.z[convex.final_time_column]) < 0.99 * convex.radius
    terms = np.stack(
        [
            convex.hessian @ step.z,
            convex.gradient,
            convex.target_map.T @ step.target_multiplier,
            convex.angle_rows.T @ step.angle_multiplier,
            convex.path_rows.T @ step.path_multiplier,
        ]
    )
    assert np.abs(terms.sum(axis=0)).max() < 1e-5 * np.abs(terms).max()


def test_multipliers_belong_to_their_rows(convex: ConvexSubproblem) -> None:
    step = solve_subproblem(convex)
    error = convex.target_error + convex.target_map @ step.z
    # The elastic target: λ = 2 w e until it costs ν.
    assert np.all(np.abs(step.target_multiplier) <= convex.target_price * (1.0 + 1e-9))
    met = step.target_multiplier / (2.0 * convex.target.weight)
    elastic = is_elastic(step.target_multiplier, convex.target_price)
    assert np.abs(error - met)[~elastic].max(initial=0.0) < 1e-7
    assert np.all((np.sign(error) * (error - met))[elastic] > -1e-7)
    bank = convex.angle_rows @ step.z
    scale = max(1.0, np.abs(step.angle_multiplier).max())
    free = np.minimum(convex.angle_upper - bank, bank - convex.angle_lower) > 1e-3
    assert np.abs(step.angle_multiplier[free]).max(initial=0.0) < 1e-4 * scale
    room = convex.path_room + step.slack[convex.path_kind] - convex.path_rows @ step.z
    assert np.all(step.path_multiplier >= 0.0)
    assert np.abs(step.path_multiplier * room).max(initial=0.0) < 1e-3
    assert step.path_multiplier.sum() <= 3.0 * convex.limit_penalty * (1.0 + 1e-6)


def test_the_cases_are_what_they_are_called(
    convex: ConvexSubproblem, request: pytest.FixtureRequest
) -> None:
    step = solve_subproblem(convex)
    case = request.node.callspec.params["convex"]
    elastic = is_elastic(step.target_multiplier, convex.target_price)
    pressed = step.path_multiplier.max(initial=0.0) / convex.limit_penalty
    if case == "elastic":
        assert elastic.any()
        assert step.slack.max() < 1e-6
    elif case in ("met", "no path rows"):
        assert not elastic.any()
        assert (len(convex.path_room) == 0) == (case == "no path rows")
    elif case == "path limit kept":
        assert 1e-3 < pressed < 0.999
        assert step.slack.max() < 1e-6
    else:
        assert pressed == pytest.approx(1.0, rel=1e-3)
        assert step.slack[1] > 1e-3
        assert step.slack[[0, 2]].max() < 1e-6


def agree(one: Step, two: Step, convex: ConvexSubproblem) -> None:
    """Two steps are the same, multipliers included."""
    assert np.abs(one.z - two.z).max() < 1e-5
    assert objective(convex, one.z) == pytest.approx(objective(convex, two.z), rel=1e-7)
    price = convex.target_price
    assert np.abs((one.target_multiplier - two.target_multiplier) / price).max() < 1e-5
    scale = max(1.0, np.abs(one.angle_multiplier).max())
    assert np.abs(one.angle_multiplier - two.angle_multiplier).max() < 1e-4 * scale
    off = np.abs(one.path_multiplier - two.path_multiplier).max(initial=0.0)
    assert off < 1e-4 * convex.limit_penalty
    assert one.slack == pytest.approx(two.slack, abs=1e-6)
    off = np.abs(one.absolute_multiplier - two.absolute_multiplier).max(initial=0.0)
    assert off < 1e-4 * convex.absolute_weight.max(initial=1.0)
    assert one.usable
    assert two.usable


def test_the_cvxpy_form_agrees(convex: ConvexSubproblem) -> None:
    agree(solve_subproblem(convex), solve_subproblem_cvxpy(convex), convex)


def test_the_cvxpy_form_agrees_after_a_second_order_correction(convex: ConvexSubproblem) -> None:
    shift = 1e-3 * np.array([1.0, -2.0, 0.5, 3.0]) * np.abs(convex.target_error).max()
    shifted = replace(convex, target_error=convex.target_error + shift)
    assert np.array_equal(shifted.target_map, convex.target_map)
    agree(solve_subproblem(shifted), solve_subproblem_cvxpy(shifted), shifted)


def small_subproblem(seed: int, price: float) -> ConvexSubproblem:
    """A random subproblem of 8 variables, 5 nodes and 6 path rows, of order one throughout.

    Its target has a weighted row, an exact one and two ranges; its cost seven absolute values.
    """
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(8, 8))
    edge = np.array([np.inf, 0.0, 0.3, 1.0])
    target = Target(np.arange(4), np.zeros(4), np.array([3.0, 0.0, 0.0, 0.0]), -edge, edge)
    return ConvexSubproblem(
        hessian=root @ root.T + np.eye(8),
        gradient=rng.normal(size=8),
        target_map=rng.normal(size=(4, 8)),
        target_error=rng.normal(size=4),
        target=target,
        absolute_rows=rng.normal(size=(7, 8)),
        absolute_value=rng.normal(size=7),
        absolute_weight=rng.uniform(0.1, 2.0, 7),
        target_price=price * rng.uniform(1.0, 2.0, 4),
        rate_rows=rng.normal(size=(5, 8)),
        rate=rng.uniform(-0.9, 0.9, 5),
        given_rates=(),
        angle_map=np.eye(5),
        angle_rows=rng.normal(size=(5, 8)),
        angle_lower=-rng.uniform(0.1, 1.0, 5),
        angle_upper=rng.uniform(0.1, 1.0, 5),
        final_time_column=6,
        n_nodes=5,
        radius=0.3,
        path_rows=rng.normal(size=(6, 8)),
        path_room=rng.uniform(-0.1, 0.3, 6),
        path_kind=rng.integers(0, 3, 6),
        path_node=rng.integers(0, 5, 6),
        n_limits=3,
        limit_penalty=3.0,
    )


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    price=st.sampled_from([0.1, 1.0, 100.0]),
    solver=st.sampled_from(["CLARABEL", "OSQP"]),
)
def test_both_forms_and_another_solver_agree_on_random_subproblems(
    seed: int, price: float, solver: str
) -> None:
    convex = small_subproblem(seed, price)
    direct, other = solve_subproblem(convex), solve_subproblem_cvxpy(convex, solver=solver)
    assert violation(convex, direct.z) < 1e-6
    assert direct.usable
    assert other.usable
    best = objective(convex, direct.z)
    rough = 1e-6 if solver == "CLARABEL" else 2e-2  # OSQP is a first-order method
    assert objective(convex, other.z) == pytest.approx(best, rel=rough, abs=rough)
    if solver == "CLARABEL":
        assert np.abs(direct.z - other.z).max() < 1e-4
        kappa = direct.absolute_multiplier - other.absolute_multiplier
        assert np.abs(kappa).max() < 1e-2
        assert np.all(np.abs(direct.absolute_multiplier) <= convex.absolute_weight * (1.0 + 1e-6))


def test_a_solver_that_gives_up_is_a_status(
    convex: ConvexSubproblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gives_up(*_: object, **__: object) -> None:
        raise cp.error.SolverError("failed")

    monkeypatch.setattr(cp.Problem, "solve", gives_up)
    step = solve_subproblem_cvxpy(convex)
    assert step.status is ConeStatus.NUMERICAL_ERROR
    assert not step.usable


def test_an_unknown_solver_is_named(convex: ConvexSubproblem) -> None:
    with pytest.raises(ValueError, match=r"solver: expected one of .*CLARABEL.*, got 'CPLEXX'"):
        solve_subproblem_cvxpy(convex, solver="CPLEXX")


def test_a_further_constraint_is_kept_and_costs(convex: ConvexSubproblem) -> None:
    free = solve_subproblem_cvxpy(convex)
    bound = 0.5 * abs(free.z[-1])
    step = solve_subproblem_cvxpy(convex, extra_constraints=lambda z: [cp.abs(z[-1]) <= bound])
    assert step.usable
    assert abs(step.z[-1]) < bound + 1e-6
    assert objective(convex, step.z) > objective(convex, free.z)


def test_a_contradiction_is_a_status(convex: ConvexSubproblem) -> None:
    step = solve_subproblem_cvxpy(convex, extra_constraints=lambda z: [z[0] >= 1.0, z[0] <= -1.0])
    assert not step.usable
    assert step.status is ConeStatus.PRIMAL_INFEASIBLE
    assert np.all(np.isnan(step.z))
    assert step.path_multiplier.shape == convex.path_room.shape


@pytest.mark.parametrize(
    ("status", "z", "usable"),
    [
        ("Solved", 0.0, True),
        ("AlmostSolved", 0.0, True),
        ("InsufficientProgress", 0.0, True),
        ("InsufficientProgress", np.nan, False),
        ("MaxIterations", 0.0, False),
        ("PrimalInfeasible", 0.0, False),
    ],
)
def test_which_steps_may_be_tried(status: str, z: float, usable: bool) -> None:
    empty = np.zeros(0)
    step = Step(
        np.array([z]), np.zeros(3), np.zeros(4), np.zeros(1), empty, empty, ConeStatus(status)
    )
    assert step.usable is usable
