"""Newton's iteration for many cases: its optima and limits, no company."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

import ampi
from ampi.missions import Mission, load_mission
from ampi.missions.family import MissionFamily
from ampi.missions.loading import parse_mission
from ampi.missions.parameters import at, with_numbers
from ampi.physics.angles import TURN
from ampi.propagation.reintegration import reintegrate
from ampi.scp.condensed.exact_hessian import ExactHessianIteration
from ampi.scp.condensed.iterate import RestorationSettings
from ampi.scp.condensed.newton import is_known, newton
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.condensed.transcription import radau_transcription
from ampi.scp.guess import from_trajectory, nodal_guess
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
BYTES = ("states", "bank_rate", "final_time", "cost", "target_multipliers")


def robust(mission: Mission, guess: Trajectory) -> Trajectory:
    """By the iteration that needs no neighbour."""
    problem = OptimalControlProblem.of(mission)
    run = ExactHessianIteration(problem, SolverSettings())
    return run.run(nodal_guess(mission, guess), warm=True)


def alone(mission: Mission, guess: Trajectory) -> Trajectory | None:
    """By Newton's iteration, in the family of one."""
    return solve_family(MissionFamily.of([mission]), [guess])[0]


def limited(mission: Mission, **limits: float) -> Mission:
    """The mission under other limits (SI)."""
    return mission.model_copy(update={"limits": mission.limits.model_copy(update=limits)})


def assert_the_same(found: Trajectory | None, other: Trajectory) -> None:
    """The optimum of the other method."""
    assert found is not None
    assert (found.status, other.status) == (Status.SOLVED, Status.SOLVED)
    assert found.cost == pytest.approx(other.cost, rel=2e-6)
    assert found.states[6] == pytest.approx(other.states[6], abs=1e-5)
    assert found.final_time == pytest.approx(other.final_time, abs=1e-4)
    assert found.target_multipliers == pytest.approx(other.target_multipliers, rel=1e-3)


@pytest.fixture(scope="module")
def neighbours(mission: Mission) -> MissionFamily[Mission]:
    """Members of the family not far from its centre."""
    p = np.tile(mission.nominal_parameters, (len(PLACES), 1))
    p[:, 3:] += np.array(PLACES) * (1.0, np.radians(1.0), np.radians(1.0))
    return mission.family(p)


@pytest.fixture(scope="module")
def together(neighbours: MissionFamily[Mission], centre: Trajectory) -> list[Trajectory]:
    """All of them from the nominal solution, in one go."""
    found = solve_family(neighbours, [centre] * len(neighbours))
    assert all(one is not None for one in found)
    return [one for one in found if one is not None]


def test_the_optima_are_those_of_the_general_method(
    neighbours: MissionFamily[Mission], centre: Trajectory, together: list[Trajectory]
) -> None:
    for case, found in enumerate(together):
        here = neighbours.member(case)
        assert_the_same(found, robust(here, centre))
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


def assert_equal_bits(one: Trajectory | None, other: Trajectory | None) -> None:
    """Nothing but the time may differ."""
    assert one is not None
    assert other is not None
    for name in BYTES:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert one.statistics.iterations == other.statistics.iterations


def test_no_bit_depends_on_the_company(
    neighbours: MissionFamily[Mission], centre: Trajectory, together: list[Trajectory]
) -> None:
    portions = ([0], [1, 2, 3, 4], [4, 0], [2, 1], [3])
    for portion in portions:
        found = solve_family(neighbours.take(portion), [centre] * len(portion))
        for k, one in zip(portion, found, strict=True):
            assert_equal_bits(one, together[k])


def test_a_hopeless_case_does_not_spoil_its_company(
    neighbours: MissionFamily[Mission], centre: Trajectory, together: list[Trajectory]
) -> None:
    nowhere = replace(centre, states=centre.states * np.linspace(1.0, 40.0, 64))
    missing = replace(centre, states=np.full_like(centre.states, np.nan))
    found = solve_family(neighbours.take([0, 1, 2]), [nowhere, centre, missing])
    assert found[0] is None
    assert found[2] is None
    assert found[1] is not None
    assert np.array_equal(found[1].states, together[1].states)


