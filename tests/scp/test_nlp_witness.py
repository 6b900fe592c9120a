"""Our optima against an independent witness: the same transcription, solved by IPOPT."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.missions import Mission, load_mission
from ampi.missions.family import MissionFamily
from ampi.missions.flight_sections import NoFlyZoneSection
from ampi.physics.path_constraints import path_constraints
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import LOADS
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.guess import ConstantBank, NodalGuess, constant_bank_guess, from_trajectory
from ampi.scp.solve import optimum, solve_family
from ampi.trajectory import Status, Trajectory
from tests.support.witness import Optimum, nlp

pytestmark = pytest.mark.slow

GUESS = ConstantBank(np.radians(-30.0))


def flown(mission: Mission, bank_deg: float) -> NodalGuess:
    """A constant-bank flight at the nodes."""
    guess = constant_bank_guess(mission, ConstantBank(np.radians(bank_deg)))
    assert guess is not None
    return guess


def limited(mission: Mission, kind: int, share: float, nominal: Trajectory) -> Mission:
    """The mission with one path limit at a share of the nominal optimum's peak."""
    values = path_constraints(mission.flight_model, nominal.states, nominal.times)
    limit = {LOADS[kind]: share * float(values[kind].max())}
    return mission.model_copy(update={"limits": mission.limits.model_copy(update=limit)})


def assert_the_same(ours: Trajectory, witness: Optimum) -> None:
    """Objective to 1e-6, states to the flatness of the optimum."""
    assert witness.status == "Solve_Succeeded"
    assert ours.cost == pytest.approx(witness.cost, rel=1e-6)
    assert ours.final_time == pytest.approx(witness.final_time, abs=1e-2)
    error = np.abs(ours.states - witness.states).max(axis=1)
    assert error[0] < 5.0  # m
    assert error[[1, 2]].max() * 6.4e6 < 20.0  # m
    assert error[3] < 0.2  # m/s
    assert error[4:].max() < 2e-4  # rad
    assert np.abs(ours.bank_rate[1:] - witness.bank_rate).max() < 1e-5  # rad/s


@pytest.mark.parametrize("bank_deg", [-30.0, -20.0])
def test_the_nominal_optimum(mission: Mission, nominal: Trajectory, bank_deg: float) -> None:
    assert_the_same(nominal, nlp(mission, flown(mission, bank_deg)))


def test_a_corner_of_the_hexeract(mission: Mission, nominal: Trajectory) -> None:
    corner = mission.with_entry([axis[-1] for axis in mission.grid_axes])
    ours = optimum(corner, guess=nominal)
    assert_the_same(ours, nlp(corner, flown(corner, -30.0)))


def test_an_optimum_on_the_dynamic_pressure_limit(mission: Mission, nominal: Trajectory) -> None:
    soft = limited(mission, 0, 0.9, nominal)
    ours = optimum(soft, guess=GUESS)
    assert ours.status is Status.SOLVED
    assert ours.cost > 1.1 * nominal.cost
    assert_the_same(ours, nlp(soft, flown(soft, -30.0), bank=ours.states[6]))


def test_an_optimum_on_the_heat_flux_limit(mission: Mission, nominal: Trajectory) -> None:
    # The peak comes after a minute, before the bank angle has much to say: 0.05 % cost tenfold.
    cool = limited(mission, 1, 0.9995, nominal)
    ours = optimum(cool, guess=GUESS)
    assert ours.status is Status.SOLVED
    assert ours.cost > 5.0 * nominal.cost
    # from −30° IPOPT may end, by the last digits of the nodes, at a local optimum that costs 30 % more
    assert_the_same(ours, nlp(cool, flown(cool, -20.0), bank=ours.states[6]))


def beside(neighbour: Mission, mission: Mission, guess: Trajectory) -> Trajectory:
    """By Newton's iteration alone, from the optimum of a neighbour."""
    start = optimum(neighbour, guess=guess)
    assert start.status is Status.SOLVED
    (found,) = solve_family(MissionFamily.of([mission]), [start])
    assert found is not None
    assert found.status is Status.SOLVED
    return found


def test_newtons_iteration_on_the_bank_limit(mission: Mission) -> None:
    """Held between two nodes, where the polynomial touches it."""
    free = optimum(mission)
    highest = float(np.abs(free.states[6]).max())
    limits = mission.limits.model_copy(update={"bank_angle": highest - np.radians(2.0)})
    tight = mission.model_copy(update={"limits": limits})
    ours = beside(mission, tight, free)
    assert ours.cost > 1.01 * free.cost
    witness = nlp(tight, from_trajectory(ours, tight), near=True)
    assert witness.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    assert ours.cost == pytest.approx(witness.cost, rel=1e-6)


