"""Transcriptions as linear operators: the trapezoid on any mesh, and flipped Radau (hp or global).

With s the independent variable (time or energy), nodal states x_j and rates f_j, every rule here reads

    Σ_j L_kj x_j − h_k Σ_j R_kj f_j = 0,      h_k = α_k + β_k s_f,               (1)
    ∫ l ds = Σ_j w_j l_j,                      w_j = ω_j + ω'_j s_f,              (2)

so one sparse subproblem serves them all:

- trapezoid (Zhou 2021, Eq. 37; Liu 2015, Eq. 61): L = (−1, 1), R = (1, 1), h half the interval;
- flipped Radau (Wang 2020, Eqs. 18–25): L the rows of D̄, R picks the collocation point, h half the
  segment. One segment is the global method (PSCP), several linked ones the hp method (hp-PSCP).

A trapezoid mesh is stored as a `Mesh` of segments of degree one: the same nodes, and between them the
straight line that the trapezoid means.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ampi.pseudospectral.lagrange import barycentric_weights, interpolation_matrix
from ampi.pseudospectral.mesh import Mesh, Phase

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Collocation:
    """Eqs. (1) and (2) on n nodes and m equations per state."""

    mesh: Mesh
    left: sparse.csr_array  # L (m, n)
    right: sparse.csr_array  # R (m, n)
    half_fixed: Array  # α (m,)
    half_free: Array  # β (m,)
    weight_fixed: Array  # ω (n,)
    weight_free: Array  # ω' (n,)
    first_control: (
        Array  # (k, n): rows that all give the control at the first node, from the nodal ones
    )

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return self.mesh.n_nodes

    def half_lengths(self, final: float) -> Array:
        """h of Eq. (1)."""
        return self.half_fixed + self.half_free * final

    def weights(self, final: float) -> Array:
        """w of Eq. (2)."""
        return self.weight_fixed + self.weight_free * final

    def residual(self, x: Array, rates: Array, final: float) -> Array:
        """Left side of Eq. (1), (m, n_x), from x and rates (n, n_x)."""
        return np.asarray(self.left @ x - self.half_lengths(final)[:, None] * (self.right @ rates))


def line_mesh(fractions: Array) -> Mesh:
    """Mesh of straight lines between nodes at `fractions` (0 … 1) of the flight."""
    cuts = tuple(float(f) for f in fractions)
    return Mesh((Phase(degrees=(1,) * (len(cuts) - 1), fractions=cuts),))


def trapezoid(mesh: Mesh) -> Collocation:
    """The trapezoidal rule between neighbouring nodes of `mesh`."""
    fixed, free = mesh.node_time
    n = mesh.n_nodes
    step_fixed, step_free = np.diff(fixed), np.diff(free)
    before, after = sparse.eye_array(n - 1, n), sparse.eye_array(n - 1, n, k=1)
    return Collocation(
        mesh=mesh,
        left=(after - before).tocsr(),
        right=(after + before).tocsr(),
        half_fixed=0.5 * step_fixed,
        half_free=0.5 * step_free,
        weight_fixed=_trapezoid_weights(step_fixed),
        weight_free=_trapezoid_weights(step_free),
        first_control=np.eye(1, n),
    )


def _trapezoid_weights(steps: Array) -> Array:
    weights = np.zeros(len(steps) + 1)
    weights[:-1] += 0.5 * steps
    weights[1:] += 0.5 * steps
    return weights


def _first_control(mesh: Mesh) -> Array:
    """The first node's own control, and that of the first segment's collocation points."""
    first = mesh.segments[0]
    points = first.rule.nodes[1:]
    rows = np.eye(2, mesh.n_nodes)
    rows[1] = 0.0
    rows[1, 1 : first.nodes.stop] = interpolation_matrix(
        points, barycentric_weights(points), np.array([-1.0])
    )
    return rows


def radau(mesh: Mesh) -> Collocation:
    """Flipped Radau collocation on the segments of `mesh`.

    Every row is multiplied by its quadrature weight: entries of D̄ grow like N², and at 200 nodes
    Clarabel fails on the rows as they stand. The integral form x_i − x_0 = h D₁⁻¹ f (Garg et al.
    2011) is as well scaled, but its denser matrix takes twice the time.

    The control at the first node, which is not collocated, is what its neighbours' polynomial says.
    """
    n = mesh.n_nodes
    left = sparse.lil_array((n - 1, n))
    right = sparse.lil_array((n - 1, n))
    half = np.zeros((2, n - 1))
    weight = np.zeros((2, n))
    for s in mesh.segments:
        left[s.collocation, s.nodes] = s.rule.weights[:, None] * s.rule.derivative
        right[s.collocation, s.nodes.start + 1 : s.nodes.stop] = np.diag(s.rule.weights)
        for row, part in enumerate(s.half_length):
            half[row, s.collocation] = part
            weight[row, s.nodes.start + 1 : s.nodes.stop] = part * s.rule.weights
    return Collocation(
        mesh=mesh,
        left=left.tocsr(),
        right=right.tocsr(),
        half_fixed=half[0],
        half_free=half[1],
        weight_fixed=weight[0],
        weight_free=weight[1],
        first_control=_first_control(mesh),
    )
