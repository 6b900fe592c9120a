"""The cost of a flight, its gradient and its curvature (objective, Eq. (1)), for c cases at once.

By the quadrature of the transcription, q_i = w_i h_i(t_f), the cost is smooth in z = (δu, δt_f, δy₀) but
for two sums of absolute values of smooth functions,

    J = Σ q_i (Σ_k w_k û_ik² + L_i) + w_t t_f + w_a Σ |q_i û_i| + w_D Σ |q_i D_i| + m(x_f),     (1)

with û_i the first control where it has no other index.

The convex subproblem keeps |·| and linearises what stands inside. For such a convex composite the
Lagrangian holds κ_i c_i for each |c_i|, with the multiplier κ_i of the last step (Fletcher 1987,
Section 14.2), so the inside has curvature of its own. And everything that q_i multiplies moves with
t_f: ∂q_i/∂t_f = w_i β_i enters the gradient, and with δx or δu the Hessian.

û is (c, (n − 1) m), the m controls of a point side by side, t_f (c,), integrands are (k, c, n): L, if
any, then D, if any.

References
----------
Fletcher (1987), "Practical Methods of Optimization".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.scp.condensed.condensing import Cases, CondensedDynamics
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.scp.problem.scaled_problem import OptimalControlProblem, by_case
from ampi.tracing.dynamics import Entries

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
    first, *others = _by_control(problem, u)
    total = by_case(objective.effort[0]) * (quadrature * first * first).sum(axis=1, keepdims=True)
    for effort, rate in zip(objective.effort[1:], others, strict=True):
        total = total + by_case(effort) * (quadrature * rate * rate).sum(axis=1, keepdims=True)
    total = (total + by_case(objective.final_time) * final_time[:, None])[:, 0]
    if problem.functions.n_smooth:
        total = total + (quadrature * integrands[0, :, 1:]).sum(axis=1)
    return np.asarray(total)


def smooth_gradient(
    problem: OptimalControlProblem, t: RadauTranscription, u: Array, final_time: Array
) -> Array:
    """Of effort and flight time over z, (c, n_z): what needs no state."""
    objective, scale, m = problem.objective, problem.scaling.final_time, problem.n_controls
    gradient = np.zeros((len(u), u.shape[1] + 1 + m))
    growth = t.half_free * t.weights * scale  # ∂q/∂(δt_f)
    for k, rate in enumerate(_by_control(problem, u)):
        effort = by_case(objective.effort[k])
        own = 2.0 * effort * t.half_lengths(final_time) * t.weights * rate
        gradient[:, k : -1 - m : m] = own
        gradient[:, -1 - m] += effort[:, 0] * (growth * rate * rate).sum(axis=1)
    gradient[:, -1 - m] += by_case(objective.final_time)[:, 0] * scale
    return gradient


def _by_control(problem: OptimalControlProblem, u: Array) -> list[Array]:
    """û of each control, (c, n − 1)."""
    m = problem.n_controls
    return [u[:, k::m] for k in range(m)]


@dataclass(frozen=True, eq=False)
class Terminal:
    """m(x_f) of c cases and its derivatives over the scaled final state."""

    value: Array  # (c,)
    gradient: Array  # (c, s)
    hessian: Array  # (c, s, s)

    def add_curvature(self, second: Entries, points: int) -> None:
        """Add ∂²m/∂x² to W at the last of the points, (row, column) → (c, points)."""
        states = range(self.gradient.shape[1])
        for place in ((row, column) for row in states for column in states):
            values = self.hessian[:, place[0], place[1]]
            if values.any():
                there = second.setdefault(place, np.zeros((len(values), points)))
                there[:, -1] += values


def terminal_cost(
    problem: OptimalControlProblem, final: Array, *, one_by_one: bool
) -> Terminal | None:
    """Of scaled final states (s, c); None where the objective has no such term."""
    function = problem.dynamics.terminal
    if function is None:
        return None
    evaluate = function.one_by_one if one_by_one else function.together
    nothing = np.zeros((final.shape[1], 1))
    controls = np.zeros((problem.n_controls, *nothing.shape))
    value, gradient, hessian = evaluate(final[:, :, None], controls, nothing, problem.numbers)
    s = len(final)
    # of CasADi, column by column; symmetric
    return Terminal(value[0, :, 0], gradient[:, :, 0].T, hessian[:, :, 0].T.reshape(-1, s, s))


def integrand_gradient(
    condensed: CondensedDynamics, values: Array, jacobian: Array, half: Array, cases: Cases
) -> Array:
    """Of ∫ L dt over z, (k, n_z), from L (k, n − 1) and ∂L/∂(x, t) (k, n − 1, s + 1) at the points."""
    t, scale = condensed.transcription, condensed.final_time_scale
    weighted = (half * t.weights)[:, :, None] * jacobian
    gradient, column = condensed.projected(weighted[:, :, :-1], cases), condensed.time_column
    gradient[:, column] += (weighted[:, :, -1] * t.node_free[1:]).sum(axis=1) * scale
    gradient[:, column] += (t.half_free * t.weights * values).sum(axis=1) * scale
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
        """From û ((n − 1) m,) and the integrands (k, n)."""
        objective, quadrature = problem.objective, t.weights * t.half_lengths(final_time)
        value, weight = [np.zeros(0)], [np.zeros(0)]
        if objective.variation > 0.0:
            value.append(u[:: problem.n_controls])
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

    `descent` is D (n,), `descent_jacobian` ∂D/∂(x, t) (n, s + 1); without such a term they are not read.
    """
    t, objective, n_z = condensed.transcription, problem.objective, condensed.n_variables
    column, m = condensed.time_column, condensed.n_controls
    growth = t.half_free / condensed.half[0] * condensed.final_time_scale  # ∂(log q)/∂(δt_f)
    blocks = [np.zeros((0, n_z))]
    if objective.variation > 0.0:
        rows = np.eye(len(u), n_z)[::m]
        rows[:, column] = growth * u[::m]
        blocks.append(rows)
    if objective.descent > 0.0:
        rows = condensed.rows(0, np.arange(1, len(descent)), descent_jacobian[1:])
        rows[:, column] += growth * descent[1:]
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
    m, scale, half = problem.n_controls, problem.scaling.final_time, t.half_lengths(final_time)
    for k, rate in enumerate(_by_control(problem, u)):
        effort, own = by_case(problem.objective.effort[k]), np.arange(k, u.shape[1], m)
        hessian[:, own, own] += 2.0 * effort * half * t.weights
        coupling = 2.0 * effort * t.half_free * t.weights * scale * rate
        if k == 0 and kappa is not None and np.any(problem.objective.variation > 0.0):
            coupling = coupling + kappa[:, : rate.shape[1]] * t.half_free / half * scale
        hessian[:, own, -1 - m] += coupling
        hessian[:, -1 - m, own] += coupling
