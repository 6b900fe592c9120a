"""Newton's iteration for many cases: the algebra of the general method, its optima, no company."""

from __future__ import annotations

import copy
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from ampi.scp.condensed.family import _Newton, newton
from ampi.scp.condensed.family_condensing import CondensedFamily
from numpy.typing import NDArray

import ampi
from ampi.missions import Mission, load_mission
from ampi.missions.loading import parse_mission
from ampi.propagation.reintegration import reintegrate
from ampi.scp.condensed.iterate import Flight, Linearised, Point, RestorationSettings
from ampi.scp.condensed.quadratic_model import Multipliers, _lagrangian_hessian
from ampi.scp.guess import NodalGuess, from_trajectory
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.solve import solve, solve_family
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]
PLACES = (
    (20.0, 0.0, 0.0),
    (0.0, 0.1, 0.0),
    (-20.0, -0.1, 0.1),
    (10.0, 0.05, -0.1),
    (35.0, 0.0, 0.1),
)  # m/s, degrees of flight-path angle and azimuth away from the nominal entry


@pytest.fixture(scope="module")
def centre(mission: Mission) -> Trajectory:
    """The optimum of the mission's own branch, clear of all limits."""
    return solve(mission)


@pytest.fixture(scope="module")
def neighbours(mission: Mission) -> list[Mission]:
    """Members of the family not far from its centre."""
    found = []
    for speed, path_angle, azimuth in PLACES:
        p = mission.nominal_parameters.copy()
        p[3:] += (speed, np.radians(path_angle), np.radians(azimuth))
        found.append(mission.with_parameters(p))
    return found


@pytest.fixture(scope="module")
def together(neighbours: list[Mission], centre: Trajectory) -> list[Trajectory]:
    """All of them from the nominal solution, in one go."""
    found = solve_family(neighbours, [centre] * len(neighbours))
    assert all(one is not None for one in found)
    return [one for one in found if one is not None]


def test_the_optima_are_those_of_the_general_method(
    neighbours: list[Mission], centre: Trajectory, together: list[Trajectory]
) -> None:
    for here, found in zip(neighbours, together, strict=True):
        other = solve(here, guess=centre)
        assert (found.status, other.status) == (Status.SOLVED, Status.SOLVED)
        assert found.cost == pytest.approx(other.cost, rel=2e-6)
        assert found.states[6] == pytest.approx(other.states[6], abs=1e-5)
        assert found.final_time == pytest.approx(other.final_time, abs=1e-4)
        assert found.target_multipliers == pytest.approx(other.target_multipliers, rel=1e-3)
        assert found.states[:6, 0] == pytest.approx(here.entry_state, rel=1e-15)


def test_the_logs_converge_like_newtons(together: list[Trajectory]) -> None:
    """The first simplified step is of second order in Newton's, the next ones contract."""
    for found in together:
        log = found.statistics.log
        steps, kinds = [row.step for row in log], [row.subproblem for row in log]
        assert len(steps) == found.statistics.iterations
        assert kinds.count("Solved") <= 2
        assert steps[-1] < 3e-4
        for (before, after), kind in zip(pairwise(steps), kinds, strict=False):
            assert after < (10.0 * before**2 if kind == "Solved" else 0.5 * before)
        assert log[-1].cost == pytest.approx(found.cost, rel=1e-12)


def test_no_bit_depends_on_the_company(
    neighbours: list[Mission], centre: Trajectory, together: list[Trajectory]
) -> None:
    portions = ([0], [1, 2, 3, 4], [4, 0], [2, 1], [3])
    for portion in portions:
        found = solve_family([neighbours[k] for k in portion], [centre] * len(portion))
        for k, one in zip(portion, found, strict=True):
            assert one is not None
            for name in ("states", "bank_rate", "final_time", "cost", "target_multipliers"):
                assert np.array_equal(getattr(one, name), getattr(together[k], name)), (k, name)
            assert one.statistics.iterations == together[k].statistics.iterations


def test_a_hopeless_case_does_not_spoil_its_company(
    neighbours: list[Mission], centre: Trajectory, together: list[Trajectory]
) -> None:
    nowhere = replace(centre, states=centre.states * np.linspace(1.0, 40.0, 64))
    missing = replace(centre, states=np.full_like(centre.states, np.nan))
    found = solve_family(neighbours[:3], [nowhere, centre, missing])
    assert found[0] is None
    assert found[2] is None
    assert found[1] is not None
    assert np.array_equal(found[1].states, together[1].states)


