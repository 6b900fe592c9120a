"""One segment of a mesh, flown on steps that adapt: what mesh refinement looks at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.state import BANK, FLIGHT_PATH_ANGLE
from ampi.propagation.adaptive_step import Accuracy, IntegrationError, Stop, integrate
from ampi.propagation.flight_program import GROUND, STEEPEST
from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.pseudospectral.mesh import Segment

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SegmentFlight:
    """A segment of a mesh flown by c cases; k points."""

    times: Array  # (c, k), s
    states: Array  # (c, 7 or 8, k)
    rates: Array  # (m, c, k), of the angles' polynomials, rad/s

    @property
    def bank_rate(self) -> Array:
        """(c, k), rad/s."""
        return self.rates[0]

    at_nodes: NDArray[np.intp]  # which points are the segment's nodes


def fly_segment(
    model: FlightModel,
    segment: Segment,
    angles: Array,
    state: Array,
    final_time: Array,
    spacing: float,
    accuracy: Accuracy,
) -> SegmentFlight:
    """Fly one segment from `state` (c, 6) under the polynomials through `angles` (m, c, nodes).

    Bank angles and, where they are a state, angles of attack. Its points are the nodes, and others at
    most `spacing` (s) apart.

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
    x = np.empty((BANK + len(angles), cases))

    def rates(at: float, flat: Array) -> Array:
        x[:BANK] = flat.reshape(BANK, cases)
        here = interpolation_matrix(rule.nodes, rule.barycentric, [at])[0]
        for k, nodal in enumerate(angles, BANK):
            x[k] = nodal @ here
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
    begin, stops = state.T.ravel(), [ground, upright]
    flight = integrate(rates, (-1.0, 1.0), begin, accuracy, points=tau, stops=stops, cases=cases)
    if flight.stop is not None:
        where = "under the ground" if flight.stop is ground else "on a vertical path"
        raise IntegrationError(f"the flight ends {where}")
    flown = flight.points.reshape(BANK, cases, len(tau)).transpose(1, 0, 2)
    matrix, slopes = (
        interpolation_matrix(rule.nodes, rule.barycentric, tau),
        rule.derivative_at(tau),
    )
    along = [(nodal @ matrix.T)[:, None, :] for nodal in angles]
    return SegmentFlight(
        times=start[:, None] + half[:, None] * (1.0 + tau),
        states=np.concatenate([flown, *along], axis=1),
        rates=np.stack([nodal @ slopes.T / half[:, None] for nodal in angles]),
        at_nodes=np.searchsorted(tau, rule.nodes),
    )
