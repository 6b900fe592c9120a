"""Is a trajectory true? Its bank angle flown again by an independent integrator.

DOP853 (Hairer, Nørsett, Wanner 1993; scipy) integrates the equations of motion from the same entry
state under the bank-angle polynomial of the optimum, segment by segment, so that no step crosses a
kink of the control. The states are then compared with the collocated ones, and every limit is read
between the nodes, where the optimiser has not looked.

Many trajectories on one mesh are integrated together, vectorised over cases. The step size follows
the root-mean-square error over the batch, so the relative tolerance is set a decade tighter than what
is meant for each case, 3e-8. That leaves the integrator millimetres off after the ten minutes of
SHEFEX-3, a thousandth of what it finds; more digits would cost time and tell nobody anything.

A flight ends at `GROUND`: below it the air grows denser, and the steps shorter, without end. So it does
where the path is vertical, and the equations of motion have no azimuth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import (
    ALTITUDE,
    BANK,
    FLIGHT_PATH_ANGLE,
    LATITUDE,
    LONGITUDE,
    N_STATES,
    SPEED,
)
from ampi.propagation.adaptive_step import Accuracy, IntegrationError, Stop, integrate
from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.pseudospectral.mesh import Mesh, Segment
from ampi.trajectory import FlightCheck, Trajectory

Array = NDArray[np.float64]

ACCURACY = Accuracy(relative=0.1 * 3e-8)
GROUND = -1e3  # m: a target may lie a little under the sea
STEEPEST = float(np.radians(89.5))


@dataclass(frozen=True)
class Reintegration:
    """Errors of collocated against re-integrated flight, per case; c cases, n nodes."""

    states: Array  # (c, 6, n): h, θ, φ, V, γ, ψ at the nodes, as flown
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
    family: MissionFamily, mesh: Mesh, states: Array, final_time: Array, spacing: float = 1.0
) -> list[FlightCheck]:
    """Of trajectories `states` (c, 7, n) with `final_time` (c,), each flown again.

    Errors are infinite for one that cannot be flown to its end. `spacing`: see `reintegrate_many`.
    """
    names = family.path_limits().names
    try:
        with np.errstate(all="ignore"):  # what is nonsense ends as infinite errors
            found = reintegrate_many(family, mesh, states, final_time, spacing)
    except IntegrationError:
        if len(states) == 1:
            return [FlightCheck(np.inf, np.inf, np.inf, dict.fromkeys(names, np.inf))]
        parts = np.array_split(np.arange(len(states)), 2)  # one of them stops all
        return [
            check
            for part in parts
            for check in flight_checks(
                family.take(part), mesh, states[part], final_time[part], spacing
            )
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

    Raises
    ------
    IntegrationError
        If one of them cannot be flown to its end.
    """
    model = family.flight_model()
    state = states[:, :BANK, 0]
    nodes = np.empty((len(states), BANK, mesh.n_nodes))
    nodes[:, :, 0] = state
    pieces: list[SegmentFlight] = []
    for s in mesh.segments:
        piece = fly_segment(
            model, s, states[:, BANK, s.nodes], state, final_time, spacing, ACCURACY
        )
        nodes[:, :, s.nodes.start + 1 : s.nodes.stop] = piece.states[:, :BANK, piece.at_nodes[1:]]
        state = piece.states[:, :BANK, -1]
        pieces.append(piece)
    times = np.concatenate([piece.times for piece in pieces], axis=1)
    fine_states = np.concatenate([piece.states for piece in pieces], axis=2)
    bank_rate = np.concatenate([piece.bank_rate for piece in pieces], axis=1)
    over_time = family.flight_model(trailing=1)
    limits = family.path_limits(trailing=1)
    use = limits.use(over_time, fine_states.transpose(1, 0, 2), bank_rate, times)
    fine_path = np.stack(use, axis=1)
    radius = over_time.planet.equatorial_radius
    altitude_error = np.abs(nodes[:, ALTITUDE] - states[:, ALTITUDE])
    horizontal = great_circle_distance(
        states[:, LONGITUDE], states[:, LATITUDE], nodes[:, LONGITUDE], nodes[:, LATITUDE], radius
    )
    return Reintegration(
        states=nodes,
        position_error=np.hypot(horizontal, altitude_error).max(axis=1),
        altitude_error=altitude_error.max(axis=1),
        speed_error=np.abs(nodes[:, SPEED] - states[:, SPEED]).max(axis=1),
        peak=fine_path.max(axis=2),
        fine_times=times,
        fine_states=fine_states,
        fine_path=fine_path,
    )


@dataclass(frozen=True, eq=False)
class SegmentFlight:
    """A segment of a mesh flown by c cases; k points."""

    times: Array  # (c, k), s
    states: Array  # (c, 7, k)
    bank_rate: Array  # (c, k), of the bank-angle polynomials, rad/s
    at_nodes: NDArray[np.intp]  # which points are the segment's nodes


def fly_segment(
    model: FlightModel,
    segment: Segment,
    bank: Array,
    state: Array,
    final_time: Array,
    spacing: float,
    accuracy: Accuracy,
) -> SegmentFlight:
    """Fly one segment from `state` (c, 6) under the polynomials through `bank` (c, nodes).

    Its points are the nodes, and others at most `spacing` (s) apart.

    Raises
    ------
    IntegrationError
        If one case reaches the ground or a vertical path, or no step is small enough.
    """
    rule, cases = segment.rule, len(state)
    start = segment.start[0] + segment.start[1] * final_time
    half = segment.half_length[0] + segment.half_length[1] * final_time
    fine = np.linspace(-1.0, 1.0, int(np.ceil(2.0 * half.max() / spacing)) + 1)
    tau = np.union1d(fine, rule.nodes)
    x = np.empty((N_STATES, cases))

    def rates(at: float, flat: Array) -> Array:
        x[:BANK] = flat.reshape(BANK, cases)
        x[BANK] = bank @ interpolation_matrix(rule.nodes, rule.barycentric, [at])[0]
        dx = equations_of_motion(model, x, 0.0, start + half * (1.0 + at))
        found = np.empty((BANK, cases))
        for row, rate in zip(found, dx[:BANK], strict=True):
            np.multiply(half, rate, out=row)
        return found.ravel()

    def steepest(at: float, flat: Array) -> float:
        path_angle = flat[FLIGHT_PATH_ANGLE * cases : (FLIGHT_PATH_ANGLE + 1) * cases]
        return float(np.abs(path_angle).max()) - STEEPEST

    ground = Stop(lambda at, flat: float(flat[:cases].min()) - GROUND, direction=-1.0)
    upright = Stop(steepest, direction=1.0)
    flight = integrate(
        rates,
        (-1.0, 1.0),
        state.T.ravel(),
        accuracy,
        points=tau,
        stops=[ground, upright],
        cases=cases,
    )
    if flight.stop is not None:
        where = "under the ground" if flight.stop is ground else "on a vertical path"
        raise IntegrationError(f"the flight ends {where}")
    flown = flight.points.reshape(BANK, cases, len(tau)).transpose(1, 0, 2)
    along = bank @ interpolation_matrix(rule.nodes, rule.barycentric, tau).T
    return SegmentFlight(
        times=start[:, None] + half[:, None] * (1.0 + tau),
        states=np.concatenate([flown, along[:, None, :]], axis=1),
        bank_rate=bank @ rule.derivative_at(tau).T / half[:, None],
        at_nodes=np.searchsorted(tau, rule.nodes),
    )
