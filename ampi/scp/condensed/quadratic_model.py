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

from ampi.physics.state import BANK, N_CORE, N_STATES
from ampi.scp.condensed.condensing import CondensedDynamics
from ampi.scp.condensed.convexify import convexify_on_tangent
from ampi.scp.condensed.cost import (
    absolute_rows,
    add_rate_curvature,
    integrand_gradient,
    integrand_multipliers,
    smooth_gradient,
)
from ampi.scp.condensed.curvature import (
    Curvature,
    CurvatureSettings,
    gauss_newton,
    reference_curvature,
)
from ampi.scp.condensed.iterate import ONE, Flight, Point
from ampi.scp.condensed.subproblem import ConvexSubproblem, Step
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.tracing.dynamics import entries

Array = NDArray[np.float64]


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
            np.sign(point.absolute.value) * point.absolute.weight,
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
    condensed: CondensedDynamics,
    multipliers: Multipliers,
    *,
    met: NDArray[np.bool_] | None,
    settings: CurvatureSettings,
) -> ConvexSubproblem:
    """Subproblem at `point`, with radius, price and penalty still to be set (`with_merit`).

    `met` marks the rows of the target that hold the step; None asks for the Gauss–Newton model.
    """
    problem, t, iterate = flight.problem, flight.transcription, point.iterate
    target, absolute = problem.target, point.absolute
    target_map = condensed.final_map[0, target.state]
    rows = _absolute_rows(flight, point, condensed)
    final_time = iterate.batch[2]
    if met is None:
        hessian = np.diag(gauss_newton(problem, t, final_time, settings)[0])
    else:
        kinked = np.abs(multipliers.absolute) < settings.kink * absolute.weight
        held = np.concatenate([target_map[met], rows[kinked]])
        hessian = lagrangian_hessian(flight, point, condensed, multipliers)
        floor = settings.floor * float(reference_curvature(problem, t, final_time).mean())
        hessian = convexify_on_tangent(hessian, held, floor)
    node, kind = np.nonzero(point.path > settings.screening)
    path_rows = condensed.rows(0, node, _limit_gradients(condensed, problem.n_limits)[kind, node])
    bank, limit = iterate.states[:, BANK], problem.bank_limit
    # the polynomial overshoots its nodes where it comes to the limit
    near = np.flatnonzero(np.abs(t.between @ bank) > settings.bank_screening * limit)
    bank_map = np.vstack([np.eye(len(bank)), t.between[near]])
    return ConvexSubproblem(
        hessian=hessian,
        gradient=_gradient(flight, point, condensed),
        absolute_rows=rows,
        absolute_value=absolute.value,
        absolute_weight=absolute.weight,
        target=target,
        target_map=target_map,
        target_error=point.target_error,
        target_price=np.zeros(len(target)),
        rate_rows=_rate_rows(t, condensed.n_variables),
        rate=t.nodal_rate(iterate.bank_rate[None])[0],
        entry_rate=problem.entry_rate,
        bank_map=bank_map,
        bank_rows=bank_map @ condensed.moving[0, :, N_CORE],
        # an iterate is within the limit at the nodes; between them it may be beyond by what the second
        # order of a step has left, and must not go on
        bank_lower=np.minimum(-limit - bank_map @ bank, 0.0),
        bank_upper=np.maximum(limit - bank_map @ bank, 0.0),
        final_time_column=len(iterate.bank_rate),
        radius=np.inf,
        path_rows=path_rows,
        path_room=1.0 - point.path[node, kind],
        path_kind=kind,
        path_node=node,
        n_limits=problem.n_limits,
        limit_penalty=0.0,
    )


def _rate_rows(t: RadauTranscription, n_z: int) -> Array:
    """δû at every node over z, (n, n_z)."""
    rows = np.zeros((n_z - 1, n_z))
    rows[0, : len(t.entry_rate)] = t.entry_rate
    rows[1:, :-2] = np.eye(n_z - 2)
    return rows


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


def _limit_gradients(condensed: CondensedDynamics, n_limits: int) -> Array:
    """∂g/∂(x, t) of every limit at every node, (m, n, 8)."""
    return np.stack([condensed.derivatives.gradient_of(k)[0] for k in range(n_limits)])


def _gradient(flight: Flight, point: Point, condensed: CondensedDynamics) -> Array:
    """Of the smooth cost over z, (n_z,)."""
    problem, derivatives = flight.problem, condensed.derivatives
    _, u, final_time = point.iterate.batch
    gradient = smooth_gradient(problem, flight.transcription, u, final_time)
    if problem.functions.n_smooth:
        assert derivatives.functions is not None
        values = derivatives.functions[problem.n_limits, :, 1:]
        jacobian = derivatives.gradient_of(problem.n_limits)[:, 1:]
        gradient += integrand_gradient(condensed, values, jacobian, condensed.half, ONE)
    return np.asarray(gradient[0])


def _absolute_rows(flight: Flight, point: Point, condensed: CondensedDynamics) -> Array:
    """Of what stands inside |·|, (k, n_z)."""
    problem, derivatives = flight.problem, condensed.derivatives
    assert derivatives.functions is not None
    descent, jacobian = np.zeros(0), np.zeros((0, N_STATES + 1))
    if problem.functions.n_absolute:
        last = len(derivatives.functions) - 1
        descent, jacobian = derivatives.functions[last, 0], derivatives.gradient_of(last)[0]
    return absolute_rows(problem, condensed, point.iterate.bank_rate, descent, jacobian)


def lagrangian_hessian(
    flight: Flight, point: Point, condensed: CondensedDynamics, multipliers: Multipliers
) -> Array:
    """Curvature, Eq. (1), with the cost's own terms, (n_z, n_z)."""
    problem, t, derivatives = flight.problem, flight.transcription, condensed.derivatives
    x, u, final_time = point.iterate.batch
    kappa, m = multipliers.absolute[None], problem.n_limits
    omega = integrand_multipliers(problem, t, final_time, kappa)
    weights = np.concatenate([multipliers.limits.T[:, None, 1:], omega])  # of g and L
    over_xt = np.stack([derivatives.gradient_of(k) for k in range(len(weights))])[:, :, 1:]
    weighted = np.einsum("kci,kcij->cij", weights, over_xt)
    gradient = weighted[:, :, :N_STATES].copy()
    gradient[0, :, BANK] += multipliers.bank[1:]
    gradient[0, -1, problem.target.state] += multipliers.target
    mu = condensed.multipliers(gradient, ONE)
    function = problem.dynamics.second
    (found,) = function.one_by_one(
        x[:, :, 1:],
        u,
        t.times(final_time)[:, 1:],
        problem.numbers,
        -condensed.half * mu,
        weights,
    )
    running = np.einsum("kci,kcij->cij", omega, over_xt[m:]) if len(omega) else None
    curvature = Curvature.of(condensed, entries(function.nonzeros[0], found), mu, running)
    hessian = curvature.reduced()
    add_rate_curvature(hessian, problem, t, u, final_time, kappa)
    if problem.entry_bank_angle is not None:
        hessian[:, -1, -1] += 1.0  # δσ₀ moves nothing: so it is zero
    return np.asarray(hessian[0])
