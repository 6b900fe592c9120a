"""Re-integration against a plain solve_ivp of one case, and as a detector of false trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator

from ampi.dataset import TrajectoryDataset
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import LOADS
from ampi.propagation import flight_program
from ampi.propagation.adaptive_step import IntegrationError
from ampi.propagation.reintegration import flight_checks, reintegrate, reintegrate_many
from ampi.pseudospectral.mesh import Mesh
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]


def plainly_integrated(mission: Mission, trajectory: Trajectory) -> Array:
    """States (6, n) at the nodes: DOP853 over physical time under the bank-angle polynomials."""
    times, states = trajectory.times, trajectory.states
    out = np.empty((6, len(times)))
    out[:, 0] = states[:6, 0]
    for segment in trajectory.mesh.segments:
        t = times[segment.nodes]
        bank = BarycentricInterpolator(t, states[6, segment.nodes])

        def f(at: float, x: Array, bank: BarycentricInterpolator = bank) -> Array:
            seven = [*x, float(bank(at))]
            rates = equations_of_motion(mission.flight_model, seven, 0.0, at)
            return np.array(rates[:6], dtype=float)

        begin = out[:, segment.first_node]
        solution = solve_ivp(
            f,
            (t[0], t[-1]),
            begin,
            method="DOP853",
            t_eval=t,
            rtol=1e-11,
            atol=[1e-6, 1e-13, 1e-13, 1e-8, 1e-13, 1e-13],
        )
        assert solution.success
        out[:, segment.nodes] = solution.y
    return out


@pytest.mark.parametrize("case", [0, 4, 8])
def test_reintegration_agrees_with_a_plain_integration(
    mission: Mission, dataset: TrajectoryDataset, case: int
) -> None:
    trajectory = dataset.trajectory(case)
    witness = plainly_integrated(mission, trajectory)
    check = reintegrate(mission, trajectory)
    difference = np.abs(check.states[0] - witness).max(axis=1)
    assert np.all(difference < [2e-3, 6e-10, 6e-10, 1e-4, 1e-8, 1e-8])  # 4 mm, 0.1 mm/s
    off = trajectory.states[:6] - witness
    radius = mission.flight_model.planet.equatorial_radius
    flat = radius * np.hypot(off[1] * np.cos(witness[2]), off[2])
    assert check.position_error[0] == pytest.approx(np.hypot(flat, off[0]).max(), abs=4e-3)
    assert check.altitude_error[0] == pytest.approx(np.abs(off[0]).max(), abs=1e-3)
    assert check.speed_error[0] == pytest.approx(np.abs(off[3]).max(), abs=1e-4)
    assert check.position_error[0] < 3.0  # m, the claim of the mission file


def test_many_cases_together_are_the_cases_alone(
    mission: Mission, dataset: TrajectoryDataset
) -> None:
    """To millimetres, although the step size follows the batch."""
    trajectories = [dataset.trajectory(case) for case in range(9)]
    together = reintegrate_many(
        MissionFamily.of([mission] * 9),
        trajectories[0].mesh,
        np.stack([t.states for t in trajectories]),
        np.array([t.final_time for t in trajectories]),
    )
    for i, trajectory in enumerate(trajectories):
        alone = reintegrate(mission, trajectory)
        difference = np.abs(together.states[i] - alone.states[0]).max(axis=1)
        assert np.all(difference < [2e-3, 6e-10, 6e-10, 1e-4, 1e-8, 1e-8])
        assert together.peak[i] == pytest.approx(alone.peak[0], rel=1e-3)
        assert together.position_error[i] == pytest.approx(
            float(dataset.position_error.ravel()[i]), abs=4e-3
        )


def test_a_false_trajectory_is_found_out(mission: Mission, dataset: TrajectoryDataset) -> None:
    """10 m of altitude at one node, and a bank angle that was not flown."""
    truth = dataset.trajectory(4)
    base = reintegrate(mission, truth)
    states = truth.states.copy()
    states[0, 30] += 10.0
    moved = reintegrate(mission, replace(truth, states=states))
    assert moved.altitude_error[0] == pytest.approx(10.0, abs=3.0)
    assert np.array_equal(moved.states, base.states)
    states = truth.states.copy()
    states[6] += np.radians(0.5)
    assert reintegrate(mission, replace(truth, states=states)).position_error[0] > 500.0


def test_peaks_are_read_between_the_nodes(mission: Mission, dataset: TrajectoryDataset) -> None:
    trajectory = dataset.trajectory(2)
    check = reintegrate(mission, trajectory)
    times, states = check.fine_times[0], check.fine_states[0]
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(trajectory.final_time, rel=1e-14)
    assert np.diff(times).max() <= 1.0 + 1e-9
    assert np.all(np.diff(times) >= -1e-12)
    expected, _ = trajectory.at(times)
    assert states[6] == pytest.approx(expected[6], abs=1e-10)
    limits = mission.limits
    assert PathLimits.of(mission).names == (*LOADS, "bank_angle", "bank_rate")
    apart = np.diff(times) > 0.1  # segments share their ends
    bank_rate = np.diff(states[6])[apart] / np.diff(times)[apart]

    def used(states: Array, bank_rate: Array, times: Array) -> Array:
        loads = path_constraints(mission.flight_model, states, times)
        over = (limits.dynamic_pressure, limits.heat_flux, limits.load_factor)
        used = [load.max() / most for load, most in zip(loads, over, strict=True)]
        bank = np.abs(states[6]).max() / limits.bank_angle
        return np.array([*used, bank, np.abs(bank_rate).max() / limits.bank_rate])

    expected = used(states, bank_rate, times)
    assert check.peak[0, :4] == pytest.approx(expected[:4], rel=1e-12)
    assert check.peak[0, 4] == pytest.approx(expected[4], abs=0.02)
    nodal = used(trajectory.states, trajectory.bank_rate, trajectory.times)
    assert np.all(check.peak[0] >= nodal - 1e-3)


def test_the_spacing_is_the_callers(mission: Mission, dataset: TrajectoryDataset) -> None:
    trajectory = dataset.trajectory(4)
    arguments = (trajectory.mesh, trajectory.states[None], np.array([trajectory.final_time]))
    coarse = reintegrate_many(MissionFamily.of([mission]), *arguments, spacing=50.0)
    fine = reintegrate_many(MissionFamily.of([mission]), *arguments, spacing=0.5)
    assert np.diff(fine.fine_times).max() <= 0.5 + 1e-9
    assert coarse.fine_times.shape[1] < fine.fine_times.shape[1]
    assert np.all(fine.peak >= coarse.peak - 1e-6)
    assert coarse.position_error == pytest.approx(fine.position_error, abs=1e-2)


@pytest.mark.parametrize(
    ("bank_angle", "where"), [(80.0, "under the ground"), (150.0, "on a vertical path")]
)
def test_a_flight_into_the_ground_ends_there(
    mission: Mission,
    dataset: TrajectoryDataset,
    monkeypatch: pytest.MonkeyPatch,
    bank_angle: float,
    where: str,
) -> None:
    """No step is made shorter because the rock grows denser, and its company flies on."""
    truth = dataset.trajectory(4)
    halvings, steps_on = list[int](), flight_program.steps_on

    def counted(mesh: Mesh, horizon: float, halved: int) -> flight_program.Steps:
        halvings.append(halved)
        return steps_on(mesh, horizon, halved)

    monkeypatch.setattr(flight_program, "steps_on", counted)
    states = truth.states.copy()
    states[6] = np.radians(bank_angle)
    with pytest.raises(IntegrationError, match=f"^the flight ends {where}$"):
        reintegrate(mission, replace(truth, states=states))
    assert len(halvings) <= flight_program.MOST_HALVINGS
    company = np.stack([truth.states, states, truth.states])
    family = MissionFamily.of([mission] * 3)
    found = flight_checks(family, truth.mesh, company, np.full(3, truth.final_time))
    assert np.isinf(found[1].position_error)
    assert found[0].position_error == pytest.approx(found[2].position_error, abs=1e-3)
    assert found[0].position_error < 3.0
