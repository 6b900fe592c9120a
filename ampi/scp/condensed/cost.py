"""The cost of a flight, its gradient and its curvature (objective, Eq. (1)).

By the quadrature of the transcription, q_i = w_i h_i(t_f), the cost is smooth in z = (δu, δt_f, δσ₀) but
for two sums of absolute values of smooth functions,

    J = Σ q_i (w_u û_i² + L_i) + w_t t_f + w_a Σ |q_i û_i| + w_D Σ |q_i D_i|.      (1)

The convex subproblem keeps |·| and linearises what stands inside. For such a convex composite the
Lagrangian holds κ_i c_i for each |c_i|, with the multiplier κ_i of the last step (Fletcher 1987,
Section 14.2), so the inside has curvature of its own. And everything that q_i multiplies moves with
t_f: ∂q_i/∂t_f = w_i β_i enters the gradient, and with δx or δu the Hessian.

References
----------
Fletcher (1987), "Practical Methods of Optimization".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import N_STATES
from ampi.scp.condensed.condensing import CondensedDynamics, Iterate
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.scp.problem.objective import Objective
from ampi.tracing.derivatives import NodeDerivatives

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cost:
    """Eq. (1): the smooth terms, and Σ weight |value|."""

    smooth: float
    value: Array  # (k,): û, then D, at the collocation points
    weight: Array  # (k,), positive

    @property
    def total(self) -> float:
        """Scaled cost without the target's."""
        return self.smooth + float(self.weight @ np.abs(self.value))


def cost_of(
    objective: Objective, t: RadauTranscription, iterate: Iterate, integrand: Array
) -> Cost:
    """Eq. (1) with the integrands (n, k) at the nodes: L, if any, then D, if any."""
    u, quadrature = iterate.bank_rate, t.weights * t.half_lengths(iterate.final_time)
    smooth = objective.effort * float(np.sum(quadrature * u * u))
    smooth += objective.final_time * iterate.final_time
    if objective.n_smooth(integrand):
        smooth += float(quadrature @ integrand[1:, 0])
    value, weight = [np.zeros(0)], [np.zeros(0)]
    if objective.variation > 0.0:
        value.append(u)
        weight.append(objective.variation * quadrature)
    if objective.descent > 0.0:
        value.append(integrand[1:, -1])
        weight.append(objective.descent * quadrature)
    return Cost(smooth, np.concatenate(value), np.concatenate(weight))


@dataclass(frozen=True, eq=False)
class CostModel:
    """First derivatives of Eq. (1) over z."""

    gradient: Array  # (n_z,), of the smooth terms
    absolute_rows: Array  # (k, n_z): value + rows z, in the units of `Cost.value`


def linearised_cost(
    objective: Objective,
    t: RadauTranscription,
    iterate: Iterate,
    derivatives: NodeDerivatives,
    condensed: CondensedDynamics,
) -> CostModel:
    """Gradient of the smooth terms and of what stands inside |·|."""
    u, final_time = iterate.bank_rate, iterate.final_time
    half, n_z = t.half_lengths(final_time), condensed.n_variables
    time_column, scale = n_z - 2, condensed.final_time_scale
    growth = t.half_free * t.weights * scale  # ∂q/∂(δt_f)
    gradient = np.zeros(n_z)
    gradient[: len(u)] = 2.0 * objective.effort * half * t.weights * u
    gradient[time_column] = objective.effort * float(np.sum(growth * u * u))
    gradient[time_column] += objective.final_time * scale
    if objective.n_smooth(derivatives.integrand):
        rows = _integrand_rows(derivatives.integrand_jacobian[1:, 0], t, condensed)
        gradient += (half * t.weights) @ rows
        gradient[time_column] += float(growth @ derivatives.integrand[1:, 0])
    blocks = [np.zeros((0, n_z))]
    stretch = t.half_free / half * scale  # ∂(log q)/∂(δt_f)
    if objective.variation > 0.0:
        rows = np.eye(len(u), n_z)
        rows[:, time_column] = stretch * u
        blocks.append(rows)
    if objective.descent > 0.0:
        rows = _integrand_rows(derivatives.integrand_jacobian[1:, -1], t, condensed)
        rows[:, time_column] += stretch * derivatives.integrand[1:, -1]
        blocks.append(rows)
    return CostModel(gradient, np.concatenate(blocks))


def _integrand_rows(jacobian: Array, t: RadauTranscription, condensed: CondensedDynamics) -> Array:
    """Rows over z (n − 1, n_z) of an integrand with `jacobian` (n − 1, 8) over (x, t)."""
    rows = np.einsum("ij,ijz->iz", jacobian[:, :N_STATES], condensed.state_map[1:])
    rows[:, -2] += jacobian[:, N_STATES] * t.node_free[1:] * condensed.final_time_scale
    return np.asarray(rows)


def integrand_multipliers(
    objective: Objective, t: RadauTranscription, final_time: float, kappa: Array, count: int
) -> Array:
    """What multiplies each integrand in the Lagrangian (n, k): q for L, κ for D."""
    multipliers = np.zeros((len(t.weights) + 1, count))
    if count > int(objective.descent > 0.0):
        multipliers[1:, 0] = t.weights * t.half_lengths(final_time)
    if objective.descent > 0.0:
        multipliers[1:, -1] = kappa[-len(t.weights) :]
    return multipliers


def add_rate_curvature(
    hessian: Array,
    objective: Objective,
    t: RadauTranscription,
    iterate: Iterate,
    kappa: Array,
    scale: float,
) -> None:
    """Add the second derivatives of the terms in û; `kappa` (k,) are multipliers of `Cost.value`."""
    u, n_u = iterate.bank_rate, len(iterate.bank_rate)
    half, time_column = t.half_lengths(iterate.final_time), hessian.shape[0] - 2
    diagonal = np.arange(n_u)
    hessian[diagonal, diagonal] += 2.0 * objective.effort * half * t.weights
    coupling = 2.0 * objective.effort * t.half_free * t.weights * u * scale
    if objective.variation > 0.0:
        coupling += kappa[:n_u] * t.half_free / half * scale
    hessian[:n_u, time_column] += coupling
    hessian[time_column, :n_u] += coupling
