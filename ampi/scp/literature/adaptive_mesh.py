"""Mesh adapted inside the iteration by local error: Zhou et al. 2021, Section 3.2.

The flight between neighbouring nodes is integrated by one Runge–Kutta step of the nonlinear dynamics
from the node before, under the linearly interpolated control (Eq. 40); the distance from the node's
own state is its local error (Eq. 39):

    Δ_j = ‖x_j − x̄_j‖₂,   x̄_j = x_{j−1} + ∫ f ds                             (1)

in the paper's units (lengths over R₀, speeds over √(g₀R₀), angles in rad). Where Δ_j > ε₊ a node is
inserted in the middle of the interval before node j; where Δ_j < ε₋ node j is removed (Fig. 2). The
same integration over the whole flight gives the global error, Eqs. (41), (42).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.propagation.fixed_step import rk4_step
from ampi.scp.literature.collocation import line_mesh
from ampi.scp.literature.formulation import Formulation
from ampi.scp.literature.subproblem_builder import MeshIterate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LocalErrorAdaptation:
    """Thresholds of Section 3.2 in the paper's units."""

    insert_above: float = 1e-2  # ε₊
    remove_below: float = 1e-3  # ε₋
    units: tuple[
        float, ...
    ] = ()  # SI or rad per unit of the error norm, per state that there may be
    most_nodes: int = 400  # cap: above it the worst intervals alone are cut

    def __call__(self, formulation: Formulation, at: MeshIterate) -> MeshIterate:
        """The iterate on its adapted mesh, remapped by linear interpolation (Step 6)."""
        error = local_errors(formulation, at, np.array(self.units[: formulation.n_states]))
        fractions = node_fractions(at)
        keep = np.ones(len(fractions), dtype=bool)
        keep[1:-1] = ~_every_second(error[:-1] < self.remove_below)
        worst = np.argsort(-error)[: max(0, self.most_nodes - int(keep.sum()))]
        worst = worst[error[worst] > self.insert_above]
        middle = 0.5 * (fractions[:-1] + fractions[1:])[worst]
        adapted = np.union1d(fractions[keep], middle)
        if np.array_equal(adapted, fractions):
            return at
        return MeshIterate(
            line_mesh(adapted),
            _interpolate(adapted, fractions, at.states),
            _interpolate(adapted, fractions, at.controls),
            at.final,
        )


def _every_second(candidate: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of neighbours that may all go, every second goes: an interval at most doubles at a time.

    The paper removes them all; then one interval replaces a whole run of small ones whose errors
    said nothing about it, and the next iteration has to insert them again.
    """
    start = np.maximum.accumulate(np.where(candidate, 0, np.arange(1, len(candidate) + 1)))
    place = np.arange(1, len(candidate) + 1) - start
    return candidate & (place % 2 == 1)


def node_fractions(at: MeshIterate) -> Array:
    """Nodes as fractions of the flight, from exactly 0 to exactly 1."""
    fixed, free = at.mesh.node_time
    fractions = (fixed + free * at.final) / at.final
    fractions[0], fractions[-1] = 0.0, 1.0
    return np.asarray(fractions)


def _interpolate(new: Array, old: Array, values: Array) -> Array:
    return np.column_stack([np.interp(new, old, column) for column in values.T])


def runge_kutta(formulation: Formulation, at: MeshIterate, states: Array, j: slice | int) -> Array:
    """One classical Runge–Kutta step over the intervals `j`, from `states` at their beginnings."""
    s = at.mesh.times(at.final)
    begin, length = s[:-1][j], np.diff(s)[j]
    before, after = at.controls[:-1][j], at.controls[1:][j]
    before, after = np.atleast_2d(before), np.atleast_2d(after)

    def rates(x: Array, u: Array, at: Array) -> Array:
        return formulation.rates(x, u, at[:, 0])

    begin, length = np.atleast_1d(begin)[:, None], np.atleast_1d(length)[:, None]
    return rk4_step(rates, np.atleast_2d(states), before, after, begin, length)


def local_errors(formulation: Formulation, at: MeshIterate, units: Array) -> Array:
    """Δ_j of Eq. (1) at the nodes but the first."""
    flown = runge_kutta(formulation, at, at.states[:-1], slice(None))
    difference = (flown - at.states[1:]) * formulation.state_scale / units
    with np.errstate(over="ignore"):  # what is nonsense ends as an infinite error
        return np.asarray(np.linalg.norm(difference, axis=1))


def global_error(formulation: Formulation, at: MeshIterate) -> Array:
    """Δx_f = x̄_f − x_f of Eq. (41), SI or rad (n_x,)."""
    state = at.states[:1]
    for j in range(len(at.states) - 1):
        state = runge_kutta(formulation, at, state, j)
    return np.asarray((state[0] - at.states[-1]) * formulation.state_scale)
