"""The algebra of Newton's iteration: against the batch of one, restored flights, dense systems."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.propagation.reintegration import reintegrate
from ampi.scp.condensed.iterate import ONE, Flight, Iterate, Point
from ampi.scp.condensed.limit_rows import LimitRows, following
from ampi.scp.condensed.newton import NewtonIteration
from ampi.scp.condensed.newton_system import KktFactors, NewtonSystem
from ampi.scp.condensed.points import Points
from ampi.scp.condensed.quadratic_model import Multipliers, lagrangian_hessian
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.guess import NodalGuess, from_trajectory
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]


def limited(mission: Mission, **limits: float) -> Mission:
    """The mission under other limits (SI)."""
    return mission.model_copy(update={"limits": mission.limits.model_copy(update=limits)})


Batch = SimpleNamespace  # flight, points (of two cases), guesses, begin: a run at them


@pytest.fixture(params=["shefex3", "drifting"])
def pair(
    request: pytest.FixtureRequest,
    flight: Flight,
    optimum: Point,
) -> Batch:
    """Two cases of one problem; `drifting` has physics that depend on time to the end."""
    if request.param == "drifting":
        flight, optimum = request.getfixturevalue("drifting")
    here = optimum.iterate
    moved = flight.restore(replace(here, controls=0.98 * here.controls + 1e-3), None)
    assert moved is not None
    ends = [optimum, moved]
    problem, scale = flight.problem, np.array(flight.problem.scaling.states)
    guesses = [
        NodalGuess(
            end.iterate.states * scale,
            flight.transcription.nodal_rate(end.iterate.controls[None])[0]
            * problem.angles[0].rate_limit,
            end.iterate.final_time,
            np.array([1e-6, 3.0, -2.0, 1e-5]) * (1.0 + k) / problem.multiplier_scale,
        )
        for k, end in enumerate(ends)
    ]

    def begin(one_by_one: bool = False) -> NewtonIteration:
        points = Points.of(problem, guesses, one_by_one=one_by_one)
        return NewtonIteration.begin(points, guesses, SolverSettings())

    return Batch(flight=flight, ends=ends, begin=begin)


BOTH = np.arange(2)


def close(found: Array, expected: Array, digits: float = 1e-9) -> None:
    assert found == pytest.approx(expected, rel=digits, abs=digits * np.abs(expected).max())


def test_a_batch_of_two_is_two_batches_of_one(pair: Batch) -> None:
    """State maps, corrections and multipliers; of the whole batch and of a part of it."""
    points = pair.begin().points
    condensed = points.condensed()
    rng, n = np.random.default_rng(5), points.x.shape[2]
    z = rng.normal(size=(2, condensed.n_variables))
    residual, gradient = rng.normal(size=(2, 2, n - 1, 7))
    for case, end in enumerate(pair.ends):
        single, own = pair.flight.linearise(end.iterate), np.array([case])
        part = slice(case, case + 1)
        for whole, cut, expected in (
            (
                condensed.change(z, BOTH),
                condensed.change(z[part], own),
                single.change(z[part], ONE),
            ),
            (
                condensed.multipliers(gradient, BOTH),
                condensed.multipliers(gradient[part], own),
                single.multipliers(gradient[part], ONE),
            ),
        ):
            close(whole[:, case], expected[:, 0])
            assert np.array_equal(cut[:, 0], whole[:, case])
        for whole, cut, expected in (
            (
                condensed.correction(residual, BOTH),
                condensed.correction(residual[part], own),
                single.correction(residual[part], ONE),
            ),
            (
                condensed.projected(gradient, BOTH),
                condensed.projected(gradient[part], own),
                single.projected(gradient[part], ONE),
            ),
        ):
            close(whole[case], expected[0])
            assert np.array_equal(cut[0], whole[case])
        close(condensed.final_map[case], single.final_map[0])


def random_limits(pair: Batch, run: NewtonIteration) -> None:
    """Multipliers on rows of every kind; of |û| too, where they have no curvature."""
    rng = np.random.default_rng(7)
    run.multipliers.target = rng.normal(size=run.multipliers.target.shape)
    run.multipliers.limits = 0.1 * rng.normal(size=run.multipliers.limits.shape)


def test_the_hessian_is_that_of_the_quadratic_model(pair: Batch) -> None:
    """Of the batch of one, which restored flights have told (test_condensing)."""
    flight, run = pair.flight, pair.begin()
    random_limits(pair, run)
    system = NewtonSystem.of(run.points, run.multipliers)
    t, n = flight.transcription, flight.transcription.mesh.n_nodes
    for case, end in enumerate(pair.ends):
        limits = run.multipliers.limits[case]
        on_bank = limits[n : 2 * n] + limits[2 * n : 2 * n + len(t.between)] @ t.between
        on_path = limits[-3 * n :].reshape(3, n).T
        multipliers = Multipliers(run.multipliers.target[case], on_path, on_bank[None], np.zeros(0))
        condensed = flight.linearise(end.iterate)
        single = lagrangian_hessian(flight, end, condensed, multipliers)
        close(system.hessian[case], single, 1e-8)


def test_the_shift_of_the_states_enters_as_a_step_does(pair: Batch) -> None:
    # δσ₀ moves states and nothing else: shifting them by Z δσ₀ and stepping δσ₀ are the same to L.
    run = pair.begin()
    random_limits(pair, run)
    system = NewtonSystem.of(run.points, run.multipliers)
    condensed, curvature = system.condensed, system.curvature
    z = np.zeros((2, condensed.n_variables))
    z[:, -1] = 1.0
    shift = condensed.change(z, BOTH)[:, :, 1:].transpose(1, 2, 0)

    def product(shift: Array, cases: NDArray[np.intp]) -> Array:
        over_states, over_time = curvature.product(shift, cases)
        found = condensed.projected(over_states, cases)
        found[:, -2] += over_time
        return found

    found = product(shift, BOTH)
    for case in range(2):
        close(found[case], curvature.reduced()[case] @ z[case], 1e-8)
        close(product(0.5 * shift[[case]], np.array([case]))[0], 0.5 * found[case])


def flown(pair: Batch, case: int, condensed: object, z: Array) -> Point:
    """One case restored at the controls of z."""
    here = pair.ends[case].iterate
    single = pair.flight.linearise(here)
    states = here.states + single.change(z[None], ONE)[:, 0].T
    there = Iterate(states, here.controls + z[:-2], here.final_time + 100.0 * z[-2])
    restored = pair.flight.restore(there, None)
    assert restored is not None
    return restored


def test_rows_of_the_limits_are_slopes_along_restored_flights(pair: Batch) -> None:
    """As a matrix, as what a change of the states adds, and transposed."""
    run = pair.begin()
    system = NewtonSystem.of(run.points, run.multipliers)
    rows, problem = system.rows, pair.flight.problem
    rng, step = np.random.default_rng(3), 1e-4
    count = rows.lower.shape[1]
    for case in range(2):
        matrix = rows.matrix(case, np.arange(count))
        for d in (*np.eye(matrix.shape[1])[[0, -2, -1]], 0.1 * rng.normal(size=matrix.shape[1])):
            values = []
            for size in (step, -step):
                at = flown(pair, case, system.condensed, size * d)
                x, u, _ = at.iterate.batch
                rate = pair.flight.transcription.nodal_rate(u)
                values.append(rows.value(problem.target, x, rate, at.path.T[:, None])[0])
            slope = (values[0] - values[1]) / (2.0 * step)
            assert np.abs(slope - matrix @ d).max() < 1e-5 * max(1.0, np.abs(slope).max())
            own = np.array([case])
            change, rate = (
                system.condensed.change(d[None], own),
                pair.flight.transcription.nodal_rate(d[None, :-2]),
            )
            close(rows.moved(change, rate, d[[-2]], own)[0], matrix @ d)
        multipliers = rng.normal(size=(1, count))
        over_states, over_time = rows.node_gradient(
            multipliers, rows.path_gradient[:, case : case + 1]
        )
        found = system.condensed.projected(over_states, np.array([case]))
        found[0, -2] += 100.0 * over_time[0] @ pair.flight.transcription.node_free
        found += rows.on_control(multipliers, rows.path_gradient[:, case : case + 1])
        close(found[0], multipliers[0] @ matrix)


def test_with_the_matrices_of_the_point_the_simplified_step_is_newtons(pair: Batch) -> None:
    """The two write the gradient of the Lagrangian differently: by the constraints' rows, and by μ."""
    runs = [pair.begin(), pair.begin()]
    for run in runs:
        run.points.final_time = run.points.final_time + 2.0
        noise = np.random.default_rng(9).normal(scale=1e-3, size=run.points.u.shape)
        run.points.u = run.points.u + noise
    assert_the_steps_are_the_same(*runs, bounds=np.inf)


