"""The condensed method with the angle of attack as a second control: derivatives, agreement, bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.missions.loading import parse_mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.state import ANGLE_OF_ATTACK, BANK
from ampi.propagation.reintegration import flown_again
from ampi.scp.condensed.cost import add_rate_curvature, terminal_cost
from ampi.scp.condensed.iterate import ONE, Flight, Iterate, Point, RestorationSettings
from ampi.scp.condensed.newton import NewtonIteration
from ampi.scp.condensed.newton_system import NewtonSystem
from ampi.scp.condensed.points import Points
from ampi.scp.condensed.quadratic_model import Multipliers, lagrangian_hessian
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.condensed.subproblem_cvxpy import solve_subproblem_cvxpy
from ampi.scp.guess import ConstantBank, constant_bank_guess, from_trajectory
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.solve import optimum as optimum_of
from ampi.scp.solve import solve_family
from ampi.trajectory import Status, Trajectory
from tests.support.steered import steered_mission

Array = NDArray[np.float64]
STEP = 1e-4
COLUMN = -3  # of δt_f; those of δσ₀ and δα₀ follow
BOUNDS = """[angle_of_attack]
lower_deg = {lower}
upper_deg = {upper}
{over}rate_deg_per_s = 5.0
acceleration_deg_per_s2 = 4.0

