"""The quadratic model at a point: gradient, Hessian on the tangent space, rows of the limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.scp.condensed.condensing import CondensedDynamics
from ampi.scp.condensed.cost import smooth_cost
from ampi.scp.condensed.iterate import ONE, Flight, Iterate, Point, RestorationSettings
from ampi.scp.condensed.quadratic_model import (
    CurvatureSettings,
    Multipliers,
    quadratic_subproblem,
    with_merit,
)
from ampi.scp.condensed.subproblem import ConvexSubproblem, solve_subproblem
from ampi.scp.guess import from_trajectory
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]
STEP = 1e-4
EVERYTHING = np.ones(4, dtype=bool)


@pytest.fixture(scope="module")
def condensed(flight: Flight, optimum: Point) -> CondensedDynamics:
    return flight.linearise(optimum.iterate)


@pytest.fixture(scope="module")
def multipliers(flight: Flight, optimum: Point) -> Multipliers:
    """At the optimum, where no limit is active, λ = 2 w e."""
    zero = Multipliers.first(flight.problem, optimum)
    return replace(zero, target=2.0 * flight.problem.target.weight * optimum.target_error)


@pytest.fixture(scope="module")
def convex(
    flight: Flight, optimum: Point, condensed: CondensedDynamics, multipliers: Multipliers
) -> ConvexSubproblem:
    return quadratic_subproblem(
        flight,
        optimum,
        condensed,
        multipliers,
        met=EVERYTHING,
        settings=CurvatureSettings(screening=0.5),
    )


def moved(flight: Flight, point: Point, condensed: CondensedDynamics, z: Array) -> Point:
    """The flight restored at the controls of z."""
    here = point.iterate
    states = here.states + condensed.change(z[None], ONE)[:, 0].T
    restored = flight.restore(
        Iterate(states, here.controls + z[:-2], here.final_time + 100.0 * z[-2]), None
    )
    assert restored is not None
    return restored


def random_directions(n_z: int) -> list[Array]:
    rng = np.random.default_rng(3)
    return [*np.eye(n_z)[[0, n_z // 2, n_z - 2, n_z - 1]], *0.1 * rng.normal(size=(3, n_z))]


def test_gradient_is_the_slope_of_the_effort(
    flight: Flight, optimum: Point, condensed: CondensedDynamics, convex: ConvexSubproblem
) -> None:
    for d in random_directions(len(convex.gradient)):
        ahead = moved(flight, optimum, condensed, STEP * d).cost
        behind = moved(flight, optimum, condensed, -STEP * d).cost
        slope = (ahead - behind) / (2.0 * STEP)
        assert slope == pytest.approx(convex.gradient @ d, rel=1e-6, abs=1e-6)


def test_the_optimum_is_stationary(convex: ConvexSubproblem, multipliers: Multipliers) -> None:
    # No limit of bank, rate or path is active there: effort and target alone must balance, with
    # the multiplier 2 w e of the quadratic terminal cost.
    known = np.linalg.lstsq(convex.target_map.T, -convex.gradient, rcond=None)[0]
    unbalanced = convex.gradient + convex.target_map.T @ known
    assert np.abs(unbalanced).max() < 1e-5 * np.abs(convex.gradient).max()
    assert known == pytest.approx(multipliers.target, rel=1e-2)


def test_hessian_on_the_tangent_space_is_that_of_the_lagrangian(
    flight: Flight,
    optimum: Point,
    condensed: CondensedDynamics,
    convex: ConvexSubproblem,
    multipliers: Multipliers,
) -> None:
    # Differences of the effort's and the target's gradient along restored flights.
    tangent = np.linalg.qr(convex.target_map.T, mode="complete")[0][:, 4:]
    assert np.abs(convex.target_map @ tangent).max() < 1e-12 * np.abs(convex.target_map).max()

    def gradient(at: Point) -> Array:
        there = flight.linearise(at.iterate)
        model = quadratic_subproblem(
            flight, at, there, multipliers, met=None, settings=CurvatureSettings()
        )
        return model.gradient + model.target_map.T @ multipliers.target

    for k in (0, 5, 17, 30):
        d = tangent[:, k]
        change = gradient(moved(flight, optimum, condensed, STEP * d))
        change -= gradient(moved(flight, optimum, condensed, -STEP * d))
        differenced = tangent.T @ change / (2.0 * STEP)
        product = tangent.T @ convex.hessian @ d
        assert np.abs(differenced - product).max() < 1e-6 * np.abs(product).max()


def test_hessians_are_positive_definite(
    flight: Flight, constant_bank_point: Point, convex: ConvexSubproblem
) -> None:
    there = flight.linearise(constant_bank_point.iterate)
    rng = np.random.default_rng(0)
    wild = replace(
        Multipliers.first(flight.problem, constant_bank_point), target=1e4 * rng.normal(size=4)
    )
    for met in (None, EVERYTHING, np.array([True, False, True, False])):
        other = quadratic_subproblem(
            flight,
            constant_bank_point,
            there,
            wild,
            met=met,
            settings=CurvatureSettings(),
        )
        assert np.linalg.eigvalsh(other.hessian)[0] > 0.0
    assert np.linalg.eigvalsh(convex.hessian)[0] > 0.0


def test_gauss_newton_is_the_effort_alone(flight: Flight, constant_bank_point: Point) -> None:
    point = constant_bank_point
    model = quadratic_subproblem(
        flight,
        point,
        flight.linearise(point.iterate),
        Multipliers.first(flight.problem, point),
        met=None,
        settings=CurvatureSettings(free_variables=10.0),
    )
    z = np.zeros(len(model.gradient))
    z[:-2] = np.random.default_rng(1).uniform(-0.2, 0.2, len(z) - 2)
    t, here = flight.transcription, point.iterate
    changed = replace(here, controls=here.controls + z[:-2])
    _, u, final_time = changed.batch
    effort = smooth_cost(flight.problem, t, u, final_time, np.zeros((0, 1, len(t.weights) + 1)))[0]
    assert point.cost + model.gradient @ z + 0.5 * z @ model.hessian @ z == pytest.approx(effort)
    diagonal = np.diag(model.hessian)
    assert diagonal[-2:] == pytest.approx(10.0 * diagonal[:-2].mean())


def test_rows_of_the_path_limits(
    flight: Flight, optimum: Point, condensed: CondensedDynamics, convex: ConvexSubproblem
) -> None:
    node, kind = convex.path_node, convex.path_kind
    above = np.nonzero(optimum.path > 0.5)
    assert len(node) > 5
    assert np.array_equal(np.stack([node, kind]), np.stack(above))
    assert convex.path_room == pytest.approx(1.0 - optimum.path[node, kind])
    for d in random_directions(len(convex.gradient)):
        ahead = moved(flight, optimum, condensed, STEP * d).path[node, kind]
        behind = moved(flight, optimum, condensed, -STEP * d).path[node, kind]
        slope = (ahead - behind) / (2.0 * STEP)
        linear = convex.path_rows @ d
        assert slope == pytest.approx(linear, abs=1e-6 * max(1.0, np.abs(linear).max()))


def test_rows_of_the_path_limits_move_with_the_final_time(
    drifting: tuple[Flight, Point],
) -> None:
    # Where the angle of attack still changes in the free phase, so does g at a moving node.
    flight, point = drifting
    condensed = flight.linearise(point.iterate)
    convex = quadratic_subproblem(
        flight,
        point,
        condensed,
        Multipliers.first(flight.problem, point),
        met=None,
        settings=CurvatureSettings(screening=0.01),
    )
    node, kind = convex.path_node, convex.path_kind
    path_jacobian = np.stack([condensed.derivatives.gradient_of(k)[0] for k in range(3)])
    by_time = path_jacobian[kind, node, 7]
    assert np.abs(by_time * flight.transcription.node_free[node]).max() > 1e-6
    d = np.zeros(len(convex.gradient))
    d[convex.final_time_column] = 1.0
    ahead = moved(flight, point, condensed, STEP * d).path[node, kind]
    behind = moved(flight, point, condensed, -STEP * d).path[node, kind]
    linear = convex.path_rows @ d
    assert np.abs((ahead - behind) / (2.0 * STEP) - linear).max() < 1e-6 * np.abs(linear).max()


def test_rows_of_the_bank_and_its_rate(
    flight: Flight, optimum: Point, condensed: CondensedDynamics, convex: ConvexSubproblem
) -> None:
    d = 0.03 * random_directions(len(convex.gradient))[-1]
    there = moved(flight, optimum, condensed, d)
    t = flight.transcription
    rate = t.nodal_rate(there.iterate.controls[None])[0]
    assert convex.rate + convex.rate_rows @ d == pytest.approx(rate, abs=1e-11)
    limit = flight.problem.angles[0].upper
    bank = optimum.iterate.states[:, 6]
    places = convex.angle_map @ bank
    assert np.array_equal(convex.angle_map[: len(rate)], np.eye(len(rate)))
    between = t.between @ bank
    near = np.abs(between) > 0.85 * limit
    assert places[len(rate) :] == pytest.approx(between[near])
    assert places + convex.angle_upper == pytest.approx(np.full(len(places), limit))
    assert places + convex.angle_lower == pytest.approx(np.full(len(places), -limit))


def test_merit_tightens_the_bank_box(convex: ConvexSubproblem) -> None:
    price = np.array([1.0, 2.0, 3.0, 4.0])
    bounded = with_merit(convex, radius=0.05, price=price, penalty=7.0)
    assert bounded.angle_upper == pytest.approx(np.minimum(convex.angle_upper, 0.05))
    assert bounded.angle_lower == pytest.approx(np.maximum(convex.angle_lower, -0.05))
    assert (bounded.radius, bounded.limit_penalty) == (0.05, 7.0)
    assert np.array_equal(bounded.target_price, price)
    assert bounded.hessian is convex.hessian


def test_multipliers_are_spread_over_the_nodes(convex: ConvexSubproblem) -> None:
    bounded = with_merit(convex, radius=1.0, price=np.full(4, 1e4), penalty=1e3)
    step = solve_subproblem(bounded)
    step = replace(step, path_multiplier=np.arange(1.0, len(convex.path_room) + 1.0))
    spread = Multipliers.of(step, bounded)
    assert spread.limits.shape == (len(convex.rate), 3)
    assert spread.limits.sum() == pytest.approx(step.path_multiplier.sum())
    assert spread.limits[convex.path_node[3], convex.path_kind[3]] == 4.0
    assert np.array_equal(spread.target, step.target_multiplier)
    n = len(convex.rate)
    on_bank, halfway = np.zeros(n + 1), np.zeros(n)
    on_bank[[3, n]] = 2.0, -3.0  # at a node, and between nodes
    halfway[:2] = 0.4, 0.6
    wider = replace(bounded, angle_map=np.vstack([np.eye(n), halfway]))
    bank = Multipliers.of(replace(step, angle_multiplier=on_bank), wider).angles[0]
    assert bank[:4] == pytest.approx([-1.2, -1.8, 0.0, 2.0])
    assert bank.sum() == pytest.approx(-1.0)  # what lies between is shared out, nothing is lost


def test_no_step_is_left_at_the_optimum(
    convex: ConvexSubproblem, nominal: Trajectory, mission: Mission
) -> None:
    # Newton's step from the optimum: what convergence left, and nothing more.
    step = solve_subproblem(with_merit(convex, radius=1.0, price=np.full(4, 1e6), penalty=1e3))
    assert step.usable
    assert np.abs(convex.angle_rows @ step.z).max() < 1e-6
    assert np.abs(convex.angle_rows @ step.z).max() < 1e-3 * nominal.statistics.log[0].step
    assert mission.limits.bank_angle > np.abs(nominal.states[6]).max()


def test_every_node_near_a_limit_is_a_row(
    flight: Flight, optimum: Point, condensed: CondensedDynamics, multipliers: Multipliers
) -> None:
    convex = quadratic_subproblem(
        flight, optimum, condensed, multipliers, met=EVERYTHING, settings=CurvatureSettings()
    )
    near = optimum.path > 0.6
    assert np.any(near & (optimum.path < 0.95))  # none of them acts yet: a step may lead there
    rows = np.zeros_like(near)
    rows[convex.path_node, convex.path_kind] = True
    assert np.array_equal(rows, near)


def test_multipliers_of_the_bank_bend_the_lagrangian(
    flight: Flight, optimum: Point, condensed: CondensedDynamics, multipliers: Multipliers
) -> None:
    """The bank angle is bilinear in its rate and the final time."""
    pressed = replace(multipliers, angles=np.linspace(-1.0, 2.0, len(optimum.path))[None])
    free, held = (
        quadratic_subproblem(
            flight,
            optimum,
            condensed,
            one,
            met=EVERYTHING,
            settings=CurvatureSettings(floor=1e-12),
        ).hessian
        for one in (multipliers, pressed)
    )
    change = np.abs(held - free)
    assert change[:-2, -2].max() > 1e-6 * np.abs(free).max()


def test_an_absolute_value_at_its_kink_holds_the_step(
    mission: Mission, nominal: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its multiplier is below its weight there; beside the kink it is the weight itself."""
    objective = mission.objective.model_copy(update={"bank_rate_variation": 1.0})
    varied = mission.model_copy(update={"objective": objective})
    problem = OptimalControlProblem.of(varied)
    flying = Flight.of(problem, RestorationSettings())
    point = flying.first_point(from_trajectory(nominal, varied))
    assert point is not None
    found = []

    def recorded(hessian: Array, held: Array, floor: float) -> Array:
        found.append(held)
        return hessian

    monkeypatch.setattr("ampi.scp.condensed.quadratic_model.convexify_on_tangent", recorded)
    at_kink = Multipliers.first(problem, point)
    share = np.where(np.arange(len(at_kink.absolute)) < 5, 0.3, 1.0)
    at_kink = replace(at_kink, absolute=share * at_kink.absolute)
    convex = quadratic_subproblem(
        flying,
        point,
        flying.linearise(point.iterate),
        at_kink,
        met=EVERYTHING,
        settings=CurvatureSettings(),
    )
    assert np.array_equal(found[0], np.concatenate([convex.target_map, convex.absolute_rows[:5]]))