def assert_the_steps_are_the_same(
    run: NewtonIteration, other: NewtonIteration, bounds: float | None = None
) -> None:
    """Newton's step of one, and the simplified one of its twin that holds the same rows."""
    system = NewtonSystem.of(run.points, run.multipliers)
    if bounds is not None:
        all_ = np.full_like(system.rows.lower, bounds)
        system = replace(system, rows=replace(system.rows, lower=-all_, upper=all_))
    shift = run.shift(system)
    size = run.newton_step(shift, run.solution(system, shift))
    assert np.all(size > 1e-3)
    system = NewtonSystem.of(other.points, other.multipliers)
    other.multipliers.side = run.multipliers.side.copy()
    system.factors[:] = [system._factored(k, side) for k, side in enumerate(run.multipliers.side)]
    changed = np.zeros((len(size), run.points.u.shape[1], 7))
    simplified = other.simplified_step(system, changed, np.arange(len(size)))
    assert simplified == pytest.approx(size, rel=1e-6)
    assert other.points.x == pytest.approx(run.points.x, abs=1e-6 * size[0])
    assert other.multipliers.target == pytest.approx(run.multipliers.target, rel=1e-6)
    close(other.multipliers.limits, run.multipliers.limits, 1e-6)
    assert other.points.final_time == pytest.approx(run.points.final_time, rel=1e-9)


