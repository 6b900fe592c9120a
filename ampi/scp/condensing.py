"""Condensing: the linearised dynamics solved for the states, segment by segment.

Linearising R_s = 0 (transcription, Eq. (1)) at the iterate, with A = ∂f/∂x and t = a + b t_f,

    (D⊗I − h A) δx = −(D₀⊗I) δx_start + h B δu + (β f + h b f_t) δt_f − R      (1)

one dense LU per segment gives the affine map δx = Z z + c of the free variables

    z = (δu at the collocation points, δt_f, δσ₀).                               (2)

The same factors, transposed and swept backwards, give the multipliers μ of R = 0. With them the
Hessian of the Lagrangian  L = J + Σ μᵀR + Σ νᵀg  is reduced to z:

    H = Zᵀ ∇²L Z = Σ_i J_iᵀ W_i J_i + r eᵀ + e rᵀ + terms in û,                  (3)

J_i = [Z_i; b_i eᵀ] the map of z to (x, t) at node i, e the unit vector of δt_f, W_i the Hessian of
−h μᵀf + νᵀg + ωᵀL over (x, t), L the integrands of the cost with multipliers ω, and r the coupling of
t_f through h(t_f): r = Σ (β/h) [−h μᵀ(A δx + B δu + b f_t δt_f) + ωᵀ(L_x δx + b L_t δt_f)].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from ampi.scp.derivatives import NodeDerivatives
from ampi.scp.problem import BANK, N_STATES, OptimalControlProblem
from ampi.scp.transcription import RadauTranscription

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Iterate:
    """Scaled states (n, 7), bank rate at the collocation points (n − 1,), final time (s)."""

    states: Array
    bank_rate: Array
    final_time: float


@dataclass(frozen=True, eq=False)
class CondensedDynamics:
    """Z of Eq. (1) and the factors that made it."""

    transcription: RadauTranscription
    derivatives: NodeDerivatives
    factors: tuple[tuple[Array, Array], ...]
    state_map: Array  # Z, (n, 7, n_z)
    final_time_scale: float  # s per unit of z's δt_f
    rate_scale: float  # rad/s per unit of z's δu

    @property
    def n_variables(self) -> int:
        """Length of z, Eq. (2)."""
        return int(self.state_map.shape[2])

    def correction(self, residual: Array, entry_error: Array) -> Array:
        """State change (n, 7) at fixed u and t_f that cancels `residual`, to first order.

        `entry_error` (7,) is added to the first node.
        """
        mesh = self.transcription.mesh
        change = np.empty((mesh.n_nodes, N_STATES))
        change[0] = start = entry_error
        for s, (lu, pivots), start_kron in zip(
            mesh.segments, self.factors, self.transcription.start_kron, strict=True
        ):
            right = -residual[s.collocation].ravel() - start_kron @ start
            solution = dgetrs(lu, pivots, right)[0].reshape(-1, N_STATES)
            change[s.collocation.start + 1 : s.collocation.stop + 1] = solution
            start = solution[-1]
        return change

    def multipliers(self, node_gradient: Array) -> Array:
        """μ (n − 1, 7) from ∂(J + νᵀg)/∂x at the nodes (n, 7): one backward sweep."""
        mesh = self.transcription.mesh
        mu = np.empty((mesh.n_nodes - 1, N_STATES))
        carried = np.zeros(N_STATES)
        for k in reversed(range(len(mesh.segments))):
            s, (lu, pivots) = mesh.segments[k], self.factors[k]
            right = -node_gradient[1:][s.collocation]
            right[-1] -= carried
            solution = dgetrs(lu, pivots, right.ravel(), trans=1)[0]
            mu[s.collocation] = solution.reshape(-1, N_STATES)
            carried = self.transcription.start_kron[k].T @ solution
        return mu

    def reduced_hessian(self, curvature: Array, mu: Array, omega: Array, half: Array) -> Array:
        """Eq. (3); `curvature` is W (n, 8, 8), `omega` (n, k), `half` h (n − 1,)."""
        t, d = self.transcription, self.derivatives
        n, _, n_z = self.state_map.shape
        time_column = n_z - 2
        node_map = np.zeros((n, N_STATES + 1, n_z))
        node_map[:, :N_STATES] = self.state_map
        node_map[:, N_STATES, time_column] = t.node_free * self.final_time_scale
        flat = node_map.reshape(-1, n_z)
        hessian = flat.T @ (curvature @ node_map).reshape(-1, n_z)
        weighted = -(t.half_free * self.final_time_scale)[:, None] * mu
        along_state = np.einsum("ij,ijk->ik", weighted, d.state_jacobian[1:])
        coupling = along_state.ravel() @ self.state_map[1:].reshape(-1, n_z)
        coupling[: n - 1] += weighted[:, BANK] * self.rate_scale  # B: the bank row alone
        coupling[time_column] += (
            float(np.sum(weighted * d.time_derivative[1:] * t.node_free[1:, None]))
            * self.final_time_scale
        )
        if omega.shape[1]:
            stretch = (t.half_free / half * self.final_time_scale)[:, None] * omega[1:]
            along = np.einsum("ik,ikj->ij", stretch, d.integrand_jacobian[1:])
            coupling += along[:, :N_STATES].ravel() @ self.state_map[1:].reshape(-1, n_z)
            coupling[time_column] += along[:, N_STATES] @ t.node_free[1:] * self.final_time_scale
        hessian[time_column] += coupling
        hessian[:, time_column] += coupling
        return hessian


def condense(
    problem: OptimalControlProblem,
    transcription: RadauTranscription,
    derivatives: NodeDerivatives,
    final_time: float,
) -> CondensedDynamics:
    """Factor Eq. (1) on every segment and build Z."""
    mesh = transcription.mesh
    n, n_z = mesh.n_nodes, mesh.n_nodes + 1
    time_column, bank_column = n_z - 2, n_z - 1
    half = transcription.half_lengths(final_time)
    time_scale = problem.scaling.final_time
    a, f, ft = derivatives.state_jacobian, derivatives.rates, derivatives.time_derivative
    free_end = (
        transcription.half_free[:, None] * f[1:]
        + (half * transcription.node_free[1:])[:, None] * ft[1:]
    ) * time_scale
    rate_gain = half * problem.bank_rate_limit  # h B: ∂f/∂û is u_max, in the bank row alone

    state_map = np.zeros((n, N_STATES, n_z))
    state_map[0, BANK, bank_column] = 1.0
    start = state_map[0]
    factors = []
    for s, kron, start_kron in zip(
        mesh.segments, transcription.derivative_kron, transcription.start_kron, strict=True
    ):
        count, rows = s.rule.degree, s.collocation
        matrix = kron.copy()
        blocks = matrix.reshape(count, N_STATES, count, N_STATES)
        diagonal = np.arange(count)
        blocks[diagonal, :, diagonal, :] -= half[rows, None, None] * a[1:][rows]
        lu, pivots, info = dgetrf(matrix)
        if info != 0 or not np.all(np.isfinite(lu)):
            raise FloatingPointError("condensing: a segment's linearised dynamics are singular")
        right = np.zeros((count * N_STATES, N_STATES + count + 1))
        right[:, :N_STATES] = -start_kron
        right[diagonal * N_STATES + BANK, N_STATES + diagonal] = rate_gain[rows]
        right[:, -1] = free_end[rows].ravel()
        solution = dgetrs(lu, pivots, right)[0]
        block = solution[:, :N_STATES] @ start
        block[:, rows] += solution[:, N_STATES:-1]
        block[:, time_column] += solution[:, -1]
        block = block.reshape(count, N_STATES, n_z)
        state_map[rows.start + 1 : rows.stop + 1] = block
        start = block[-1]
        factors.append((lu, pivots))
    return CondensedDynamics(
        transcription=transcription,
        derivatives=derivatives,
        factors=tuple(factors),
        state_map=state_map,
        final_time_scale=time_scale,
        rate_scale=problem.bank_rate_limit,
    )