"""
OVER_MACH = 'over = "mach"\nat = [2.0, 6.0, 14.0]\n'
INNER = BOUNDS.format(lower=0.0, upper=70.0, over="")
BINDING = {  # greatest lift over drag is below them
    "fixed": BOUNDS.format(lower=24.0, upper=42.0, over=""),
    "over mach": BOUNDS.format(lower=[24.0, 26.0, 32.0], upper=[40.0, 44.0, 60.0], over=OVER_MACH),
}


def with_objective(
    mission: Mission, terms: str, target: str, degrees: str = "[10, 10, 10, 10, 10, 10]"
) -> Mission:
    """The mission with another objective, on a mesh of one phase."""
    text = mission.toml
    head, _, tail = text.partition("[objective]\n")
    tail = tail[tail.index("\n[") + 1 :]
    tail = tail[: tail.index("[[mesh.phase]]")] + f"[[mesh.phase]]\ndegrees = {degrees}\n\n"
    grid = text[text.index("[grid]") :] if "[grid]" in text else ""
    head = head.replace("[target]\n", f"[target]\n{target}")
    return parse_mission(f"{head}[objective]\n{terms}\n{tail}{grid}")


@pytest.fixture(scope="module")
def mission() -> Mission:
    """Everything that a second control brings, with costs of the final state."""
    terms = "bank_rate_effort = 0.01\nangle_of_attack_effort = 0.02\nheat_load = 0.1\n"
    terms += "cross_range = 0.002\nfinal_speed = 0.003"
    free = 'free = ["latitude"]\nspeed_range_m_per_s = [560.0, 640.0]\n'
    return with_objective(steered_mission(INNER), terms, free)


@pytest.fixture(scope="module")
def flight(mission: Mission) -> Flight:
    """Its flight, restored far enough for finite differences."""
    problem = OptimalControlProblem.of(mission)
    return Flight.of(problem, RestorationSettings(tolerance=1e-12, corrections=20))


@pytest.fixture(scope="module")
def point(flight: Flight, mission: Mission) -> Point:
    """A flight at constant angles, its rates shaken."""
    guess = constant_bank_guess(mission, ConstantBank(0.5))
    assert guess is not None
    rng = np.random.default_rng(1)
    shaken = 2e-3 * rng.normal(size=(2, len(guess.bank_rate)))
    guess = replace(guess, bank_rate=shaken[0], angle_of_attack_rate=shaken[1])
    found = flight.first_point(guess)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def solved(mission: Mission) -> Trajectory:
    """Its optimum."""
    found = optimum_of(mission)
    assert found.status is Status.SOLVED
    return found


def flown(flight: Flight, point: Point, z: Array) -> Point:
    """The flight restored at the controls that z leads to."""
    here, condensed = point.iterate, flight.linearise(point.iterate)
    states = here.states + condensed.change(z[None], ONE)[:, 0].T
    moved = Iterate(states, here.controls + z[:COLUMN], here.final_time + 100.0 * z[COLUMN])
    restored = flight.restore(moved, None)
    assert restored is not None
    return restored


def directions(n_z: int) -> list[Array]:
    """Final time, both entry angles, single rates of both controls, and mixtures."""
    unit, rng = np.eye(n_z), np.random.default_rng(7)
    single = [unit[k] for k in (0, 1, n_z // 2, n_z // 2 + 1, n_z - 4)]
    return [*unit[COLUMN:], *single, *(0.1 * rng.normal(size=n_z) for _ in range(2))]


def multipliers_of(flight: Flight) -> Multipliers:
    """Multipliers of every kind."""
    rng, n = np.random.default_rng(3), flight.problem.mesh.n_nodes
    limits = rng.normal(size=(n, flight.problem.n_limits))
    limits[0] = 0.0  # at the first node they enter by their gradients alone
    return Multipliers(
        rng.normal(size=len(flight.problem.target)), limits, rng.normal(size=(2, n)), np.zeros(0)
    )


def test_the_map_of_both_controls_is_the_slope_of_restored_flights(
    flight: Flight, point: Point
) -> None:
    condensed = flight.linearise(point.iterate)
    for d in directions(condensed.n_variables):
        ahead, behind = flown(flight, point, STEP * d), flown(flight, point, -STEP * d)
        slope = (ahead.iterate.states - behind.iterate.states) / (2.0 * STEP)
        linear = condensed.change(d[None], ONE)[:, 0].T
        assert np.abs(slope - linear).max() < 1e-6 * max(1.0, np.abs(linear).max())


def test_the_hessian_is_the_curvature_of_the_lagrangian(flight: Flight, point: Point) -> None:
    """Second differences of cost, target and limits along restored flights, which know no adjoint."""
    multipliers, condensed = multipliers_of(flight), flight.linearise(point.iterate)
    hessian = lagrangian_hessian(flight, point, condensed, multipliers)

    def lagrangian(z: Array) -> float:
        at = flown(flight, point, z)
        return float(
            at.cost
            + multipliers.target @ at.target_error
            + np.sum(multipliers.limits * at.path)
            + np.sum(multipliers.angles * at.iterate.states[:, BANK:].T)
        )

    middle, step = lagrangian(np.zeros(len(hessian))), 1e-3
    size = np.abs(hessian).max()
    for d in directions(len(hessian)):
        second = (lagrangian(step * d) - 2.0 * middle + lagrangian(-step * d)) / step**2
        assert second == pytest.approx(d @ hessian @ d, abs=2e-5 * size, rel=2e-4)


def test_the_cost_of_the_final_state_and_its_derivatives(flight: Flight, point: Point) -> None:
    final = point.iterate.states[-1]
    found = terminal_cost(flight.problem, final[:, None], one_by_one=True)
    assert found is not None
    for k, unit in enumerate(np.eye(8)):
        moved = [
            terminal_cost(flight.problem, (final + s * 1e-5 * unit)[:, None], one_by_one=True)
            for s in (1.0, -1.0)
        ]
        up, down = (m for m in moved if m is not None)
        slope = (up.value - down.value)[0] / 2e-5
        assert slope == pytest.approx(found.gradient[0, k], rel=1e-6, abs=1e-8)
        rows = (up.gradient - down.gradient)[0] / 2e-5
        assert rows == pytest.approx(found.hessian[0, k], rel=1e-5, abs=1e-6)


def test_an_optimum_is_flown_and_costs_no_less_nearby(
    mission: Mission, flight: Flight, solved: Trajectory
) -> None:
    again = flown_again(mission, solved).statistics.flight
    assert again is not None
    assert again.position_error < 1000.0  # the mesh is a small one
    assert solved.angle_of_attack_rate is not None
    point = flight.first_point(from_trajectory(solved, mission))
    assert point is not None
    condensed = flight.linearise(point.iterate)
    target = condensed.final_map[0, flight.problem.target.state]
    normal = np.linalg.qr(target.T)[0]
    rng = np.random.default_rng(5)
    for _ in range(4):  # along the target's tangent space, both ways: no slope is left
        d = rng.normal(size=condensed.n_variables)
        d -= normal @ (normal.T @ d)
        up, down = (flown(flight, point, s * 1e-4 * d) for s in (1.0, -1.0))
        slope = (up.cost - down.cost) / 2e-4
        assert abs(slope) < 1e-3 * np.linalg.norm(d)


def test_newtons_iteration_of_a_family_agrees_with_the_robust_one(
    mission: Mission, solved: Trajectory
) -> None:
    values = np.array([mission.nominal_parameters] * 3)
    values[1:] += np.array([[0.4], [-0.3]]) * np.array(
        [p.axis[-1] - p.axis[0] for p in mission.parameters]
    )
    together = solve_family(mission.family(values), [solved] * 3)
    alone = solve_family(mission.family(values[1:2]), [solved])
    for row, found in zip(values, together, strict=True):
        assert found is not None
        robust = optimum_of(mission.with_parameters(row))
        assert found.cost == pytest.approx(robust.cost, rel=1e-6)
        assert found.states == pytest.approx(robust.states, rel=1e-3, abs=1e-3)
    assert alone[0] is not None and together[1] is not None
    assert np.array_equal(alone[0].states, together[1].states)  # of its company not a bit


def test_the_simplified_step_is_newtons(mission: Mission, solved: Trajectory) -> None:
    """The two write the gradient of the Lagrangian differently: by the rows, and by μ."""
    problem, guess = OptimalControlProblem.of(mission), from_trajectory(solved, mission)
    runs = []
    for _ in range(2):
        points = Points.of(problem, [guess], one_by_one=True)
        points.final_time = points.final_time + 1.0
        points.x[BANK, 0] += 0.02
        points.x[ANGLE_OF_ATTACK, 0] += 0.01
        runs.append(NewtonIteration.begin(points, [guess], SolverSettings()))
    with np.errstate(all="ignore"):
        for run in runs:
            system = NewtonSystem.of(run.points, run.multipliers)
            shift = run.shift(system)
            step = run.solution(system, shift)
            system, step = run.with_known_multipliers(system, shift, step)
            if run is runs[0]:
                run.newton_step(shift, step)
            else:
                run.simplified_step(system, run.points.nothing_changed(), ONE)
    one, other = (run.points for run in runs)
    assert one.x == pytest.approx(other.x, abs=1e-7)
    assert one.u == pytest.approx(other.u, abs=1e-7)


def test_the_cvxpy_form_reaches_the_same_optimum(mission: Mission, solved: Trajectory) -> None:
    short = solve_family(mission.family(mission.nominal_parameters[None]), [solved])[0]
    assert short is not None
    moved = mission.with_entry(mission.entry_state + np.array([50.0, 0, 0, 5.0, 0, 0]))
    one = optimum_of(moved, guess=short)
    other = optimum_of(moved, guess=short, subproblem=solve_subproblem_cvxpy)
    assert other.status is Status.SOLVED
    assert other.cost == pytest.approx(one.cost, rel=1e-5)


def test_angles_and_rates_that_are_given_at_the_entry_are_kept(
    mission: Mission, solved: Trajectory
) -> None:
    given = {"angle_of_attack": 0.6, "angle_of_attack_rate": -0.01, "bank_angle": 0.3}
    entry = mission.entry.model_copy(update=given)
    found = optimum_of(mission.model_copy(update={"entry": entry}), guess=solved)
    assert found.status is Status.SOLVED
    assert found.angle_of_attack_rate is not None
    assert found.states[ANGLE_OF_ATTACK, 0] == pytest.approx(0.6, abs=1e-12)
    assert found.angle_of_attack_rate[0] == pytest.approx(-0.01, abs=1e-9)
    assert found.states[BANK, 0] == pytest.approx(0.3, abs=1e-12)


@pytest.mark.parametrize("bounds", BINDING)
def test_bounds_are_kept_where_they_hold(mission: Mission, bounds: str) -> None:
    """The longest way left wants angles beyond them."""
    terms = "cross_range = -0.01\nbank_rate_effort = 0.05\nangle_of_attack_effort = 0.05"
    own = with_objective(
        steered_mission(BINDING[bounds]), terms, 'position = "free"\n', "[8, 8, 8, 8]"
    )
    found = optimum_of(own)
    assert found.status is Status.SOLVED
    uses = dict(
        zip(
            PathLimits.of(own).names,
            PathLimits.of(own).use(
                own.flight_model,
                found.states,
                found.bank_rate,
                found.times,
                angle_of_attack_rate=found.angle_of_attack_rate,
            ),
            strict=True,
        )
    )
    angle = [
        uses[name] for name in uses if name.startswith("angle_of_attack") and "rate" not in name
    ]
    assert max(float(np.max(use)) for use in angle) == pytest.approx(1.0, abs=1e-3)


def test_the_effort_of_each_control_is_its_own(flight: Flight, point: Point) -> None:
    t, problem = flight.transcription, flight.problem
    _, u, final_time = point.iterate.batch
    hessian = np.zeros((1, u.shape[1] + 3, u.shape[1] + 3))
    add_rate_curvature(hessian, problem, t, u, final_time)
    half = t.half_lengths(final_time) * t.weights
    diagonal = np.diagonal(hessian[0])[: u.shape[1]].reshape(-1, 2)
    for k, effort in enumerate(problem.objective.effort):
        assert diagonal[:, k] == pytest.approx(2.0 * effort * half[0])