@pytest.mark.parametrize("where", ["entry", "later"])
def test_the_simplified_step_is_newtons_where_limits_are_held(
    mission: Mission, centre: Trajectory, where: str
) -> None:
    """Bank angle at the entry or later, bank rate, heat flux."""
    bank = np.abs(centre.states[6])
    highest = bank[0] if where == "entry" else bank.max()
    heat = float(reintegrate(mission, centre).fine_path[0, 1].max()) * mission.limits.heat_flux
    tight = limited(mission, bank_angle=highest - 1e-3, heat_flux=heat * (1.0 - 1e-5))
    if where == "entry":
        tight = mission.model_copy(
            update={"limits": tight.limits.model_copy(update={"heat_flux": 2.0 * heat})}
        )
    problem, guess = OptimalControlProblem.of(tight), from_trajectory(centre, tight)
    runs = []
    for _ in range(2):
        points = Points.of(problem, [guess] * 2, one_by_one=False)
        points.final_time = points.final_time + np.array([0.5, -0.5])
        runs.append(NewtonIteration.begin(points, [guess] * 2, SolverSettings()))
    assert_the_steps_are_the_same(*runs)
    n, side = problem.mesh.n_nodes, runs[0].multipliers.side
    assert side.any()
    assert side[:, n].any() == (where == "entry")


def test_the_factors_solve_the_dense_system() -> None:
    """Eq. (1) as one matrix; of an indefinite H that is positive definite under the rows, too."""
    rng, n_z, r = np.random.default_rng(1), 12, 4
    basis = rng.normal(size=(n_z, n_z))
    rows, gradient, error = rng.normal(size=(r, n_z)), rng.normal(size=n_z), rng.normal(size=r)
    compliance = np.array([0.0, 0.3, 1e-4, 0.0])
    for hessian in (basis @ basis.T, basis @ basis.T - 30.0 * np.outer(rows[0], rows[0])):
        factors = KktFactors.of(hessian, rows, compliance)
        assert factors is not None
        z, multipliers = factors.solution(gradient, error)
        dense = np.block([[hessian, rows.T], [rows, -np.diag(compliance)]])
        exact = np.linalg.solve(dense, -np.concatenate([gradient, error]))
        close(np.concatenate([z, multipliers]), exact, 1e-8)
    null = np.linalg.qr(rows.T, mode="complete")[0][:, -1]
    assert KktFactors.of(basis @ basis.T - 1e3 * np.outer(null, null), rows, compliance) is None


def test_which_rows_hold_the_next_step() -> None:
    side = np.array([[0, 0, 0, 1, 1, -1, -1, 0]], dtype=np.int8)
    multipliers = np.array([[0.0, 0.0, 0.0, 2.0, -2.0, -2.0, 2.0, 0.0]])
    value = np.array([[0.0, 1.1, -1.1, 1.0, 1.0, -1.0, -1.0, 1.0 + 1e-12]])
    bound = np.ones((1, 8))
    now = following(side, multipliers, value, -bound, bound)
    assert now.tolist() == [[0, 1, -1, 1, 0, -1, 0, 0]]


@pytest.mark.parametrize("beyond", ["bank", "rate", "path", "between", "target"])
def test_a_case_beyond_a_limit_is_not_taken(pair: Batch, beyond: str) -> None:
    run = pair.begin()
    rows = NewtonSystem.of(run.points, run.multipliers).rows
    points, problem = run.points, run.points.problem
    points.functions[:] = 0.5
    points.x[6] = 0.1
    points.u[:] = 0.0
    assert run.keeps_limits(rows).all()
    if beyond == "bank":
        points.x[6, 1, 20] = 1.001 * problem.angles[0].upper
    elif beyond == "between":
        points.x[6, 1] = 0.999999 * problem.angles[0].upper * np.sign(np.sin(np.arange(64.0)))
    elif beyond == "rate":
        points.u[1, 20] = -1.001
    elif beyond == "path":
        points.functions[0, 1, 20] = 1.001
    else:
        target = problem.target
        ranged = replace(
            target, weight=0.0 * target.weight, lower=-np.ones(4), upper=np.array([1.0, 9, 9, 9])
        )
        points.x[:4, :, -1] = ranged.reference[:, None]
        points.problem = replace(problem, target=ranged)
        rows = LimitRows.of(points.problem, rows.condensed)
        assert run.keeps_limits(rows).all()
        points.x[0, 1, -1] += 1.001
    assert run.keeps_limits(rows).tolist() == [True, False]


def test_a_case_that_does_not_contract_is_given_up(
    pair: Batch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps of one size: the first may be any, the second is to be half of it at the most."""
    steps = []

    def same(self: NewtonIteration, *arguments: object) -> Array:
        steps.append(1)
        return np.full(2, 0.2)

    monkeypatch.setattr(NewtonIteration, "newton_step", same)
    monkeypatch.setattr(NewtonIteration, "simplified_step", lambda *arguments: np.full(2, 0.2))
    assert list(pair.begin().run()) == []
    assert len(steps) == 2
