"""Tracking gains against an independent Riccati integration, and what they are for."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import ampi.tracker_design.riccati_gains
from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.simulation.closed_loop import fly_batch
from ampi.simulation.plant import FlightStatus
from ampi.tracing.dynamics import Physics, node_dynamics
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracker_design.riccati_gains import GainSettings, vertex_gains
from ampi.trajectory import Trajectory
from tests.support.truths import nominal_truth

Array = NDArray[np.float64]


def terminal_weight(mission: Mission, final: Array, final_time: float) -> Array:
    """S_f = Πᵀ W Π with Π = I − ẋ_f e_Vᵀ / V̇_f, which is Eq. (2), for the default sizes."""
    rate = np.array(equations_of_motion(mission.flight_model, final, 0.0, final_time), dtype=float)
    e_speed = np.eye(7)[3]
    projection = np.eye(7) - np.outer(rate, e_speed) / rate[3]
    radius = mission.flight_model.planet.equatorial_radius
    settings = GainSettings()
    east, north = radius * np.cos(final[2]), radius
    weight = np.zeros((7, 7))
    weight[0, 0] = settings.altitude_error**-2
    weight[1, 1] = (east / settings.horizontal_miss) ** 2
    weight[2, 2] = (north / settings.horizontal_miss) ** 2
    return projection.T @ weight @ projection


@pytest.fixture(scope="module")
def witness(mission: Mission, nominal: Trajectory) -> Array:
    """K (7, n) at the nodes from −Ṡ = AᵀS + SA + Q − SBR⁻¹BᵀS, by DOP853, segment by segment.

    Both running weights of Eq. (1) are meant over the whole flight: divided by t_f.
    """
    settings, t_f, mesh = GainSettings(), nominal.final_time, nominal.mesh
    inverse_r = settings.bank_rate**2 * t_f
    q = np.zeros((7, 7))
    q[6, 6] = 1.0 / (settings.bank_deviation**2 * t_f)
    physics = Physics.of(mission.flight_model, NodeFunctions(), 1.0)
    dynamics = node_dynamics(physics.structure, (1.0,) * 7).jacobian

    def backward(t: float, flat: Array) -> Array:
        s = flat.reshape(7, 7)
        x, _ = nominal.at(t)
        at = (x[:, :, None], np.zeros((1, 1)), np.array([[t]]))
        (found,) = dynamics.one_by_one(*at, physics.numbers)
        a = np.zeros((7, 7))
        for (row, column), value in zip(dynamics.nonzeros[0], found[:, 0, 0], strict=True):
            a[row, column] = value
        return -(a.T @ s + s @ a + q - inverse_r * np.outer(s[:, 6], s[6])).ravel()

    gains = np.empty((7, mesh.n_nodes))
    cost = terminal_weight(mission, nominal.states[:, -1], t_f)
    gains[:, -1] = inverse_r * cost[6]
    size = np.abs(cost).max()
    for segment in reversed(mesh.segments):
        times = nominal.times[segment.nodes][::-1]
        solution = solve_ivp(
            backward,
            (times[0], times[-1]),
            cost.ravel(),
            method="DOP853",
            t_eval=times,
            rtol=1e-7,
            atol=1e-14 * size,
        )
        assert solution.success
        found = solution.y.reshape(7, 7, -1)
        gains[:, segment.nodes] = inverse_r * found[6, :, ::-1]
        cost = found[:, :, -1]
    return gains


def deviations(got: Array, witness: Array) -> Array:
    """Greatest difference of each row over the greatest gain of that row."""
    return np.abs(got - witness).max(axis=1) / np.abs(witness).max(axis=1)


def gains_with_step(
    mission: Mission,
    nominal: Trajectory,
    monkeypatch: pytest.MonkeyPatch,
    step: float,
    settings: GainSettings | None = None,
) -> Array:
    monkeypatch.setattr(ampi.tracker_design.riccati_gains, "STEP", step)
    final_time = np.array([nominal.final_time])
    settings = settings or GainSettings()
    return vertex_gains(
        MissionFamily.of([mission]), nominal.mesh, nominal.states[None], final_time, settings
    )[0]


def test_gains_are_those_of_the_riccati_equation(gains: Array, witness: Array) -> None:
    """The sweep in four states against all seven, within what its steps cost; see the next test."""
    assert np.all(deviations(gains, witness) < 0.02)


def test_the_difference_shrinks_with_the_square_of_the_step(
    mission: Mission, nominal: Trajectory, witness: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Down to the few thousandths that interpolating the Jacobians between the nodes costs."""
    coarse, middle, fine = (
        deviations(gains_with_step(mission, nominal, monkeypatch, step), witness)
        for step in (4.0, 2.0, 0.25)
    )
    assert np.all(coarse > 0.01)
    assert np.all(middle < 0.5 * coarse)
    assert np.all(fine < 0.005)


