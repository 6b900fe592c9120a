"""Sensitivities of optima: central differences of optima solved again are the witness."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission
from ampi.physics.state import LONGITUDE
from ampi.scp.condensed.kkt_factors import KktFactors
from ampi.scp.condensed.newton_system import STIFFEST
from ampi.scp.condensed.transcription import radau_transcription
from ampi.scp.sensitivities import Sensitivities, sensitivities
from ampi.scp.solve import optimum, solve_family
from ampi.trajectory import Trajectory
from tests.support.missions import text_on_grid

Array = NDArray[np.float64]

GRID = """[grid]
speed_m_per_s = [-70.0, 0.0, 70.0]
azimuth_deg = [-0.5, 0.0, 0.5]
"entry.longitude_deg" = [-0.5, 0.0, 0.5]
"target.longitude_deg" = [-0.5, 0.0, 0.5]
"vehicle.mass_kg" = [-10.0, 0.0, 10.0]
"vehicle.angle_of_attack.end_angle_deg" = [-0.5, 0.0, 0.5]
"objective.bank_rate_effort" = [-1e-6, 0.0, 1e-6]
"limits.bank_angle_deg" = [-1.0, 0.0, 1.0]
"""
SHARE = 1e-3  # of an axis, to either side: what a difference spans


@dataclass(frozen=True)
class Differences:
    """Of optima solved again beside one, per unit of a parameter."""

    states: Array
    bank_rate: Array
    final_time: float


def settled(mission: Mission, p: Array, start: Trajectory) -> Trajectory:
    """The optimum at p, far closer than a solve must come: Newton's steps from a solution on."""
    for _ in range(2):
        (found,) = solve_family(mission.family(p[None]), [start])
        assert found is not None
        start = found
    return start


def at(mission: Mission, p: Array, found: Trajectory) -> Sensitivities:
    return sensitivities(mission, p[None], [found])


def difference(
    mission: Mission, start: Trajectory, axis: int, sides: tuple[float, float] = (1.0, -1.0)
) -> tuple[Differences, list[Trajectory]]:
    """From the optima at these multiples of a step from the nominal p, and those optima."""
    step = SHARE * np.ptp(mission.parameters[axis].axis)
    row = step * np.eye(len(mission.parameters))[axis]
    p, span = mission.nominal_parameters, (sides[0] - sides[1]) * step
    there = [settled(mission, p + side * row, start) for side in sides]
    one, other = there
    found = Differences(
        (one.states - other.states) / span,
        (one.bank_rate - other.bank_rate) / span,
        (one.final_time - other.final_time) / span,
    )
    return found, there


def assert_witnessed(
    found: Sensitivities, axis: int, witness: Differences, tolerance: float
) -> None:
    """Row by row, of its largest value."""
    rows = [*found.states[0, axis], found.bank_rate[0, axis]]
    for row, expected in zip(rows, [*witness.states, witness.bank_rate], strict=True):
        assert row == pytest.approx(expected, abs=tolerance * np.abs(expected).max() + 1e-12)
    assert found.final_time[0, axis] == pytest.approx(witness.final_time, rel=tolerance)


def assert_all_witnessed(mission: Mission, found: Trajectory, tolerance: float) -> int:
    """Along every axis that moves the optimum and leaves the held rows what they are: how many."""
    here = at(mission, mission.nominal_parameters, found)
    checked = 0
    for axis, parameter in enumerate(mission.parameters):
        if parameter.name == "limits.bank_angle" and not here.held.any():
            assert not here.states[0, axis].any()  # a limit out of reach moves nothing
            continue
        witness, there = difference(mission, found, axis)
        step = SHARE * np.ptp(parameter.axis) * np.eye(len(mission.parameters))[axis]
        for side, one in zip((1.0, -1.0), there, strict=True):
            held = at(mission, mission.nominal_parameters + side * step, one).held
            assert np.array_equal(held, here.held), "no difference of one branch: choose less"
        assert_witnessed(here, axis, witness, tolerance)
        checked += 1
    return checked


@pytest.fixture(scope="module")
def many() -> Mission:
    """SHEFEX-3 over parameters of every kind."""
    return parse_mission(text_on_grid(GRID))


@pytest.fixture(scope="module")
def free(many: Mission, centre: Trajectory) -> Trajectory:
    """Its optimum: no limit holds it."""
    return settled(many, many.nominal_parameters, centre)


@pytest.fixture(scope="module")
def limited(many: Mission, free: Trajectory) -> tuple[Mission, Trajectory]:
    """The mission with a bank limit three degrees below what the optimum takes, and its optimum."""
    limit = float(np.abs(free.states[6]).max()) - np.radians(3.0)
    limits = many.limits.model_copy(update={"bank_angle": limit})
    mission = many.model_copy(update={"limits": limits})
    found = optimum(mission, guess=free)
    return mission, settled(mission, mission.nominal_parameters, found)


def test_optima_solved_again_are_where_the_derivative_leads(
    many: Mission, free: Trajectory
) -> None:
    assert assert_all_witnessed(many, free, 1e-5) == 7


def test_the_same_where_the_bank_limit_holds(limited: tuple[Mission, Trajectory]) -> None:
    mission, found = limited
    assert at(mission, mission.nominal_parameters, found).held.any()
    assert assert_all_witnessed(mission, found, 2e-5) == 8