def test_an_active_limit_is_held(mission: Mission, centre: Trajectory) -> None:
    """The bank angle between two nodes, the heat flux at one."""
    highest = float(np.abs(centre.states[6]).max())
    # between the nodes the robust iteration takes a part of what is tolerated, the more the tighter
    # the limit is; test_nlp_witness compares with IPOPT, which does not
    bank = limited(mission, bank_angle=highest - np.radians(0.05))
    found = alone(bank, centre)
    assert found is not None
    assert found.cost == pytest.approx(robust(bank, centre).cost, rel=1e-6)
    between = radau_transcription(centre.mesh).between @ found.states[6]
    assert np.abs(between).max() == pytest.approx(bank.limits.bank_angle, rel=1e-9)
    assert found.cost > centre.cost

    used = reintegrate(mission, centre).fine_path[0, 1].max() * mission.limits.heat_flux
    for share in (0.9995, 0.98):
        cool = limited(mission, heat_flux=share * used)
        found = alone(cool, centre)
        assert_the_same(found, robust(cool, centre))
        assert found is not None
        assert found.cost > centre.cost
        assert max(found.statistics.limit_excess) < 1e-6
    cold = limited(mission, heat_flux=0.8 * used)
    assert alone(cold, centre) is None


def test_without_multipliers_or_on_another_mesh_there_is_no_start(
    mission: Mission, centre: Trajectory
) -> None:
    assert alone(mission, replace(centre, target_multipliers=None)) is None
    coarse = mission.toml.replace("degrees = [14, 14, 14]", "degrees = [10, 10, 10]")
    assert coarse != mission.toml
    assert alone(parse_mission(coarse), centre) is None


@pytest.mark.parametrize("name", ["cavh_wang2020", "cavh_zhou2021", "rlv_liu2024"])
def test_an_objective_that_it_does_not_know_is_left_alone(name: str) -> None:
    mission = load_mission(name)
    mesh, problem = mission.pseudospectral_mesh, OptimalControlProblem.of(mission)
    guess = Trajectory(
        mesh,
        np.ones((7, mesh.n_nodes)),
        np.zeros(mesh.n_nodes),
        900.0,
        0.0,
        Status.SOLVED,
        target_multipliers=np.zeros(len(problem.target)),
    )
    assert not is_known(problem)
    assert alone(mission, guess) is None


def test_models_that_differ_are_solved_together(mission: Mission, centre: Trajectory) -> None:
    density = load_mission("shefex3_density")
    p = np.tile(density.nominal_parameters, (4, 1))
    p[:, -1] = 0.99, 1.0, 1.01, 0.99
    family = density.family(p)
    found = solve_family(family, [centre] * 4)
    assert all(one is not None and one.status is Status.SOLVED for one in found)
    for case, one in enumerate(found[:3]):
        assert one is not None
        assert one.cost == pytest.approx(robust(family.member(case), centre).cost, rel=2e-6)
    assert found[0] is not None
    assert found[3] is not None
    assert np.array_equal(found[0].states, found[3].states)


def test_members_may_differ_in_any_number(mission: Mission, centre: Trajectory) -> None:
    """Density, lift, drag, mass and limits: the optima of `solve`, whatever the company."""
    numbers: tuple[tuple[tuple[str, ...], float, float], ...] = (
        (("atmosphere", "density_factor"), 0.99, 1.01),
        (("vehicle", "lift_factor"), 1.01, 0.99),
        (("vehicle", "drag_factor"), 1.005, 0.995),
        (("vehicle", "mass"), 1.003, 1.0),
        (("limits", "heat_flux"), 0.9, 1.1),
        (("limits", "bank_angle"), 1.0, 0.95),
        (("limits", "bank_rate"), 0.9, 1.05),
        (("target", "altitude"), 1.0, 0.999),
    )
    members = [mission]
    for k in (1, 2):
        moved = [(one[0], one[k] * at(mission, one[0])) for one in numbers]
        members += [with_numbers(mission, moved), with_numbers(mission, moved[:3])]
    family = MissionFamily.of(members)
    found = solve_family(family, [centre] * len(family))
    for case, one in enumerate(found):
        assert one is not None
        other = solve(family.member(case), guess=centre)
        assert (one.status, other.status) == (Status.SOLVED, Status.SOLVED)
        assert one.cost == pytest.approx(other.cost, rel=2e-6)
        assert one.cost == pytest.approx(robust(family.member(case), centre).cost, rel=2e-6)
    for portion in ([0], [3, 1], [4], [2, 0, 4]):
        again = solve_family(family.take(portion), [centre] * len(portion))
        for case, one in zip(portion, again, strict=True):
            assert_equal_bits(one, found[case])