def test_an_active_limit_is_left_to_the_general_method(
    mission: Mission, centre: Trajectory
) -> None:
    highest = float(np.degrees(np.abs(centre.states[6]).max()))
    limits = mission.limits.model_copy(update={"bank_angle": np.radians(highest - 2.0)})
    tight = mission.model_copy(update={"limits": limits})
    assert solve_family([tight], [centre]) == [None]
    assert solve(tight, guess=centre).status is Status.SOLVED
    used = reintegrate(mission, centre).fine_path[0, 1].max()
    heat = mission.limits.model_copy(update={"heat_flux": 0.98 * used * mission.limits.heat_flux})
    assert solve_family([mission.model_copy(update={"limits": heat})], [centre]) == [None]


def test_without_multipliers_or_on_another_mesh_there_is_no_start(
    mission: Mission, centre: Trajectory
) -> None:
    assert solve_family([mission], [replace(centre, target_multipliers=None)]) == [None]
    coarse = mission.toml.replace("degrees = [14, 14, 14]", "degrees = [10, 10, 10]")
    assert coarse != mission.toml
    assert solve_family([parse_mission(coarse)], [centre]) == [None]


@pytest.mark.parametrize("name", ["cavh_wang2020", "x33_liu2015", "rlv_liu2024"])
def test_an_objective_that_it_does_not_know_is_left_alone(name: str) -> None:
    mission = load_mission(name)
    mesh = mission.pseudospectral_mesh
    guess = Trajectory(
        mesh,
        np.ones((7, mesh.n_nodes)),
        np.zeros(mesh.n_nodes),
        900.0,
        0.0,
        Status.SOLVED,
        target_multipliers=np.zeros(len(OptimalControlProblem.of(mission).target)),
    )
    assert solve_family([mission], [guess]) == [None]


def test_models_that_differ_are_solved_in_groups(mission: Mission, centre: Trajectory) -> None:
    density = load_mission("shefex3_density")
    thin, plain, thick = (
        density.with_parameters([*density.nominal_parameters[:-1], factor])
        for factor in (0.99, 1.0, 1.01)
    )
    found = solve_family([thin, plain, thick, thin], [centre] * 4)
    assert all(one is not None and one.status is Status.SOLVED for one in found)
    for here, one in zip((thin, plain, thick), found, strict=False):
        assert one is not None
        assert one.cost == pytest.approx(solve(here, guess=centre).cost, rel=2e-6)
    assert found[0] is not None
    assert found[3] is not None
    assert np.array_equal(found[0].states, found[3].states)


@pytest.fixture(params=["shefex3", "drifting"])
def pair(
    request: pytest.FixtureRequest, flight: Flight, optimum: Point
) -> tuple[Flight, Point, Linearised, CondensedFamily, _Newton]:
    """One case condensed both ways; `drifting` has physics that depend on time to the end."""
    if request.param == "drifting":
        flight, point = request.getfixturevalue("drifting")
    else:
        point = optimum
    problem, here = flight.problem, point.iterate
    rate = flight.transcription.nodal_rate(here.bank_rate) * problem.bank_rate_limit
    guess = NodalGuess(
        here.states * np.array(problem.scaling.states),
        rate,
        here.final_time,
        np.array([1e-6, 3.0, -2.0, 1e-5]) / problem.multiplier_scale,
    )
    run = _Newton.begin([problem, problem], [guess, guess], None)
    return flight, point, flight.linearise(here), run.system()[0].linear, run


Pair = tuple[Flight, Point, Linearised, CondensedFamily, _Newton]


def close(found: Array, expected: Array, digits: float = 1e-9) -> None:
    assert found == pytest.approx(expected, rel=digits, abs=digits * np.abs(expected).max())


def test_state_maps_are_those_of_condensing(pair: Pair) -> None:
    _, _, linearised, family, _ = pair
    single = linearised.condensed.state_map
    z = np.random.default_rng(5).normal(size=(2, single.shape[2]))
    for case in range(2):
        close(family.change(z, np.arange(2))[:, case].T, single @ z[case])
        close(family.change(z[[case]], np.array([case]))[:, 0].T, single @ z[case])
        close(family.final_map[case], single[-1])


def test_corrections_are_those_of_condensing(pair: Pair) -> None:
    _, _, linearised, family, _ = pair
    residual = np.random.default_rng(6).normal(size=(2, family.half.shape[1], 7))
    for case in range(2):
        single = linearised.condensed.correction(residual[case], np.zeros(7))
        close(family.correction(residual, np.arange(2))[case], single[1:])
        close(family.correction(residual[[case]], np.array([case]))[0], single[1:])


