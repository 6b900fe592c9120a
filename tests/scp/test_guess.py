"""Initial guesses: constant-bank flights, and other trajectories on the mission's mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.missions import Mission, load_mission
from ampi.missions.sections import GuessSection, MeshSection, PhaseSection
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.planet import bearing, great_circle_distance
from ampi.scp.guess import (
    ConstantBank,
    constant_bank_guess,
    constant_banks,
    default_guess,
    from_trajectory,
    nodal_guess,
)
from ampi.scp.solve import solve
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]


def on_another_mesh(mission: Mission) -> Mission:
    """The mission with segments of other number and degree."""
    phases = (
        PhaseSection.model_construct(end=58.0, degrees=(9, 6), fractions=None),
        PhaseSection.model_construct(end=88.0, degrees=(9,), fractions=None),
        PhaseSection.model_construct(end=None, degrees=(11, 11, 11, 11), fractions=None),
    )
    fields = {name: getattr(mission, name) for name in type(mission).model_fields}
    return type(mission).model_construct(
        **{**fields, "mesh": MeshSection.model_construct(phase=phases)}
    )


@pytest.mark.parametrize("bank_deg", [-50.0, 0.0, 35.0])
def test_a_constant_bank_flight_is_flown_down_to_the_target_speed(
    mission: Mission, bank_deg: float
) -> None:
    guess = constant_bank_guess(mission, ConstantBank(np.radians(bank_deg)))
    assert guess is not None
    assert guess.states.shape == (mission.pseudospectral_mesh.n_nodes, 7)
    assert guess.states[0, :6] == pytest.approx(mission.entry_state, rel=1e-14)
    assert guess.states[:, 6] == pytest.approx(np.full(len(guess.states), np.radians(bank_deg)))
    assert guess.states[-1, 3] == pytest.approx(mission.target.speed, abs=1e-6)
    assert np.all(guess.bank_rate == 0.0)
    witness = solve_ivp(
        lambda t, x: equations_of_motion(mission.flight_model, x, 0.0, t),
        (0.0, guess.final_time),
        guess.states[0],
        method="DOP853",
        max_step=2.0,
        rtol=1e-9,
        atol=1e-9,
    )
    error = witness.y[:, -1] - guess.states[-1]
    assert abs(error[0]) < 100.0
    assert np.abs(error[1:3]).max() * 6.4e6 < 100.0
    assert abs(error[3]) < 0.5


def test_a_flight_that_never_slows_down_is_none(mission: Mission) -> None:
    leaving = mission.entry_state.copy()
    leaving[3], leaving[4] = 9000.0, 0.3
    assert constant_bank_guess(mission.with_entry(leaving), ConstantBank(0.0)) is None
    assert constant_banks(mission.with_entry(leaving), candidates=2) == []


def test_a_flight_that_ends_before_the_last_phase_is_none(mission: Mission) -> None:
    early = mission.target.model_copy(update={"speed": 4700.0})
    short = mission.model_copy(update={"target": early})
    assert constant_bank_guess(short, ConstantBank(0.0)) is None


def test_the_best_constant_bank_ends_nearest(mission: Mission) -> None:
    best, *_ = constant_banks(mission, candidates=5)
    assert best is not None
    target = mission.target

    def miss(bank_angle: float) -> float:
        guess = constant_bank_guess(mission, ConstantBank(bank_angle))
        assert guess is not None
        final = guess.states[-1]
        return float(
            great_circle_distance(final[1], final[2], target.longitude, target.latitude, 1.0)
        )

    limit = 0.9 * mission.limits.bank_angle
    candidates = np.linspace(-limit, limit, 5)
    assert best.bank_angle in candidates
    assert miss(best.bank_angle) == min(miss(float(angle)) for angle in candidates)


def test_a_mission_may_name_its_guess(mission: Mission) -> None:
    named = mission.model_copy(update={"guess": GuessSection(bank_angle_deg=12.0)})
    assert default_guess(named) == ConstantBank(np.radians(12.0))
    unnamed = mission.model_copy(update={"guess": None})
    assert default_guess(unnamed) == constant_banks(mission)[0]


def test_a_trajectory_on_its_own_mesh_is_taken_as_it_is(
    mission: Mission, nominal: Trajectory
) -> None:
    guess = from_trajectory(nominal, mission)
    assert np.array_equal(guess.states.T, nominal.states)
    assert np.array_equal(guess.bank_rate, nominal.bank_rate)
    assert guess.final_time == nominal.final_time
    guess.states[0, 0] = guess.bank_rate[0] = 0.0
    assert nominal.states[0, 0] == pytest.approx(100.1e3)  # a copy


def test_a_trajectory_on_another_mesh_is_resampled(mission: Mission, nominal: Trajectory) -> None:
    other = on_another_mesh(mission)
    guess = from_trajectory(nominal, other)
    times = other.pseudospectral_mesh.times(nominal.final_time)
    states, _ = nominal.at(np.minimum(times, nominal.final_time))
    assert guess.states == pytest.approx(states.T)
    for s in other.pseudospectral_mesh.segments:  # the rate of the bank angle on the new mesh
        half = s.half_length[0] + s.half_length[1] * nominal.final_time
        turned = half * guess.bank_rate[1:][s.collocation]
        assert turned == pytest.approx(s.rule.derivative @ states[6, s.nodes], abs=1e-12)
    assert guess.states[0] == pytest.approx(nominal.states[:, 0])
    assert guess.states[-1] == pytest.approx(nominal.states[:, -1])
    solved = solve(other, guess=nominal)
    assert solved.status is Status.SOLVED
    assert solved.statistics.iterations <= 8
    assert solved.cost == pytest.approx(nominal.cost, rel=2e-2)


def test_any_guess_is_dispatched(mission: Mission, nominal: Trajectory) -> None:
    bank = nodal_guess(mission, ConstantBank(0.1))
    assert bank is not None
    assert bank.states[0, 6] == pytest.approx(0.1)
    warm = nodal_guess(mission, nominal)
    assert warm is not None
    assert warm.final_time == nominal.final_time


def test_a_failed_trajectory_is_a_guess_that_cannot_be_flown(
    mission: Mission, nominal: Trajectory
) -> None:
    nothing = replace(
        nominal,
        states=np.full_like(nominal.states, np.nan),
        bank_rate=np.full_like(nominal.bank_rate, np.nan),
    )
    again = solve(mission, guess=nothing)
    assert again.status is Status.GUESS_FAILED


def test_reversals_keep_the_azimuth_in_its_corridor() -> None:
    # No constant bank angle ends within 4,000 km of this target; the reversals end beside it.
    mission = load_mission("cavh_liu2015")
    corridor = np.radians(20.0)
    guess = constant_bank_guess(mission, ConstantBank(np.radians(-64.0), corridor))
    assert guess is not None
    _, longitude, latitude, speed, _, azimuth, bank = guess.states.T
    assert speed[-1] == pytest.approx(mission.target.speed, rel=1e-6)
    target = (mission.target.longitude, mission.target.latitude)
    miss = great_circle_distance(longitude[-1], latitude[-1], *target, 6.378e6)
    assert miss < 200e3
    far = great_circle_distance(longitude, latitude, *target, 6.378e6) > 2000e3
    off = azimuth - bearing(longitude, latitude, *target)
    inside = np.abs((off + np.pi) % (2.0 * np.pi) - np.pi)[far]
    assert inside.max() < 2.0 * corridor  # the turn goes on while the vehicle rolls
    assert np.count_nonzero(np.diff(np.sign(bank))) >= 2
    assert np.abs(bank).max() <= np.radians(64.0) * (1.0 + 1e-9)


def test_a_guess_beyond_the_bank_limit_is_cut_at_it() -> None:
    # A neighbour with a wider limit: cut, its flight leads on; as it stood, no step led back inside.
    mission = load_mission("shefex3")
    optimum = solve(mission)
    greatest = float(np.abs(optimum.states[6]).max())
    limits = mission.limits.model_copy(update={"bank_angle": greatest - np.radians(2.0)})
    found = solve(mission.model_copy(update={"limits": limits}), guess=optimum)
    assert found.status is Status.SOLVED
    assert np.abs(found.states[6]).max() <= limits.bank_angle + 1e-9
    assert found.cost > optimum.cost
