"""A bank profile flown from any entry state to a speed: what a reference is worth without a tracker.

The profile is the bank-angle polynomial of a mesh, held where it ends, and that of the angle of attack
where it is a state; DOP853 integrates segment by
segment, so that no step crosses a kink. The flight ends where the speed falls through its target, found
between points a second apart by the cubic through states and rates: millimetres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.state import BANK, SPEED
from ampi.propagation.adaptive_step import Accuracy
from ampi.propagation.segment_flight import SegmentFlight, fly_segment
from ampi.pseudospectral.mesh import Mesh, Segment
from ampi.pseudospectral.radau import flipped_radau

Array = NDArray[np.float64]

ACCURACY = Accuracy(relative=1e-9)
SPACING = 1.0  # s, between the points where the speed is read
HALVINGS = 40  # of the bracket: to rounding


def fly_to_speed(
    model: FlightModel,
    mesh: Mesh,
    angles: Array,
    entry_states: Array,
    final_time: Array,
    speed: Array,
    longer: float,
) -> Array:
    """States (c, 6) where c flights pass `speed` (c,) downwards; NaN of one that does not.

    Parameters
    ----------
    model
        Of one vehicle, or with numbers (c,).
    angles
        Nodal bank angles (c, n), rad; with the angles of attack, where those are a state, (c, 2, n).
    entry_states
        (c, 6): h, θ, φ, V, γ, ψ.
    final_time
        Of the profiles (c,), s.
    longer
        How long (s) a flight may go on after its profile, at the last angles.

    Raises
    ------
    IntegrationError
        If one flight reaches the ground or a vertical path.
    """
    found = np.full((len(angles), BANK), np.nan)
    state, profiles = entry_states, np.moveaxis(angles.reshape(len(angles), -1, mesh.n_nodes), 1, 0)
    for segment, nodal in _parts(mesh, profiles, longer):
        flight = fly_segment(model, segment, nodal, state, final_time, SPACING, ACCURACY)
        _read(model, flight, speed, found)
        state = flight.states[:, :BANK, -1]
        if not np.isnan(found).any():
            break
    return found


def _parts(mesh: Mesh, angles: Array, longer: float) -> list[tuple[Segment, Array]]:
    """The segments with their nodal angles (m, c, nodes), and the one in which the last are held."""
    parts = [(segment, angles[..., segment.nodes]) for segment in mesh.segments]
    held = Segment(mesh.n_nodes - 1, flipped_radau(1), (0.0, 1.0), (0.5 * longer, 0.0))
    return [*parts, (held, angles[..., [-1, -1]])]


def _read(model: FlightModel, flight: SegmentFlight, speed: Array, found: Array) -> None:
    """Fill `found` for the flights that pass their speed in this one."""
    fast = flight.states[:, SPEED] > speed[:, None]
    passes = fast[:, :-1] & ~fast[:, 1:]
    open_ = np.isnan(found[:, 0]) & passes.any(axis=1)
    at, cases = np.argmax(passes, axis=1), np.arange(len(speed))
    ends = []
    for k in (at, at + 1):
        state, time = flight.states[cases, :, k].T, flight.times[cases, k]
        rates = np.stack(np.broadcast_arrays(*equations_of_motion(model, state, 0.0, time)))
        ends.append((state[:BANK], rates[:BANK], time))
    found[open_] = _crossing(ends[0], ends[1], speed).T[open_]


def _crossing(
    begin: tuple[Array, Array, Array], end: tuple[Array, Array, Array], speed: Array
) -> Array:
    """States (6, c) where the cubic between two points passes `speed`, by bisection."""
    (x0, dx0, t0), (x1, dx1, t1) = begin, end
    step, low, high = t1 - t0, np.zeros_like(speed), np.ones_like(speed)

    def cubic(s: Array) -> Array:
        rest = 1.0 - s
        return rest * rest * (x0 * (1.0 + 2.0 * s) + dx0 * (step * s)) + s * s * (
            x1 * (3.0 - 2.0 * s) - dx1 * (step * rest)
        )

    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = cubic(middle)[SPEED] > speed
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return cubic(0.5 * (low + high))
