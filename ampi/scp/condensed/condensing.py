"""Condensing: the linearised dynamics solved for the states, segment by segment.

Linearising R_s = 0 (transcription, Eq. (1)) at the iterate, with A = ∂f/∂x and t = a + b t_f,

    (D⊗I − h A) δx = −(D₀⊗I) δx_start + h B δu + (β f + h b f_t) δt_f − R      (1)

Two of the seven states are quadratures: no state enters σ̇ = u, and the longitude enters no rate. Both
are running integrals (`RadauTranscription.integration`), σ before and θ after the core of five,

    (D⊗I − h A_cc) δx_c = −(D₀⊗I) δx_c,start + h A_cσ δσ + (β f_c + h b f_c,t) δt_f − R_c   (2)

one dense LU of which per segment gives the affine map δx = Z z + c of the free variables

    z = (δu at the collocation points, δt_f, δσ₀).                               (3)

The same factors, transposed and swept backwards, give the multipliers μ of R = 0. With them the
Hessian of the Lagrangian  L = J + Σ μᵀR + Σ νᵀg  is reduced to z:

    H = Zᵀ ∇²L Z = Σ_i J_iᵀ W_i J_i + r eᵀ + e rᵀ + terms in û,                  (4)

J_i = [Z_i; b_i eᵀ] the map of z to (x, t) at node i, e the unit vector of δt_f, W_i the Hessian of
−h μᵀf + νᵀg + ωᵀL over (x, t), L the integrands of the cost with multipliers ω, and r the coupling of
t_f through h(t_f): r = Σ (β/h) [−h μᵀ(A δx + B δu + b f_t δt_f) + ωᵀ(L_x δx + b L_t δt_f)].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from ampi.physics.state import BANK, LONGITUDE, N_CORE, N_STATES
from ampi.physics.state import CORE as CORE_STATES
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.tracing.derivatives import NodeDerivatives

Array = NDArray[np.float64]

CORE = list(CORE_STATES)  # an index


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
    stretched: Array  # h A, (n − 1, 7, 7)
    factors: tuple[tuple[Array, Array], ...]  # of Eq. (2), per segment
    state_map: Array  # Z, (n, 7, n_z)
    final_time_scale: float  # s per unit of z's δt_f
    rate_scale: float  # rad/s per unit of z's δu

    @property
    def n_variables(self) -> int:
        """Length of z, Eq. (3)."""
        return int(self.state_map.shape[2])

    def correction(self, residual: Array, entry_error: Array) -> Array:
        """State change (n, 7) at fixed u and t_f that cancels `residual`, to first order.

        `entry_error` (7,) is added to the first node.
        """
        t = self.transcription
        change = np.empty((t.mesh.n_nodes, N_STATES))
        change[0] = entry_error
        change[1:, BANK] = entry_error[BANK] - t.integration @ residual[:, BANK]
        right = self.stretched[:, CORE, BANK] * change[1:, BANK, None] - residual[:, CORE]
        start = entry_error[CORE]
        for s, (lu, pivots) in zip(t.mesh.segments, self.factors, strict=True):
            here = right[s.collocation] - s.rule.derivative[:, :1] * start
            solution = dgetrs(lu, pivots, here.ravel())[0].reshape(-1, N_CORE)
            right[s.collocation] = solution
            start = solution[-1]
        change[1:, CORE] = right
        along = np.einsum("ij,ij->i", self.stretched[:, LONGITUDE, CORE], right)
        along += self.stretched[:, LONGITUDE, BANK] * change[1:, BANK] - residual[:, LONGITUDE]
        change[1:, LONGITUDE] = entry_error[LONGITUDE] + t.integration @ along
        return change

    def multipliers(self, node_gradient: Array) -> Array:
        """μ (n − 1, 7) from ∂(J + νᵀg)/∂x at the nodes (n, 7): one backward sweep."""
        t = self.transcription
        mu = np.empty((t.mesh.n_nodes - 1, N_STATES))
        mu[:, LONGITUDE] = -(t.integration.T @ node_gradient[1:, LONGITUDE])
        right = self.stretched[:, LONGITUDE] * mu[:, LONGITUDE, None] - node_gradient[1:]
        carried = np.zeros(N_CORE)
        for k in reversed(range(len(t.mesh.segments))):
            s, (lu, pivots) = t.mesh.segments[k], self.factors[k]
            here = right[s.collocation][:, CORE]
            here[-1] -= carried
            solution = dgetrs(lu, pivots, here.ravel(), trans=1)[0].reshape(-1, N_CORE)
            mu[s.collocation.start : s.collocation.stop, CORE] = solution
            carried = s.rule.derivative[:, 0] @ solution
        on_bank = np.einsum("ij,ij->i", self.stretched[:, CORE, BANK], mu[:, CORE])
        mu[:, BANK] = t.integration.T @ (right[:, BANK] + on_bank)
        return mu

    def reduced_hessian(self, curvature: Array, mu: Array, omega: Array, half: Array) -> Array:
        """Eq. (4); `curvature` is W (n, 8, 8), `omega` (n, k), `half` h (n − 1,)."""
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
    """Factor Eq. (2) on every segment and build Z."""
    t, d = transcription, derivatives
    if not (np.all(np.isfinite(d.state_jacobian)) and np.all(np.isfinite(d.rates))):
        raise FloatingPointError("condensing: the derivatives of the dynamics are not finite")
    n, n_z = t.mesh.n_nodes, t.mesh.n_nodes + 1
    time_column, bank_column = n_z - 2, n_z - 1
    half = t.half_lengths(final_time)
    stretched = half[:, None, None] * d.state_jacobian[1:]
    by_time = t.half_free[:, None] * d.rates[1:]
    by_time += (half * t.node_free[1:])[:, None] * d.time_derivative[1:]
    by_time *= problem.scaling.final_time

    state_map = np.zeros((n, N_STATES, n_z))
    bank = state_map[:, BANK]
    bank[:, bank_column] = 1.0
    # h B: ∂f/∂û is u_max, in the bank row alone
    bank[1:, :-2] = t.integration * (half * problem.bank_rate_limit)
    bank[1:, time_column] = t.integration @ by_time[:, BANK]

    among_core, by_bank = stretched[:, CORE][:, :, CORE], stretched[:, CORE, BANK]
    factors = []
    for s, derivative in zip(t.mesh.segments, t.core_derivative, strict=True):
        rows, first = s.collocation, s.first_node
        factor = _factored(derivative, among_core[rows])
        # by columns: start of the core, start of the bank angle, δu of this segment, δt_f
        count = s.rule.degree
        right = np.zeros((N_CORE + 1 + count + 1, count, N_CORE))
        right[range(N_CORE), :, range(N_CORE)] = -s.rule.derivative[:, 0]
        right[N_CORE] = by_bank[rows]
        right[N_CORE + 1 : -1] = (
            bank[first + 1 : first + 1 + count, rows].T[:, :, None] * by_bank[rows]
        )
        inside = bank[first + 1 : first + 1 + count, time_column] - bank[first, time_column]
        right[-1] = by_time[rows][:, CORE] + inside[:, None] * by_bank[rows]
        solution = dgetrs(*factor, right.reshape(len(right), -1).T, overwrite_b=1)[0]
        block = solution[:, : N_CORE + 1] @ state_map[first, [*CORE, BANK]]
        block[:, rows] += solution[:, N_CORE + 1 : -1]
        block[:, time_column] += solution[:, -1]
        state_map[first + 1 : first + 1 + count, CORE] = block.reshape(count, N_CORE, n_z)
        factors.append(factor)
    along = (stretched[:, LONGITUDE, None] @ state_map[1:])[:, 0]
    along[:, time_column] += by_time[:, LONGITUDE]
    state_map[1:, LONGITUDE] = t.integration @ along
    if not np.all(np.isfinite(state_map[-1])):  # what is not a number travels to the end
        raise FloatingPointError("condensing: the linearised dynamics are not finite")
    return CondensedDynamics(
        transcription=transcription,
        derivatives=derivatives,
        stretched=stretched,
        factors=tuple(factors),
        state_map=state_map,
        final_time_scale=problem.scaling.final_time,
        rate_scale=problem.bank_rate_limit,
    )


def _factored(derivative: Array, stretched: Array) -> tuple[Array, Array]:
    """LU and pivots of D⊗I₅ − h A_cc, from D⊗I₅ by columns and h A_cc (N, 5, 5)."""
    matrix, count = derivative.copy(order="F"), len(stretched)
    diagonal = np.arange(count)
    transposed = matrix.T.reshape(count, N_CORE, count, N_CORE)
    transposed[diagonal, :, diagonal, :] -= stretched.transpose(0, 2, 1)
    lu, pivots, info = dgetrf(matrix, overwrite_a=1)
    if info != 0:
        raise FloatingPointError("condensing: a segment's linearised dynamics are singular")
    return lu, pivots