def test_multipliers_and_hessian_are_those_of_condensing(pair: Pair) -> None:
    flight, point, linearised, family, run = pair
    problem, n = flight.problem, flight.transcription.mesh.n_nodes
    run.multipliers = np.random.default_rng(7).normal(size=(2, 4))
    hessian = run.hessian(run.curvature(family))
    for case in range(2):
        gradient = np.zeros((n, 7))
        gradient[-1, problem.target.state] = run.multipliers[case]
        final = gradient[None, -1]
        found = family.multipliers(final, np.array([case]))[:, 0]
        close(found.T, linearised.condensed.multipliers(gradient))
        multipliers = Multipliers(run.multipliers[case], np.zeros((n, 3)), np.zeros(n), np.zeros(0))
        single = _lagrangian_hessian(flight, point, linearised, multipliers)
        close(hessian[case], single, 1e-8)


def test_the_shift_of_the_states_enters_as_a_step_does(pair: Pair) -> None:
    # δσ₀ moves states and nothing else: shifting them by Z δσ₀ and stepping δσ₀ are the same to L.
    _, _, _, family, run = pair
    z = np.zeros((2, family.moving.shape[3]))
    z[:, -1] = 1.0
    shift = family.change(z, np.arange(2))[:, :, 1:].transpose(1, 2, 0)
    curvature = run.curvature(family)
    product = curvature.product(shift, np.arange(2))
    for case in range(2):
        close(product[case], curvature.reduced()[case] @ z[case], 1e-8)
        close(curvature.product(0.5 * shift[[case]], np.array([case]))[0], 0.5 * product[case])


def test_with_the_matrices_of_the_point_the_simplified_step_is_newtons(pair: Pair) -> None:
    """The two write the gradient of the Lagrangian differently: by the constraints' rows, and by μ."""
    _, _, _, _, run = pair
    run.final_time += 2.0
    run.u += np.random.default_rng(9).normal(scale=1e-3, size=run.u.shape)
    other = copy.deepcopy(run)
    system, shift = run.system()
    size, along = run.newton_step(system, shift)
    assert np.all(size > 1e-3)
    simplified = other.simplified_step(system, np.zeros_like(along), np.arange(2))
    assert simplified == pytest.approx(size, rel=1e-6)
    assert other.x == pytest.approx(run.x, abs=1e-6 * size[0])
    assert other.multipliers == pytest.approx(run.multipliers, rel=1e-6)
    assert other.final_time == pytest.approx(run.final_time, rel=1e-9)


@pytest.mark.parametrize("beyond", ["bank", "rate", "path"])
def test_a_case_beyond_a_limit_is_left_to_the_whole_method(pair: Pair, beyond: str) -> None:
    _, _, _, _, run = pair
    run = copy.deepcopy(run)
    run.path[:] = 0.5
    assert run.inside().all()
    if beyond == "bank":
        run.x[6, 1, 20] = 1.001 * run.problem.bank_limit
    elif beyond == "rate":
        run.u[1, 20] = -1.001
    else:
        run.path[0, 1, 20] = 1.001
    assert run.inside().tolist() == [True, False]


def test_a_saddle_is_not_taken(problem: OptimalControlProblem, centre: Trajectory) -> None:
    # With multipliers of the wrong sign the Hessian under the target is indefinite.
    guess = from_trajectory(centre, load_mission("shefex3"))
    assert guess.target_multipliers is not None
    wrong = replace(guess, target_multipliers=-20.0 * guess.target_multipliers)
    assert list(newton([problem], [wrong])) == []


def test_the_front_door_says_what_it_takes(mission: Mission, centre: Trajectory) -> None:
    with pytest.raises(ValueError, match="zip"):
        solve_family([mission, mission], [centre])
    assert solve_family([], []) == []
    assert ampi.solve_family is solve_family
    assert RestorationSettings().tolerance == 1e-9


def test_a_case_that_does_not_contract_is_given_up(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps of one size: the first may be any, the second is to be half of it at the most."""
    _, _, _, _, run = pair
    steps = []

    def same(self: _Newton, *arguments: object) -> tuple[np.ndarray, np.ndarray]:
        steps.append(1)
        return np.full(2, 0.2), np.zeros((2, self.u.shape[1], 6))

    monkeypatch.setattr(_Newton, "newton_step", same)
    monkeypatch.setattr(_Newton, "simplified_step", lambda *arguments: np.full(2, 0.2))
    assert list(copy.deepcopy(run).run(0.0)) == []
    assert len(steps) == 2