def test_sharp_weights_do_not_outrun_the_step(
    mission: Mission, nominal: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With gains of several per second an explicit method would be unstable at these steps."""
    sharp = GainSettings(horizontal_miss=5.0, altitude_error=2.0, bank_rate=0.1)
    coarse, fine = (
        gains_with_step(mission, nominal, monkeypatch, step, sharp) for step in (3.0, 0.1)
    )
    assert fine[6].max() > 1.0
    assert np.all((coarse[6, :-1] > 0.0) & (coarse[6, :-1] < 2.0 * fine[6].max()))


def test_equal_cases_have_equal_gains(mission: Mission, nominal: Trajectory, gains: Array) -> None:
    states = np.repeat(nominal.states[None], 3, axis=0)
    final_time = np.full(3, nominal.final_time)
    batch = vertex_gains(
        MissionFamily.of([mission] * 3), nominal.mesh, states, final_time, GainSettings()
    )
    for one in batch:
        assert one == pytest.approx(gains, rel=1e-9, abs=1e-12 * np.abs(gains).max())


def test_gains_do_not_depend_on_the_company(
    mission: Mission, nominal: Trajectory, gains: Array
) -> None:
    """A flight swept with longer and shorter ones has the gains that it has alone."""
    final_time = nominal.final_time * np.array([1.0, 0.8, 1.02, 1.4])
    states = np.repeat(nominal.states[None], 4, axis=0)
    family = MissionFamily.of([mission] * 4)
    batch = vertex_gains(family, nominal.mesh, states, final_time, GainSettings())
    assert batch[0] == pytest.approx(gains, rel=1e-9, abs=1e-12 * np.abs(gains).max())


def test_a_dearer_bank_rate_means_smaller_gains(
    mission: Mission, nominal: Trajectory, gains: Array
) -> None:
    cheap, dear = (
        vertex_gains(
            MissionFamily.of([mission]),
            nominal.mesh,
            nominal.states[None],
            np.array([nominal.final_time]),
            GainSettings(bank_rate=GainSettings().bank_rate * factor),
        )[0]
        for factor in (2.0, 0.5)
    )
    for row in range(7):
        sizes = [float(np.abs(k[row]).max()) for k in (dear, gains, cheap)]
        assert sizes[0] < sizes[1] < sizes[2]


# One percent to a tenth of the half-widths of Eq. (34)
PERTURBATIONS = np.diag([25.0, 5e-4, 5e-4, 5.0, 5e-4, 8e-4])


def test_a_neighbouring_entry_is_brought_back_to_the_target(
    mission: Mission, tracked: Guidance, untracked: Guidance
) -> None:
    entries = mission.entry_state + np.vstack([PERTURBATIONS, -PERTURBATIONS])
    misses = []
    for guidance in (tracked, untracked):
        batch = fly_batch(mission.family(entries), guidance, nominal_truth(entries))
        assert np.all(batch.status == int(FlightStatus.REACHED_SPEED))
        final = batch.final_states
        assert final[:, 3] == pytest.approx(np.full(12, mission.target.speed), abs=1e-3)
        radius = mission.flight_model.planet.equatorial_radius
        north = radius * (final[:, 2] - mission.target.latitude)
        east = radius * np.cos(mission.target.latitude) * (final[:, 1] - mission.target.longitude)
        misses.append(np.hypot(north, east))
    closed, opened = misses
    assert np.all(opened > 500.0)
    assert np.all(closed < 0.05 * opened)


def test_the_nominal_entry_flies_its_optimum(mission: Mission, tracked: Guidance) -> None:
    entry = mission.entry_state[None]
    batch = fly_batch(mission.family(entry), tracked, nominal_truth(entry))
    error = batch.states - batch.reference_states
    assert np.nanmax(np.abs(error[0, 0])) < 10.0  # m
    assert np.nanmax(np.abs(error[0, 3])) < 1.0  # m/s
    assert np.degrees(np.nanmax(np.abs(error[0, 6]))) < 1.0
