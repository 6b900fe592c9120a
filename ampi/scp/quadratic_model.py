"""The quadratic model at a point: exact gradient, convex exact Hessian of the Lagrangian.

Far from the target, while it is being bought off, the multipliers say nothing yet: there the model is
Gauss–Newton's, the effort's curvature alone. As soon as the target is met to first order, or what is
bought off has settled (a target out of reach), the model takes the whole curvature Σ μᵀ∇²f and the
iteration becomes Newton's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.scp.convexify import convexify_on_tangent
from ampi.scp.iterate import Flight, Linearised, Point
from ampi.scp.problem import BANK, N_STATES, N_TARGETS
from ampi.scp.subproblem import ConvexSubproblem, Step

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CurvatureSettings:
    """Relative to the mean curvature of the effort over δu."""

    floor: float = 1e-3  # least eigenvalue kept by the convexification
    free_variables: float = 10.0  # Gauss–Newton curvature given to δt_f and δσ₀
    screening: float = 0.6  # path rows enter the subproblem where g exceeds this


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Multipliers of the last accepted step: they weigh the curvature of the Lagrangian."""

    target: Array  # λ (4,)
    limits: Array  # (n, 3)
    bank: Array  # (n,)

    @classmethod
    def zero(cls, n_nodes: int) -> Multipliers:
        """No knowledge yet."""
        return cls(np.zeros(N_TARGETS), np.zeros((n_nodes, 3)), np.zeros(n_nodes))

    @classmethod
    def of(cls, step: Step, convex: ConvexSubproblem) -> Multipliers:
        """Spread the subproblem's multipliers over the nodes."""
        limits = np.zeros((len(convex.rate), 3))
        limits[convex.path_node, convex.path_kind] = step.path_multiplier
        return cls(step.target_multiplier, limits, step.bank_multiplier)


def quadratic_subproblem(
    flight: Flight,
    point: Point,
    linearised: Linearised,
    multipliers: Multipliers,
    *,
    met: NDArray[np.bool_] | None,
    settings: CurvatureSettings,
) -> ConvexSubproblem:
    """Subproblem at `point`, with radius, price and penalty still to be set (`with_merit`).

    `met` marks the targets that hold the step (4,); None asks for the Gauss–Newton model.
    """
    problem, t, condensed = flight.problem, flight.transcription, linearised.condensed
    n_z = condensed.n_variables
    time_column, scale = n_z - 2, condensed.final_time_scale
    u, final_time = point.iterate.bank_rate, point.iterate.final_time
    half = t.half_lengths(final_time)
    curvature = 2.0 * problem.effort_weight * half * t.weights
    target_map = condensed.state_map[-1, :N_TARGETS]

    gradient = np.zeros(n_z)
    gradient[: len(u)] = curvature * u
    gradient[time_column] = (
        problem.effort_weight * float(np.sum(t.half_free * t.weights * u * u)) * scale
    )
    mean = float(curvature.mean())
    diagonal = np.full(n_z, settings.free_variables * mean)
    diagonal[: len(u)] = curvature
    if met is None:
        hessian = np.diag(diagonal)
    else:
        hessian = _lagrangian_hessian(flight, point, linearised, multipliers)
        hessian[np.arange(len(u)), np.arange(len(u))] += curvature
        coupling = 2.0 * problem.effort_weight * t.half_free * t.weights * u * scale
        hessian[: len(u), time_column] += coupling
        hessian[time_column, : len(u)] += coupling
        hessian = convexify_on_tangent(hessian, target_map[met], settings.floor * mean)

    node, kind = np.nonzero(point.path > settings.screening)
    along = linearised.derivatives.path_jacobian[node, kind]
    path_rows = np.einsum("mi,mij->mj", along[:, :N_STATES], condensed.state_map[node])
    path_rows[:, time_column] += along[:, N_STATES] * t.node_free[node] * scale
    rate_rows = np.zeros((problem.mesh.n_nodes, n_z))
    rate_rows[0, : len(t.entry_rate)] = t.entry_rate
    rate_rows[1:, :time_column] = np.eye(time_column)
    return ConvexSubproblem(
        hessian=hessian,
        gradient=gradient,
        target_map=target_map,
        target_error=point.target_error,
        target_weights=problem.target_weights,
        target_price=np.zeros(N_TARGETS),
        rate_rows=rate_rows,
        rate=t.nodal_rate(u),
        bank_rows=condensed.state_map[:, BANK],
        bank_lower=-problem.bank_limit - point.iterate.states[:, BANK],
        bank_upper=problem.bank_limit - point.iterate.states[:, BANK],
        final_time_column=time_column,
        radius=np.inf,
        path_rows=path_rows,
        path_room=1.0 - point.path[node, kind],
        path_kind=kind,
        path_node=node,
        limit_penalty=0.0,
    )


def with_merit(
    convex: ConvexSubproblem, *, radius: float, price: Array, penalty: float
) -> ConvexSubproblem:
    """The subproblem under a trust region, an elastic price and a limit penalty."""
    return replace(
        convex,
        bank_lower=np.maximum(convex.bank_lower, -radius),
        bank_upper=np.minimum(convex.bank_upper, radius),
        radius=radius,
        target_price=price,
        limit_penalty=penalty,
    )


def _lagrangian_hessian(
    flight: Flight, point: Point, linearised: Linearised, multipliers: Multipliers
) -> Array:
    """Condensing, Eq. (3), without the cost's own terms."""
    t = flight.transcription
    x, u, final_time = point.iterate.states, point.iterate.bank_rate, point.iterate.final_time
    path_jacobian = linearised.derivatives.path_jacobian[:, :, :N_STATES]
    node_gradient = np.einsum("ik,ikj->ij", multipliers.limits, path_jacobian)
    node_gradient[:, BANK] += multipliers.bank
    node_gradient[-1, :N_TARGETS] += multipliers.target
    mu = linearised.condensed.multipliers(node_gradient)
    weighted = np.zeros((len(x), N_STATES))
    weighted[1:] = -t.half_lengths(final_time)[:, None] * mu
    curvature = flight.dynamics.hessian(
        x, t.nodal_rate(u), t.times(final_time), weighted, multipliers.limits
    )
    return linearised.condensed.reduced_hessian(curvature, mu)
