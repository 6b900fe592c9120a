"""The quadratic model at a point: exact gradient, convex exact Hessian of the Lagrangian.

Far from the target, while it is being bought off, the multipliers say nothing yet: there the model is
Gauss–Newton's, the effort's curvature alone (or, where the objective has none, a little of what the
reference effort would have). As soon as the target is met to first order, or what is bought off has
settled (a target out of reach), the model takes the whole curvature of the Lagrangian and the
iteration becomes Newton's.

The Hessian is made convex on the tangent space of what holds the step: the targets that are met, the
absolute values that sit at their kink and, of two controls, the limits that held the last step. Along an
arc on a limit the target's tangent space alone has negative curvature, and clipping it there was tried:
the steps to the Space Shuttle's optimum then shrink by 0.84 only (59 iterations, not 35).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, N_CORE
from ampi.scp.condensed.condensing import CondensedDynamics
from ampi.scp.condensed.convexify import convexify_on_tangent
from ampi.scp.condensed.cost import (
    absolute_rows,
    add_rate_curvature,
    integrand_gradient,
    integrand_multipliers,
    smooth_gradient,
    terminal_cost,
)
from ampi.scp.condensed.curvature import (
    Curvature,
    CurvatureSettings,
    gauss_newton,
    hold_given_angles,
    reference_curvature,
)
from ampi.scp.condensed.iterate import ONE, Flight, Point
from ampi.scp.condensed.subproblem import ConvexSubproblem, Step
from ampi.scp.condensed.transcription import RadauTranscription, by_control
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.tracing.dynamics import entries

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Multipliers of the last accepted step: they weigh the curvature of the Lagrangian."""

    target: Array  # λ, one per row of the target
    limits: Array  # (n, limits)
    angles: Array  # of the steered angles, (m, n)
    absolute: Array  # κ (k,), of the absolute values in the cost

    @classmethod
    def first(cls, problem: OptimalControlProblem, point: Point) -> Multipliers:
        """No knowledge yet but the signs of the absolute values."""
        return cls(
            np.zeros(len(problem.target)),
            np.zeros(point.path.shape),
            np.zeros((problem.n_controls, len(point.path))),
            np.sign(point.absolute.value) * point.absolute.weight,
        )

    @classmethod
    def of(cls, step: Step, convex: ConvexSubproblem) -> Multipliers:
        """Spread the subproblem's multipliers over the nodes."""
        limits = np.zeros((convex.n_nodes, convex.n_limits))
        limits[convex.path_node, convex.path_kind] = step.path_multiplier
        angles = (convex.angle_map.T @ step.angle_multiplier).reshape(-1, convex.n_nodes)
        return cls(step.target_multiplier, limits, angles, step.absolute_multiplier)


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
    node, kind = np.nonzero(point.path > settings.screening)
    path_rows = condensed.rows(0, node, _limit_gradients(condensed, problem.n_limits)[kind, node])
    path_held = multipliers.limits[node, kind] > 0.0 if problem.n_controls > 1 else None
    if met is None:
        hessian = np.diag(gauss_newton(problem, t, final_time, settings)[0])
    else:
        kinked = np.abs(multipliers.absolute) < settings.kink * absolute.weight
        arcs = path_rows[:0] if path_held is None else path_rows[path_held]
        held = np.concatenate([target_map[met], rows[kinked], arcs])
        hessian = lagrangian_hessian(flight, point, condensed, multipliers)
        floor = settings.floor * float(reference_curvature(problem, t, final_time).mean())
        hessian = convexify_on_tangent(hessian, held, floor)
    angle_map, lower, upper = _angle_rooms(flight, point, settings)
    m, nodal = condensed.n_controls, condensed.moving[0, :, N_CORE:]
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
        rate_rows=_rate_rows(t, condensed),
        rate=t.nodal_rate(iterate.controls[None], m)[0],
        given_rates=problem.given_rates,
        angle_map=angle_map,
        angle_rows=angle_map @ np.concatenate([nodal[:, k] for k in range(m)]),
        angle_lower=lower,
        angle_upper=upper,
        final_time_column=len(iterate.controls),
        n_nodes=len(iterate.states),
        radius=np.inf,
        path_rows=path_rows,
        path_room=1.0 - point.path[node, kind],
        path_kind=kind,
        path_node=node,
        n_limits=problem.n_limits,
        limit_penalty=0.0,
        path_held=path_held,
    )


