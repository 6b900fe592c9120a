"""Is a trajectory true? Its bank angle flown again by an independent integrator.

DOP853 (flight_program) integrates the equations of motion from the same entry state under the
bank-angle polynomial of the optimum, and under that of the angle of attack where it is a state. The
states are then compared with the collocated ones, and every limit is read between the nodes, where the
optimiser has not looked.

The tolerance leaves the integrator micrometres off after the ten minutes of SHEFEX-3.

A flight ends at the ground: below it the air grows denser, and the steps shorter, without end. So it
does where the path is vertical, and the equations of motion have no azimuth.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import (
    ALTITUDE,
    BANK,
    LATITUDE,
    LONGITUDE,
    SPEED,
    STEERING,
)
from ampi.propagation.adaptive_step import Accuracy, IntegrationError
from ampi.propagation.flight_program import HORIZON, Flown, fly, fly_together
from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.pseudospectral.mesh import Mesh
from ampi.tracing.dynamics import Physics
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracing.numbers import Numbers, at_cases
from ampi.trajectory import FlightCheck, Trajectory

Array = NDArray[np.float64]

ACCURACY = Accuracy(relative=3e-6)  # of the scheme's estimate, which is far above its error
MANY = 160  # flights: the calls of ufuncs are then worth their while


@dataclass(frozen=True)
class Reintegration:
    """Errors of collocated against re-integrated flight, per case; c cases, n nodes."""

    states: Array  # (c, 6, n): h, θ, φ, V, γ, ψ at the nodes, as flown
    position_error: Array  # (c,), m: greatest over the nodes, horizontal and vertical together
    altitude_error: Array  # (c,), m: greatest over the nodes
    speed_error: Array  # (c,), m/s: greatest over the nodes
    peak: Array  # (c, l): greatest use of each limit (`PathLimits.names`), on the fine grid
    fine_times: Array  # (c, k), s
    fine_states: Array  # (c, 7 or 8, k)
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
    """Of trajectories `states` (c, 7 or 8, n) with `final_time` (c,), each flown again.

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
    """Re-integrate trajectories `states` (c, 7 or 8, n), `final_time` (c,) of a family on one mesh.

    `spacing` (s) is the greatest distance of the points where the limits are read.

    Raises
    ------
    IntegrationError
        If one of them cannot be flown to its end.
    """
    physics = Physics.of(family.flight_model(), NodeFunctions(), 1.0)
    points = points_on(mesh, float(final_time.max()), spacing)
    times = points.time[0] + points.time[1] * final_time[:, None]
    fine_states = states @ points.values.T
    half = points.half[0] + points.half[1] * final_time[:, None]
    rates = [angle @ points.slopes.T / half for angle in states[:, BANK:].swapaxes(0, 1)]
    nodes = np.empty((len(states), BANK, mesh.n_nodes))
    flights = (physics.structure, physics.numbers, mesh, states, final_time, ACCURACY)
    for case, flown in enumerate(_flown(*flights)):
        nodes[case] = flown.states[:, flown.at_nodes]
        # the polynomials are smooth between the ends of steps, and so is what they miss
        for state, missed in zip(fine_states[case], flown.deviation, strict=False):
            state += np.interp(times[case], flown.times, missed)
    over_time = family.flight_model(trailing=1)
    limits = family.path_limits(trailing=1)
    steering = dict(zip(STEERING, rates, strict=False))
    use = limits.use(over_time, fine_states.transpose(1, 0, 2), time=times, **steering)
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


def _flown(
    structure: Hashable,
    numbers: Numbers,
    mesh: Mesh,
    states: Array,
    final_time: Array,
    accuracy: Accuracy,
) -> list[Flown]:
    """A few are flown one after the other, many together: whichever is faster."""
    if len(states) >= MANY:
        return fly_together(structure, numbers, mesh, states, final_time, accuracy)
    return [
        fly(structure, at_cases(numbers, case), mesh, states[case], duration, accuracy)
        for case, duration in enumerate(final_time.tolist())
    ]


@dataclass(frozen=True, eq=False)
class _Points:
    """Points on a mesh where the limits are read; times are a + b t_f."""

    time: tuple[Array, Array]  # (a, b), (k,) each
    half: tuple[Array, Array]  # half-lengths of their segments
    values: Array  # from nodal values to those at the points, (k, n)
    slopes: Array  # to their derivatives over τ, (k, n)


@lru_cache(maxsize=16)
def points_on(mesh: Mesh, longest: float, spacing: float) -> _Points:
    """The nodes, and others at most `spacing` (s) apart in a flight of `longest` (s).

    Of a smaller spacing they contain those of a greater one: who looks closer sees no less.
    """
    horizon = HORIZON * np.ceil(longest / HORIZON)  # so that there are few grids
    times, halves, values, slopes = [], [], [], []
    for s in mesh.segments:
        half = np.array(s.half_length)
        gaps = 2.0 * (half[0] + half[1] * horizon) / spacing
        count = 2 ** int(np.ceil(np.log2(max(1.0, gaps))))  # no other points for a spacing of ∞
        tau = np.union1d(np.linspace(-1.0, 1.0, count + 1), s.rule.nodes)
        rows = np.zeros((2, len(tau), mesh.n_nodes))
        rows[0][:, s.nodes] = interpolation_matrix(s.rule.nodes, s.rule.barycentric, tau)
        rows[1][:, s.nodes] = s.rule.derivative_at(tau)
        times.append(np.array(s.start)[:, None] + half[:, None] * (1.0 + tau))
        halves.append(np.repeat(half[:, None], len(tau), axis=1))
        values.append(rows[0])
        slopes.append(rows[1])
    time, lengths = np.concatenate(times, axis=1), np.concatenate(halves, axis=1)
    return _Points(
        (time[0], time[1]),
        (lengths[0], lengths[1]),
        np.concatenate(values),
        np.concatenate(slopes),
    )