def test_newtons_iteration_with_a_given_entry_and_a_range(mission: Mission) -> None:
    """Bank angle and rate at the entry, and a final path angle at the bound of its range."""
    free = optimum(mission)
    final = float(free.states[4, -1])
    entry = mission.entry.model_copy(
        update={
            "bank_angle": float(free.states[6, 0]) + np.radians(2.0),
            "bank_rate": float(free.bank_rate[0]) - np.radians(0.05),
        }
    )
    target = mission.target.model_copy(
        update={"flight_path_angle": (final - np.radians(2.0), final - np.radians(0.4))}
    )
    asked = mission.model_copy(update={"entry": entry, "target": target})
    start = replace(free, target_multipliers=np.append(free.target_multipliers, 0.0))
    (ours,) = solve_family(MissionFamily.of([asked]), [start])
    assert ours is not None
    assert ours.cost > 1.005 * free.cost
    witness = nlp(asked, from_trajectory(ours, asked), near=True)
    assert witness.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    assert ours.cost == pytest.approx(witness.cost, rel=1e-6)
    assert witness.states[4, -1] == pytest.approx(final - np.radians(0.4), abs=1e-7)


def test_the_smallest_excess_of_a_hopeless_limit(mission: Mission, nominal: Trajectory) -> None:
    cold = limited(mission, 1, 0.95, nominal)
    ours = optimum(cold, guess=GUESS)
    assert ours.status is Status.LIMITS_EXCEEDED
    witness = nlp(cold, flown(cold, -30.0), excess_price=1e7)
    assert witness.status == "Solve_Succeeded"
    assert witness.slack > 0.01
    assert ours.statistics.limit_excess[1] == pytest.approx(witness.slack, abs=1e-4)


def coarse(name: str, degrees: tuple[int, ...]) -> Mission:
    """A shipped mission on a small mesh, without the least bank angle."""
    mission = load_mission(name).with_mesh(Mesh((Phase(degrees),)))
    limits = mission.limits.model_copy(update={"bank_angle_minimum": 0.0})
    return mission.model_copy(update={"limits": limits}).with_mesh(mission.pseudospectral_mesh)


def objective(mission: Mission, **terms: float) -> Mission:
    """The mission with other terms in its objective."""
    changed = mission.objective.model_copy(update=terms)
    return mission.model_copy(update={"objective": changed}).with_mesh(mission.pseudospectral_mesh)


def assert_optimal(mission: Mission, ours: Trajectory) -> None:
    """IPOPT, started in the valley of our optimum, ends at its cost."""
    assert ours.status is Status.SOLVED
    beside = from_trajectory(ours, mission)
    witness = nlp(mission, beside, near=True)
    assert witness.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    assert ours.cost == pytest.approx(witness.cost, rel=1e-4)
    assert ours.final_time == pytest.approx(witness.final_time, rel=1e-3)


FIVE = (5,) * 8
MISSIONS = {
    "least bank-rate variation": ("cavh_zhou2021", (5,) * 10, {}),
    "even descent": ("cavh_wang2020", (5,) * 10, {}),
    "final angles met exactly": ("rlv_liu2024", (5,) * 10, {}),
    "minimum time": ("x33_liu2015", FIVE, {}),
    "maximum time": ("x33_liu2015", FIVE, {"flight_time": -1.0}),
    "drag floor and a long way": ("cavh_liu2015", (8,) * 8, {}),
    "minimum heat load": ("x33_liu2015", FIVE, {"flight_time": 0.0, "heat_load": 1.0}),
}


@pytest.mark.parametrize("case", MISSIONS)
def test_an_optimum_of_the_other_missions(case: str) -> None:
    name, degrees, terms = MISSIONS[case]
    mission = objective(coarse(name, degrees), **terms)
    if name == "cavh_liu2015":  # its zones ask for a finer mesh; they have their own test
        free = mission.model_copy(update={"no_fly_zone": ()})
        mission = free.with_mesh(mission.pseudospectral_mesh)
    assert_optimal(mission, optimum(mission))


def test_an_optimum_beside_a_no_fly_zone(mission: Mission, nominal: Trajectory) -> None:
    # A zone over the optimum's ground track at half of the flight, its centre off to one side.
    middle = nominal.states[1:3, nominal.states.shape[1] // 2]
    off = np.array([0.0, np.radians(1.0)])
    zone = NoFlyZoneSection.model_construct(
        longitude=middle[0] + off[0], latitude=middle[1] + off[1], radius=150e3
    )
    closed = mission.model_copy(update={"no_fly_zone": (zone,)})
    ours = optimum(closed, guess=GUESS)
    assert ours.status is Status.SOLVED
    radius = mission.flight_model.planet.equatorial_radius
    away = great_circle_distance(*ours.states[1:3], zone.longitude, zone.latitude, radius)
    assert away.min() == pytest.approx(zone.radius, rel=1e-6)
    assert ours.cost > nominal.cost
    beside = from_trajectory(ours, closed)
    assert_the_same(ours, nlp(closed, beside, near=True))