def _angle_rooms(
    flight: Flight, point: Point, settings: CurvatureSettings
) -> tuple[Array, Array, Array]:
    """How far the steered angles may go, at all nodes and where one is near a bound between them.

    The map (b, m n) from their nodal values to those places, and the room down and up there (b,). An
    iterate is within the bounds at the nodes; between them it may be beyond by what the second order of
    a step has left, and must not go on.
    """
    t, problem, n = flight.transcription, flight.problem, len(point.path)
    angles, nodal = problem.angles, point.iterate.states[:, BANK:].T
    maps, owner = [np.eye(nodal.size)], [np.repeat(np.arange(len(angles)), n)]
    for k, (angle, values) in enumerate(zip(angles, nodal, strict=True)):
        # the polynomial overshoots its nodes where it comes to a bound
        away = np.abs(t.between @ values - angle.middle)
        near = np.flatnonzero(away > settings.bank_screening * angle.half_width)
        rows = np.zeros((len(near), nodal.size))
        rows[:, k * n : (k + 1) * n] = t.between[near]
        maps.append(rows)
        owner.append(np.full(len(near), k))
    angle_map, of = np.vstack(maps), np.concatenate(owner)
    at_places = angle_map @ nodal.ravel()
    lower, upper = (np.array([getattr(a, side) for a in angles])[of] for side in ("lower", "upper"))
    return angle_map, np.minimum(lower - at_places, 0.0), np.maximum(upper - at_places, 0.0)


def _rate_rows(t: RadauTranscription, condensed: CondensedDynamics) -> Array:
    """δû at every node over z, (n m, n_z)."""
    m, n_z = condensed.n_controls, condensed.n_variables
    rows = np.zeros((n_z - 1, n_z))
    for k in range(m):
        rows[k, k : m * len(t.entry_rate) : m] = t.entry_rate
    rows[m:, : condensed.time_column] = np.eye(n_z - 1 - m)
    return rows


def with_merit(
    convex: ConvexSubproblem, *, radius: float, price: Array, penalty: float
) -> ConvexSubproblem:
    """The subproblem under a trust region, an elastic price and a limit penalty."""
    return replace(
        convex,
        angle_lower=np.maximum(convex.angle_lower, -radius),
        angle_upper=np.minimum(convex.angle_upper, radius),
        radius=radius,
        target_price=price,
        limit_penalty=penalty,
    )


def _limit_gradients(condensed: CondensedDynamics, n_limits: int) -> Array:
    """∂g/∂(x, t) of every limit at every node, (limits, n, s + 1)."""
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
    terminal = terminal_cost(problem, point.iterate.states[-1:].T, one_by_one=True)
    if terminal is not None:
        gradient += (terminal.gradient[:, None] @ condensed.final_map)[:, 0]
    return np.asarray(gradient[0])


def _absolute_rows(flight: Flight, point: Point, condensed: CondensedDynamics) -> Array:
    """Of what stands inside |·|, (k, n_z)."""
    problem, derivatives = flight.problem, condensed.derivatives
    assert derivatives.functions is not None
    descent, jacobian = np.zeros(0), np.zeros((0, condensed.n_states + 1))
    if problem.functions.n_absolute:
        last = len(derivatives.functions) - 1
        descent, jacobian = derivatives.functions[last, 0], derivatives.gradient_of(last)[0]
    return absolute_rows(problem, condensed, point.iterate.controls, descent, jacobian)


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
    gradient = weighted[:, :, :-1].copy()
    gradient[0, :, BANK:] += multipliers.angles[:, 1:].T
    gradient[0, -1, problem.target.state] += multipliers.target
    terminal = terminal_cost(problem, point.iterate.states[-1:].T, one_by_one=True)
    if terminal is not None:
        gradient[:, -1] += terminal.gradient
    mu = condensed.multipliers(gradient, ONE)
    function = problem.dynamics.second
    (found,) = function.one_by_one(
        x[:, :, 1:],
        by_control(u, problem.n_controls),
        t.times(final_time)[:, 1:],
        problem.numbers,
        -condensed.half * mu,
        weights,
    )
    running = np.einsum("kci,kcij->cij", omega, over_xt[m:]) if len(omega) else None
    second = entries(function.nonzeros[0], found)
    if terminal is not None:
        terminal.add_curvature(second, len(t.weights))
    hessian = Curvature.of(condensed, second, mu, running).reduced()
    add_rate_curvature(hessian, problem, t, u, final_time, kappa)
    hold_given_angles(hessian, problem)
    return np.asarray(hessian[0])
