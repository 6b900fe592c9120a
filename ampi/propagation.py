"""Is a trajectory true? Its bank angle flown again by an independent integrator.

DOP853 (Hairer, Nørsett, Wanner 1993; scipy) integrates the equations of motion from the same entry
state under the bank-angle polynomial of the optimum, segment by segment, so that no step crosses a
kink of the control. The states are then compared with the collocated ones, and every limit is read
between the nodes, where the optimiser has not looked.

Many trajectories on one mesh are integrated together, vectorised over cases. The step size follows
the root-mean-square error over the batch, so the relative tolerance is set a decade tighter than what
is meant for each case. That leaves the integrator millimetres off after the ten minutes of SHEFEX-3, a
thousandth of what it finds; more digits would cost time and tell nobody anything.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.planet import great_circle_distance
from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.pseudospectral.mesh import Mesh
from ampi.pseudospectral.radau import FlippedRadau
from ampi.trajectory import FlightCheck, Trajectory

Array = NDArray[np.float64]

TOLERANCE = 3e-8  # relative, per case
SIZES = np.array([1e4, 0.1, 0.1, 1e3, 0.01, 0.1])  # m, rad, m/s: what counts as small


class ReintegrationError(RuntimeError):
    """The integrator gave up: nobody flies like this."""


@dataclass(frozen=True)
class Reintegration:
    """Errors of collocated against re-integrated flight, per case; c cases, n nodes."""

    states: Array  # (c, 6, n): re-integrated h, θ, φ, V, γ, ψ at the nodes
    position_error: Array  # (c,), m: greatest over the nodes, horizontal and vertical together
    altitude_error: Array  # (c,), m: greatest over the nodes
    speed_error: Array  # (c,), m/s: greatest over the nodes
    peak: Array  # (c, l): greatest use of each limit (`PathLimits.names`), on the fine grid
    fine_times: Array  # (c, k), s
    fine_states: Array  # (c, 7, k)
    fine_path: Array  # (c, l, k), use of the limits


def reintegrate(mission: Mission, trajectory: Trajectory) -> Reintegration:
    """Re-integrate one trajectory."""
    return reintegrate_many(
        MissionFamily.of([mission]),
        trajectory.mesh,
        trajectory.states[None],
        np.array([trajectory.final_time]),
    )


def flown_again(mission: Mission, trajectory: Trajectory) -> Trajectory:
    """The trajectory with what its own flight found; it is solved if that flight is the same one."""
    if not (trajectory.status.converged and np.all(np.isfinite(trajectory.states))):
        return trajectory
    states, final_time = trajectory.states[None], np.array([trajectory.final_time])
    (flight,) = flight_checks(MissionFamily.of([mission]), trajectory.mesh, states, final_time)
    return trajectory.judged_by(flight)


def flight_checks(
    family: MissionFamily, mesh: Mesh, states: Array, final_time: Array
) -> list[FlightCheck]:
    """Of trajectories `states` (c, 7, n) with `final_time` (c,), each flown again."""
    names = family.path_limits().names
    try:
        with np.errstate(all="ignore"):  # what is nonsense ends as infinite errors
            found = reintegrate_many(family, mesh, states, final_time)
    except ReintegrationError:
        if len(states) == 1:
            return [FlightCheck(np.inf, np.inf, np.inf, dict.fromkeys(names, np.inf))]
        return [
            flight_checks(family.take([k]), mesh, states[[k]], final_time[[k]])[0]
            for k in range(len(states))
        ]
    return [
        FlightCheck(
            float(found.position_error[k]),
            float(found.altitude_error[k]),
            float(found.speed_error[k]),
            dict(zip(names, found.peak[k].tolist(), strict=True)),
        )
        for k in range(len(states))
    ]


def reintegrate_many(
    family: MissionFamily, mesh: Mesh, states: Array, final_time: Array, spacing: float = 1.0
) -> Reintegration:
    """Re-integrate trajectories `states` (c, 7, n) with `final_time` (c,) of a family on one mesh.

    `spacing` (s) is the greatest distance of the points where the limits are read.
    """
    cases = len(states)
    model = family.flight_model()
    state = states[:, :6, 0].T.copy()
    nodes = np.empty((cases, 6, mesh.n_nodes))
    nodes[:, :, 0] = states[:, :6, 0]
    pieces: list[tuple[Array, Array, Array]] = []
    for s in mesh.segments:
        start = s.start[0] + s.start[1] * final_time
        half = s.half_length[0] + s.half_length[1] * final_time
        fine = np.linspace(-1.0, 1.0, int(np.ceil(2.0 * half.max() / spacing)) + 1)
        tau = np.union1d(fine, s.rule.nodes)
        path = _integrate_segment(model, s.rule, states[:, 6, s.nodes], state, start, half, tau)
        nodes[:, :, s.nodes.start + 1 : s.nodes.stop] = path[
            :, :6, np.searchsorted(tau, s.rule.nodes[1:])
        ]
        state = path[:, :6, -1].T.copy()
        rate = states[:, 6, s.nodes] @ s.rule.derivative_at(tau).T / half[:, None]
        pieces.append((start[:, None] + half[:, None] * (1.0 + tau), path, rate))
    times = np.concatenate([t for t, _, _ in pieces], axis=1)
    fine_states = np.concatenate([p for _, p, _ in pieces], axis=2)
    bank_rate = np.concatenate([r for _, _, r in pieces], axis=1)
    over_time = family.flight_model(trailing=1)
    limits = family.path_limits(trailing=1)
    use = limits.use(over_time, fine_states.transpose(1, 0, 2), bank_rate, times)
    fine_path = np.stack(use, axis=1)
    radius = over_time.planet.equatorial_radius
    altitude_error = np.abs(nodes[:, 0] - states[:, 0])
    horizontal = great_circle_distance(states[:, 1], states[:, 2], nodes[:, 1], nodes[:, 2], radius)
    return Reintegration(
        states=nodes,
        position_error=np.hypot(horizontal, altitude_error).max(axis=1),
        altitude_error=altitude_error.max(axis=1),
        speed_error=np.abs(nodes[:, 3] - states[:, 3]).max(axis=1),
        peak=fine_path.max(axis=2),
        fine_times=times,
        fine_states=fine_states,
        fine_path=fine_path,
    )


def _integrate_segment(
    model: FlightModel,
    rule: FlippedRadau,
    bank: Array,
    state: Array,
    start: Array,
    half: Array,
    tau: Array,
) -> Array:
    """States (c, 7, k) at `tau` of one segment, from `state` (6, c)."""
    cases = len(start)
    matrix = interpolation_matrix(rule.nodes, rule.barycentric, tau)

    x = np.empty((7, cases))

    def rates(at: float, flat: Array) -> Array:
        x[:6] = flat.reshape(6, cases)
        x[6] = bank @ interpolation_matrix(rule.nodes, rule.barycentric, [at])[0]
        dx = equations_of_motion(model, x, 0.0, start + half * (1.0 + at))
        found = np.empty((6, cases))
        for row, rate in zip(found, dx[:6], strict=True):
            np.multiply(half, rate, out=row)
        return found.ravel()

    solution = solve_ivp(
        rates,
        (-1.0, 1.0),
        state.ravel(),
        method="DOP853",
        t_eval=tau,
        rtol=0.1 * TOLERANCE,
        atol=np.repeat(0.1 * TOLERANCE * SIZES, cases),
    )
    if not solution.success:
        raise ReintegrationError(f"re-integration: {solution.message}")
    flown = solution.y.reshape(6, cases, len(tau)).transpose(1, 0, 2)
    return np.concatenate([flown, (bank @ matrix.T)[:, None, :]], axis=1)
