"""The cost of a flight, its gradient and its curvature (objective, Eq. (1)), for c cases at once.

By the quadrature of the transcription, q_i = w_i h_i(t_f), the cost is smooth in z = (δu, δt_f, δσ₀) but
for two sums of absolute values of smooth functions,

    J = Σ q_i (w_u û_i² + L_i) + w_t t_f + w_a Σ |q_i û_i| + w_D Σ |q_i D_i|.      (1)

The convex subproblem keeps |·| and linearises what stands inside. For such a convex composite the
Lagrangian holds κ_i c_i for each |c_i|, with the multiplier κ_i of the last step (Fletcher 1987,
Section 14.2), so the inside has curvature of its own. And everything that q_i multiplies moves with
t_f: ∂q_i/∂t_f = w_i β_i enters the gradient, and with δx or δu the Hessian.

û is (c, n − 1), t_f (c,), integrands are (k, c, n): L, if any, then D, if any.

References
----------
Fletcher (1987), "Practical Methods of Optimization".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import N_STATES
from ampi.scp.condensed.condensing import Cases, CondensedDynamics
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.scp.problem.scaled_problem import OptimalControlProblem, by_case

Array = NDArray[np.float64]


def smooth_cost(
    problem: OptimalControlProblem,
    t: RadauTranscription,
    u: Array,
    final_time: Array,
    integrands: Array,
) -> Array:
    """The smooth terms of Eq. (1), (c,)."""
    objective, quadrature = problem.objective, t.half_lengths(final_time) * t.weights
    total = by_case(objective.effort) * (quadrature * u * u).sum(axis=1, keepdims=True)
    total = (total + by_case(objective.final_time) * final_time[:, None])[:, 0]
    if problem.functions.n_smooth:
        total = total + (quadrature * integrands[0, :, 1:]).sum(axis=1)
    return np.asarray(total)


def smooth_gradient(
    problem: OptimalControlProblem, t: RadauTranscription, u: Array, final_time: Array
) -> Array:
    """Of effort and flight time over z, (c, n_z): what needs no state."""
    objective, scale = problem.objective, problem.scaling.final_time
    effort = by_case(objective.effort)
    gradient = np.zeros((len(u), u.shape[1] + 2))
    gradient[:, :-2] = 2.0 * effort * t.half_lengths(final_time) * t.weights * u
    growth = t.half_free * t.weights * scale  # ∂q/∂(δt_f)
    gradient[:, -2] = effort[:, 0] * (growth * u * u).sum(axis=1)
    gradient[:, -2] += by_case(objective.final_time)[:, 0] * scale
    return gradient


def integrand_gradient(
    condensed: CondensedDynamics, values: Array, jacobian: Array, half: Array, cases: Cases
) -> Array:
    """Of ∫ L dt over z, (k, n_z), from L (k, n − 1) and ∂L/∂(x, t) (k, n − 1, 8) at the points."""
    t, scale = condensed.transcription, condensed.final_time_scale
    weighted = (half * t.weights)[:, :, None] * jacobian
    gradient = condensed.projected(weighted[:, :, :N_STATES], cases)
    gradient[:, -2] += (weighted[:, :, N_STATES] * t.node_free[1:]).sum(axis=1) * scale
    gradient[:, -2] += (t.half_free * t.weights * values).sum(axis=1) * scale
    return gradient


@dataclass(frozen=True, eq=False)
class AbsoluteTerms:
    """Σ weight |value| of Eq. (1) for one case: û, then D, at the collocation points."""

    value: Array  # (k,)
    weight: Array  # (k,), positive

    @classmethod
    def of(
        cls,
        problem: OptimalControlProblem,
        t: RadauTranscription,
        u: Array,
        final_time: float,
        integrands: Array,
    ) -> AbsoluteTerms:
        """From û (n − 1,) and the integrands (k, n)."""
        objective, quadrature = problem.objective, t.weights * t.half_lengths(final_time)
        value, weight = [np.zeros(0)], [np.zeros(0)]
        if objective.variation > 0.0:
            value.append(u)
            weight.append(objective.variation * quadrature)
        if objective.descent > 0.0:
            value.append(integrands[-1, 1:])
            weight.append(objective.descent * quadrature)
        return cls(np.concatenate(value), np.concatenate(weight))

    @property
    def total(self) -> float:
        """Σ weight |value|."""
        return float(self.weight @ np.abs(self.value))


def absolute_rows(
    problem: OptimalControlProblem,
    condensed: CondensedDynamics,
    u: Array,
    descent: Array,
    descent_jacobian: Array,
) -> Array:
    """Rows over z of what stands inside |·| (k, n_z), of one case: value + rows z.

    `descent` is D (n,), `descent_jacobian` ∂D/∂(x, t) (n, 8); without such a term they are not read.
    """
    t, objective, n_z = condensed.transcription, problem.objective, condensed.n_variables
    growth = t.half_free / condensed.half[0] * condensed.final_time_scale  # ∂(log q)/∂(δt_f)
    blocks = [np.zeros((0, n_z))]
    if objective.variation > 0.0:
        rows = np.eye(len(u), n_z)
        rows[:, -2] = growth * u
        blocks.append(rows)
    if objective.descent > 0.0:
        rows = condensed.rows(0, np.arange(1, len(u) + 1), descent_jacobian[1:])
        rows[:, -2] += growth * descent[1:]
        blocks.append(rows)
    return np.concatenate(blocks)


def integrand_multipliers(
    problem: OptimalControlProblem, t: RadauTranscription, final_time: Array, kappa: Array
) -> Array:
    """What multiplies each integrand in the Lagrangian, (k, c, n − 1): q for L, κ (c, ·) for D."""
    found = []
    if problem.functions.n_smooth:
        found.append(t.weights * t.half_lengths(final_time))
    if problem.functions.n_absolute:
        found.append(kappa[:, -len(t.weights) :])
    return np.array(found).reshape(len(found), len(final_time), len(t.weights))


def add_rate_curvature(
    hessian: Array,
    problem: OptimalControlProblem,
    t: RadauTranscription,
    u: Array,
    final_time: Array,
    kappa: Array | None = None,
) -> None:
    """Add the second derivatives of the terms in û to H (c, n_z, n_z); `kappa` (c, k) of |û|."""
    n_u, scale, effort = u.shape[1], problem.scaling.final_time, by_case(problem.objective.effort)
    half, diagonal = t.half_lengths(final_time), np.arange(n_u)
    hessian[:, diagonal, diagonal] += 2.0 * effort * half * t.weights
    coupling = 2.0 * effort * t.half_free * t.weights * scale * u
    if kappa is not None and np.any(problem.objective.variation > 0.0):
        coupling = coupling + kappa[:, :n_u] * t.half_free / half * scale
    hessian[:, :n_u, -2] += coupling
    hessian[:, -2, :n_u] += coupling