def test_the_same_in_another_air_and_with_another_vehicle() -> None:
    mission = load_mission("shefex3_factors")
    found = settled(mission, mission.nominal_parameters, optimum(mission))
    assert assert_all_witnessed(mission, found, 1e-6) == 8


@pytest.mark.slow
def test_the_same_on_the_heat_flux_limit() -> None:
    grid = """[grid]
speed_m_per_s = [-5.0, 0.0, 5.0]
"limits.heat_flux_MW_per_m2" = [-0.01, 0.0, 0.01]
"limits.heat_flux_margin" = [-0.001, 0.0, 0.001]
"objective.heat_load" = [-1e-4, 0.0, 1e-4]
"""
    mission = parse_mission(text_on_grid(grid, "lifting_orbital"))
    found = settled(mission, mission.nominal_parameters, optimum(mission))
    assert at(mission, mission.nominal_parameters, found).held.any()
    assert assert_all_witnessed(mission, found, 1e-5) == 4


def test_a_turned_planet_turns_the_optimum(many: Mission, free: Trajectory) -> None:
    """Entry and target moved east together: the whole flight is, and nothing else changes."""
    found = at(many, many.nominal_parameters, free)
    names = [parameter.name for parameter in many.parameters]
    entry, target = names.index("longitude"), names.index("target.longitude")
    both = found.states[0, entry] + found.states[0, target]
    size = np.abs(found.states[0, target]).max(axis=1)
    assert both[LONGITUDE] == pytest.approx(1.0, abs=1e-7)
    both[LONGITUDE] = 0.0
    assert np.all(np.abs(both).max(axis=1) < 1e-6 * size)
    times = found.final_time[0]
    assert times[entry] == pytest.approx(-times[target], rel=1e-6)


def test_where_a_limit_begins_to_hold_each_side_has_its_own(
    many: Mission, free: Trajectory
) -> None:
    """The bank limit moved over the optimum's own bank angle: the held rows differ, and it shows."""
    axis = [parameter.name for parameter in many.parameters].index("limits.bank_angle")
    step = SHARE * np.ptp(many.parameters[axis].axis)
    row = step * np.eye(len(many.parameters))[axis]
    between = radau_transcription(many.pseudospectral_mesh).between
    peak = max(np.abs(free.states[6]).max(), np.abs(between @ free.states[6]).max())
    limits = many.limits.model_copy(update={"bank_angle": float(peak) - 0.2 * step})
    mission = many.model_copy(update={"limits": limits})
    p = mission.nominal_parameters
    found = settled(mission, p, free)
    held, beyond = at(mission, p, found), settled(mission, p + row, found)
    assert held.held.any()
    assert not at(mission, p + row, beyond).held.any()
    own, _ = difference(mission, found, axis, (0.0, -1.0))
    assert_witnessed(held, axis, own, 1e-2)
    across, _ = difference(mission, found, axis)
    assert np.abs(across.states - own.states).max() > 0.1 * np.abs(own.states).max()


def test_none_depends_on_its_company(many: Mission, free: Trajectory) -> None:
    p = np.tile(many.nominal_parameters, (3, 1))
    p[:, [parameter.name for parameter in many.parameters].index("speed")] += (0.0, 10.0, -20.0)
    found = [one for one in solve_family(many.family(p), [free] * 3) if one is not None]
    together = sensitivities(many, p, found)
    for case in range(3):
        alone = at(many, p[case], found[case])
        for name in ("states", "bank_rate", "final_time", "held"):
            assert np.array_equal(getattr(alone, name)[0], getattr(together, name)[case])


def test_what_is_no_optimum_has_none(many: Mission, free: Trajectory) -> None:
    elsewhere = replace(free, final_time=free.final_time + 20.0)
    p = np.tile(many.nominal_parameters, (2, 1))
    found = sensitivities(many, p, [elsewhere, free])
    for array in (found.states, found.bank_rate, found.final_time):
        assert np.isnan(array[0]).all()
        assert np.isfinite(array[1]).all()


def test_what_cannot_be_differentiated_is_refused(many: Mission, free: Trajectory) -> None:
    p = many.nominal_parameters
    objective = many.objective.model_copy(update={"bank_rate_variation": 1.0})
    kinked = many.model_copy(update={"objective": objective})
    with pytest.raises(ValueError, match=r"absolute values.*objective\.bank_rate_variation"):
        at(kinked, p, free)
    with pytest.raises(ValueError, match="with target_multipliers"):
        at(many, p, replace(free, target_multipliers=None))
    with pytest.raises(ValueError, match="a grid with an axis"):
        at(parse_mission(text_on_grid("[grid]\n")), p[:0], free)


def test_rows_that_almost_depend_on_each_other_need_more_stiffness() -> None:
    """H is positive definite under the rows, but of the stiffness across them a hundredth is left."""
    hessian, gradient = np.diag([-1.0, -50.0, 1.0]), np.array([1.0, 2.0, 3.0])
    rows = np.array([[1.0, 0.0, 0.0], [np.cos(0.1), np.sin(0.1), 0.0]])
    error, none = np.array([0.1, 0.2]), np.zeros(2)
    assert KktFactors.of(hessian, rows, none) is None
    factors = KktFactors.of(hessian, rows, none, STIFFEST)
    assert factors is not None
    whole = np.block([[hessian, rows.T], [rows, np.zeros((2, 2))]])
    expected = np.linalg.solve(whole, -np.concatenate([gradient, error]))
    assert np.concatenate(factors.solution(gradient, error)) == pytest.approx(expected, rel=1e-9)
