"""The quadratic model at a point: exact gradient, convex exact Hessian of the Lagrangian.

Far from the target, while it is being bought off, the multipliers say nothing yet: there the model is
Gauss–Newton's, the effort's curvature alone (or, where the objective has none, a little of what the
reference effort would have). As soon as the target is met to first order, or what is bought off has
settled (a target out of reach), the model takes the whole curvature of the Lagrangian and the
iteration becomes Newton's.

The Hessian is made convex on the tangent space of what holds the step: the targets that are met and
the absolute values that sit at their kink.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, N_STATES
from ampi.scp.condensed.convexify import convexify_on_tangent
from ampi.scp.condensed.cost import add_rate_curvature, integrand_multipliers, linearised_cost
from ampi.scp.condensed.iterate import Flight, Linearised, Point
from ampi.scp.condensed.subproblem import ConvexSubproblem, Step
from ampi.scp.problem.scaled_problem import OptimalControlProblem

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CurvatureSettings:
    """Relative to the mean curvature of the reference effort over δu."""

    floor: float = 1e-3  # least eigenvalue kept by the convexification
    free_variables: float = 10.0  # Gauss–Newton curvature given to δt_f and δσ₀
    no_effort: float = 1e-2  # Gauss–Newton curvature given to δu, at least
    screening: float = 0.6  # path rows enter the subproblem where g exceeds this
    bank_screening: float = 0.85  # rows between the nodes where the bank angle exceeds this share
    kink: float = 0.999  # an absolute value is held at zero below this share of its weight


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Multipliers of the last accepted step: they weigh the curvature of the Lagrangian."""

    target: Array  # λ, one per row of the target
    limits: Array  # (n, m)
    bank: Array  # (n,)
    absolute: Array  # κ (k,), of the absolute values in the cost

    @classmethod
    def first(cls, problem: OptimalControlProblem, point: Point) -> Multipliers:
        """No knowledge yet but the signs of the absolute values."""
        return cls(
            np.zeros(len(problem.target)),
            np.zeros(point.path.shape),
            np.zeros(len(point.path)),
            np.sign(point.cost.value) * point.cost.weight,
        )

    @classmethod
    def of(cls, step: Step, convex: ConvexSubproblem) -> Multipliers:
        """Spread the subproblem's multipliers over the nodes."""
        limits = np.zeros((len(convex.rate), convex.n_limits))
        limits[convex.path_node, convex.path_kind] = step.path_multiplier
        bank = convex.bank_map.T @ step.bank_multiplier
        return cls(step.target_multiplier, limits, bank, step.absolute_multiplier)


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

    `met` marks the rows of the target that hold the step; None asks for the Gauss–Newton model.
    """
    problem, t, condensed = flight.problem, flight.transcription, linearised.condensed
    target, iterate = problem.target, point.iterate
    model = linearised_cost(problem.objective, t, iterate, linearised.derivatives, condensed)
    target_map = condensed.state_map[-1, target.state]
    reference = reference_curvature(flight, iterate.final_time)
    if met is None:
        hessian = _gauss_newton(flight, iterate.final_time, condensed.n_variables, settings)
    else:
        kinked = np.abs(multipliers.absolute) < settings.kink * point.cost.weight
        held = np.concatenate([target_map[met], model.absolute_rows[kinked]])
        hessian = _lagrangian_hessian(flight, point, linearised, multipliers)
        hessian = convexify_on_tangent(hessian, held, settings.floor * float(reference.mean()))

    node, kind = np.nonzero(point.path > settings.screening)
    path_rows = _path_rows(flight, linearised, node, kind)
    n_u, n_z = len(iterate.bank_rate), condensed.n_variables
    bank, limit = iterate.states[:, BANK], problem.bank_limit
    # the polynomial overshoots its nodes where it comes to the limit
    near = np.flatnonzero(np.abs(t.between @ bank) > settings.bank_screening * limit)
    bank_map = np.vstack([np.eye(len(bank)), t.between[near]])
    rate_rows = np.zeros((n_u + 1, n_z))
    rate_rows[0, : len(t.entry_rate)] = t.entry_rate
    rate_rows[1:, :n_u] = np.eye(n_u)
    return ConvexSubproblem(
        hessian=hessian,
        gradient=model.gradient,
        absolute_rows=model.absolute_rows,
        absolute_value=point.cost.value,
        absolute_weight=point.cost.weight,
        target=target,
        target_map=target_map,
        target_error=point.target_error,
        target_price=np.zeros(len(target)),
        rate_rows=rate_rows,
        rate=t.nodal_rate(iterate.bank_rate),
        bank_map=bank_map,
        bank_rows=bank_map @ condensed.state_map[:, BANK],
        # an iterate is within the limit at the nodes; between them it may be beyond by what the second
        # order of a step has left, and must not go on
        bank_lower=np.minimum(-limit - bank_map @ bank, 0.0),
        bank_upper=np.maximum(limit - bank_map @ bank, 0.0),
        final_time_column=n_u,
        radius=np.inf,
        path_rows=path_rows,
        path_room=1.0 - point.path[node, kind],
        path_kind=kind,
        path_node=node,
        n_limits=problem.n_limits,
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


def reference_curvature(flight: Flight, final_time: float) -> Array:
    """Curvature over δu (n_u,) that an effort worth the whole objective would have."""
    t, weight = flight.transcription, flight.problem.objective.reference_effort
    return np.asarray(2.0 * weight * t.half_lengths(final_time) * t.weights)


def _gauss_newton(
    flight: Flight, final_time: float, n_z: int, settings: CurvatureSettings
) -> Array:
    reference, objective = reference_curvature(flight, final_time), flight.problem.objective
    share = max(objective.effort / objective.reference_effort, settings.no_effort)
    diagonal = np.full(n_z, share * settings.free_variables * float(reference.mean()))
    diagonal[: len(reference)] = share * reference
    return np.diag(diagonal)


def _path_rows(
    flight: Flight, linearised: Linearised, node: NDArray[np.intp], kind: NDArray[np.intp]
) -> Array:
    """Rows of g over z (m, n_z), each of one limit at one node."""
    condensed = linearised.condensed
    along = linearised.derivatives.path_jacobian[node, kind]
    rows = np.einsum("mi,mij->mj", along[:, :N_STATES], condensed.state_map[node])
    by_time = along[:, N_STATES] * flight.transcription.node_free[node]
    rows[:, -2] += by_time * condensed.final_time_scale
    return np.asarray(rows)


def _lagrangian_hessian(
    flight: Flight, point: Point, linearised: Linearised, multipliers: Multipliers
) -> Array:
    """Condensing, Eq. (4), with the cost's own terms."""
    t, derivatives = flight.transcription, linearised.derivatives
    x, u, final_time = point.iterate.states, point.iterate.bank_rate, point.iterate.final_time
    objective, condensed = flight.problem.objective, linearised.condensed
    count = derivatives.integrand.shape[1]
    omega = integrand_multipliers(objective, t, final_time, multipliers.absolute, count)
    jacobian = derivatives.path_jacobian[:, :, :N_STATES]
    node_gradient = np.einsum("ik,ikj->ij", multipliers.limits, jacobian)
    if count:
        jacobian = derivatives.integrand_jacobian[:, :, :N_STATES]
        node_gradient += np.einsum("ik,ikj->ij", omega, jacobian)
    node_gradient[:, BANK] += multipliers.bank
    node_gradient[-1, flight.problem.target.state] += multipliers.target
    mu = condensed.multipliers(node_gradient)
    half = t.half_lengths(final_time)
    weighted = np.zeros((len(x), N_STATES))
    weighted[1:] = -half[:, None] * mu
    curvature = flight.dynamics.hessian(
        x, t.nodal_rate(u), t.times(final_time), weighted, np.hstack([multipliers.limits, omega])
    )
    hessian = condensed.reduced_hessian(curvature, mu, omega, half)
    scale = condensed.final_time_scale
    add_rate_curvature(hessian, objective, t, point.iterate, multipliers.absolute, scale)
    return hessian