def under_way(mission: Mission, **entry: float) -> Mission:
    """The mission with more of its entry given (SI)."""
    return mission.model_copy(update={"entry": mission.entry.model_copy(update=entry)})


def test_a_given_bank_angle_and_rate_are_met(mission: Mission, centre: Trajectory) -> None:
    bank, rate = centre.states[6, 0] + np.radians(2.0), centre.bank_rate[0] - np.radians(0.05)
    free, *given = (
        alone(one, centre)
        for one in (
            mission,
            under_way(mission, bank_angle=bank),
            under_way(mission, bank_rate=rate),
            under_way(mission, bank_angle=bank, bank_rate=rate),
        )
    )
    assert free is not None
    for k, found in enumerate(given):
        assert found is not None
        assert found.status is Status.SOLVED
        assert found.cost > free.cost * (1.0 + 1e-6)  # every wish costs
        if k != 1:
            assert found.states[6, 0] == bank
        if k != 0:
            assert found.bank_rate[0] == pytest.approx(rate, abs=1e-12)
    turned = alone(under_way(mission, bank_angle=bank + TURN, bank_rate=rate), centre)
    assert turned is not None
    assert turned.cost == pytest.approx(given[2].cost, rel=1e-9)
    # in a family of values of their own
    angles = bank + np.radians([0.0, 1.0])
    members = [under_way(mission, bank_angle=float(angle), bank_rate=rate) for angle in angles]
    family = solve_family(MissionFamily.of(members), [centre, centre])
    assert_equal_bits(family[0], given[2])
    assert family[1] is not None
    assert family[1].states[6, 0] == angles[1]
    # what the flight does of itself asks for nothing
    same = under_way(mission, bank_angle=free.states[6, 0], bank_rate=free.bank_rate[0])
    found = alone(same, centre)
    assert found is not None
    assert found.cost == pytest.approx(free.cost, rel=1e-9)


def test_a_range_of_a_final_angle_is_held_at_its_bound(
    mission: Mission, centre: Trajectory
) -> None:
    """From a neighbour that is held elsewhere, and from one that is not held."""
    final = float(centre.states[4, -1])

    def steeper(least: float, most: float) -> Mission:
        angles = {"flight_path_angle": (final + np.radians(least), final + np.radians(most))}
        return mission.model_copy(update={"target": mission.target.model_copy(update=angles)})

    outside, inside = steeper(-3.0, -0.5), steeper(-2.0, 1.0)
    start = replace(centre, target_multipliers=np.append(centre.target_multipliers, 0.0))
    free, held = alone(inside, start), alone(outside, start)
    assert free is not None
    assert free.cost == pytest.approx(centre.cost, rel=1e-6)
    assert free.target_multipliers[-1] == 0.0
    assert_the_same(held, robust(outside, start))
    assert held is not None
    assert held.states[4, -1] == pytest.approx(final + np.radians(-0.5), abs=1e-9)
    assert held.target_multipliers[-1] != 0.0
    further = alone(steeper(-3.0, -0.6), held)
    assert further is not None
    assert further.cost > held.cost > free.cost
    # a neighbour of another target has no multipliers for this one, and is still a guess
    assert alone(outside, centre) is None
    assert solve(outside, guess=centre).cost == pytest.approx(held.cost, rel=2e-6)


def test_a_saddle_is_not_taken(problem: OptimalControlProblem, centre: Trajectory) -> None:
    # With multipliers of the wrong sign the Hessian under the target is indefinite.
    guess = from_trajectory(centre, load_mission("shefex3"))
    assert guess.target_multipliers is not None
    wrong = replace(guess, target_multipliers=-20.0 * guess.target_multipliers)
    assert list(newton(problem, [wrong])) == []


def test_the_front_door_says_what_it_takes(mission: Mission, centre: Trajectory) -> None:
    nominal = mission.nominal_parameters
    with pytest.raises(ValueError, match="one for each of the 2 cases, got 1"):
        solve_family(mission.family(np.stack([nominal, nominal])), [centre])
    assert solve_family(mission.family(np.empty((0, len(nominal)))), []) == []
    assert ampi.solve_family is solve_family
    assert RestorationSettings().tolerance == 1e-9
