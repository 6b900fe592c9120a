"""The angle of attack as a second control of the tracker: Eq. (4) of `riccati_gains`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import BANK
from ampi.pseudospectral.mesh import Mesh, Segment

Array = NDArray[np.float64]

STEP = 1e-30  # of a complex step: no difference is taken, so it may be that small


@dataclass(frozen=True, eq=False)
class Push:
    """What the angle does to the predicted miss y, and what that costs."""

    effect: Array  # d, (3, c)
    weight: Array  # R_α, (c,)

    def controlled(self, cost: Array, dt: Array) -> Array:
        """S (4, 4, c) before `dt` (s) of this control alone: the exact flow of −Ṡ = −S d dᵀ S / R_α."""
        row = self._over_miss(cost)
        whole = (row[:3] * self.effect).sum(axis=0)
        found: Array = cost - row[:, None] * (row * (dt / (self.weight + dt * whole)))
        return found

    def gain(self, cost: Array) -> Array:
        """dᵀS/R_α, (4, c)."""
        return self._over_miss(cost) / self.weight

    def _over_miss(self, cost: Array) -> Array:
        found: Array = (cost[:3] * self.effect[:, None]).sum(axis=0)
        return found


@dataclass(frozen=True, eq=False)
class SecondControl:
    """The angle of attack along the optima of c cases."""

    mesh: Mesh
    final_time: Array  # (c,), s
    effect: Array  # A_zα at the nodes, (c, n, 6)
    weight: Array  # R_α long before the end, (c,)
    last_seconds: float  # T, s

    def over_step(self, segment: Segment, tau: float, effect: Array) -> Push:
        """Of a step around τ of a segment, where it moves y by `effect` (3, c)."""
        fixed = segment.start[0] + segment.half_length[0] * (1.0 + tau)
        free = segment.start[1] + segment.half_length[1] * (1.0 + tau)
        return self._at(fixed, free, effect)

    def at_node(self, node: int, miss: Array) -> Push:
        """At a node but the last, with Λ (c, 6, 3) there."""
        fixed, free = (float(part[node]) for part in self.mesh.node_time)
        return self._at(fixed, free, (self.effect[:, node, None] @ miss)[:, 0].T)

    def _at(self, fixed: float, free: float, effect: Array) -> Push:
        to_go = self.final_time - (fixed + free * self.final_time)
        return Push(effect, self.weight * (1.0 + (self.last_seconds / to_go) ** 2))


def angle_of_attack_effect(
    family: MissionFamily, mesh: Mesh, states: Array, final_time: Array
) -> Array:
    """A_zα at the nodes, (c, n, 6): how the rates of the first six states change with the angle.

    Of trajectories `states` (c, 7 or 8, n; SI, rad), by a complex step in an offset of the angle: the
    same for a schedule and for a state.
    """
    fixed, free = mesh.node_time
    model = replace(family.flight_model(trailing=1), angle_of_attack_offset=STEP * 1j)
    times = fixed + free * final_time[:, None]
    rates = equations_of_motion(model, np.moveaxis(states, 1, 0), 0.0, times)
    moved = [np.broadcast_to(np.imag(rate), times.shape) for rate in rates[:BANK]]
    return np.stack(moved, axis=-1) / STEP
