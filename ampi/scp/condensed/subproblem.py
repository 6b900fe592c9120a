"""The convex subproblem, condensed, and its solution by Clarabel.

    minimise   ½ zᵀH z + gᵀz + Σ w e² + Σ ν (v⁺ + v⁻) + Σ_j a_j y_j + ρ Σ_k s_k
    subject to C z − e − v⁺ + v⁻ = −(x_f − x_target)   elastic target
               e_lo ≤ e ≤ e_hi                          zero, where it is to be met exactly
               −1 ≤ û + δû ≤ 1                          rates of the controls, at every node
               y_lo ≤ Z_y z ≤ y_hi                      steered angles: bounds and trust region, one box
               |δt_f| ≤ Δ                               trust region
               G_ik J_i z − s_k ≤ 1 − g_ik              path limits, one slack per limit
               ±(c_j + L_j z) ≤ y_j                     absolute values of the cost
               v⁺, v⁻, s ≥ 0                                                        (1)

The target is elastic (elastic_target) and ρ Σ s_k an exact penalty, L_∞ over the nodes of one limit:
the subproblem always has a solution, and v and s say what could not be met. Columns of A are
(z | e | v⁺ | v⁻ | y | s), rows top to bottom

    [  C   −I  −I   I   ·   · ]  = target          [ rate  ·   ·   ·   ·   · ]  two-sided, as ± rows
    [  ·    I   ·   ·   ·   · ]  = exact rows      [ ±L    ·   ·   ·  −I   · ]  absolute values
    [  Z_y  ·   ·   ·   ·   · ]  two-sided         [ ±e_tf ·   ·   ·   ·   · ]
    [  ·   ±I   ·   ·   ·   · ]  range rows        [  ·    ·  −I  −I   ·  −I ]  signs
    [  GJ   ·   ·   ·   ·  −1 ]  limits

`ampi/scp/condensed/subproblem_cvxpy.py` states the same problem in cvxpy; tests hold the two together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ampi.scp.cone_program import ConeStatus, solve_cone_program
from ampi.scp.problem.scaled_problem import Target

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ConvexSubproblem:
    """Data of Eq. (1): n_z free variables, t target rows, n nodes, k absolute values, m path rows."""

    hessian: Array  # H (n_z, n_z), positive definite
    gradient: Array  # g (n_z,)
    absolute_rows: Array  # L (k, n_z)
    absolute_value: Array  # c (k,)
    absolute_weight: Array  # a (k,)
    target: Target  # w, e_lo and e_hi of the t rows
    target_map: Array  # C (t, n_z)
    target_error: Array  # x_f − x_target (t,)
    target_price: Array  # ν (t,)
    rate_rows: Array  # (n m, n_z): δû at every node, its m controls side by side
    rate: Array  # û (n m,)
    given_rates: tuple[
        tuple[int, float], ...
    ]  # (control, û at the first node) of those that are given
    angle_map: (
        Array  # (b, m n): from the nodes of each angle to where they are bounded, the nodes first
    )
    angle_rows: Array  # Z_y (b, n_z), rad
    angle_lower: Array  # (b,)
    angle_upper: Array  # (b,)
    final_time_column: int
    n_nodes: int
    radius: float  # Δ
    path_rows: Array  # (m, n_z)
    path_room: Array  # 1 − g (m,)
    path_kind: NDArray[np.intp]  # (m,), which of the limits
    path_node: NDArray[np.intp]  # (m,), at which node
    n_limits: int
    limit_penalty: float  # ρ
    path_held: NDArray[np.bool_] | None = None  # (m,), whether the last step was held there

    @property
    def rate_bounds(self) -> tuple[Array, Array]:
        """Of δû at the nodes, (n m,) each."""
        lower, upper = -1.0 - self.rate, 1.0 - self.rate
        for k, rate in self.given_rates:
            lower[k] = upper[k] = rate - self.rate[k]
        return lower, upper

    def corrected(
        self, z: Array, target_error: Array, path: Array, absolute_value: Array
    ) -> ConvexSubproblem:
        """Every row shifted by what its linearisation missed along z (second-order correction).

        The arguments are those of the flight at z: e, g at all nodes (n, limits) and c.
        """
        return replace(
            self,
            target_error=target_error - self.target_map @ z,
            path_room=1.0 - path[self.path_node, self.path_kind] + self.path_rows @ z,
            absolute_value=absolute_value - self.absolute_rows @ z,
        )


@dataclass(frozen=True, eq=False)
class Step:
    """Solution of Eq. (1) with the multipliers that enter the Lagrangian."""

    z: Array
    slack: Array  # s, one per limit
    target_multiplier: Array  # λ (t,)
    angle_multiplier: Array  # (b,), upper minus lower
    path_multiplier: Array  # (m,), ≥ 0
    absolute_multiplier: Array  # κ (k,), |κ| ≤ a
    status: ConeStatus

    @property
    def usable(self) -> bool:
        """Whether `z` may be tried; the merit function decides whether it is kept."""
        return self.status.is_usable and bool(np.all(np.isfinite(self.z)))


def _on_z(problem: ConvexSubproblem) -> tuple[Array, Array]:
    """Rows on z of the inequalities, and their bounds: rates, angles, δt_f, limits, absolute values."""
    final_time = np.zeros((2, len(problem.gradient)))
    final_time[:, problem.final_time_column] = 1.0, -1.0
    lower, upper = problem.rate_bounds
    rows = [
        problem.rate_rows,
        -problem.rate_rows,
        problem.angle_rows,
        -problem.angle_rows,
        final_time,
        problem.path_rows,
        problem.absolute_rows,
        -problem.absolute_rows,
    ]
    bounds = [
        upper,
        -lower,
        problem.angle_upper,
        -problem.angle_lower,
        np.full(2, problem.radius),
        problem.path_room,
        -problem.absolute_value,
        problem.absolute_value,
    ]
    return np.vstack(rows), np.concatenate(bounds)


def _on_error(problem: ConvexSubproblem) -> tuple[Array, Array, NDArray[np.intp]]:
    """Rows on e and bounds of the range rows; indices of the exact rows."""
    target, identity = problem.target, np.eye(len(problem.target_error))
    exact = np.flatnonzero(target.lower == target.upper)
    ranged = np.flatnonzero(np.isfinite(target.lower) & (target.lower < target.upper))
    rows = np.vstack([identity[ranged], -identity[ranged]])
    bounds = np.concatenate([target.upper[ranged], -target.lower[ranged]])
    return rows, bounds, exact


def _cost(problem: ConvexSubproblem, width: int) -> tuple[Array, Array]:
    """P, upper triangular, and q over all columns of Eq. (1)."""
    n_z, targets, k = len(problem.gradient), len(problem.target_error), len(problem.absolute_value)
    e, v = n_z, n_z + targets
    y = v + 2 * targets
    quadratic, linear = np.zeros((width, width)), np.zeros(width)
    quadratic[:n_z, :n_z] = np.triu(problem.hessian)
    quadratic[np.arange(e, v), np.arange(e, v)] = 2.0 * problem.target.weight
    linear[:n_z] = problem.gradient
    linear[v:y] = np.tile(problem.target_price, 2)
    linear[y : y + k] = problem.absolute_weight
    linear[y + k :] = problem.limit_penalty
    return quadratic, linear


def solve_subproblem(problem: ConvexSubproblem) -> Step:
    """Solve Eq. (1) with Clarabel."""
    n_z, n, m = len(problem.gradient), len(problem.rate), len(problem.path_room)
    b = len(problem.angle_rows)
    targets, k, limits = len(problem.target_error), len(problem.absolute_value), problem.n_limits
    rows, bounds = _on_z(problem)
    range_rows, range_bounds, exact = _on_error(problem)
    identity = np.eye(targets)

    # columns: first of e, v⁺, y and s; rows: first of the inequalities on z, of the ranges, signs
    e, v = n_z, n_z + targets
    y = v + 2 * targets
    s, width = y + k, y + k + limits
    on_z = targets + len(exact)
    ranges = on_z + len(rows)
    signs = ranges + len(range_rows)
    left = np.zeros((signs + 2 * targets + limits, width))
    left[:targets, :n_z] = problem.target_map
    left[:targets, e:y] = np.hstack([-identity, -identity, identity])
    left[targets + np.arange(len(exact)), e + exact] = 1.0
    left[on_z:ranges, :n_z] = rows
    angles = on_z + 2 * n
    path = angles + 2 * b + 2
    absolute = path + m
    left[path + np.arange(m), s + problem.path_kind] = -1.0
    for first in (absolute, absolute + k):
        left[first + np.arange(k), y + np.arange(k)] = -1.0
    left[ranges:signs, e:v] = range_rows
    left[signs : signs + 2 * targets, v:y] = -np.eye(2 * targets)
    left[signs + 2 * targets :, s:] = -np.eye(limits)
    right = np.zeros(len(left))
    right[:targets] = -problem.target_error
    right[on_z:signs] = np.concatenate([bounds, range_bounds])

    quadratic, linear = _cost(problem, width)
    solution = solve_cone_program(
        sparse.csc_array(quadratic),
        linear,
        sparse.csc_array(left),
        right,
        equalities=on_z,
        inequalities=len(left) - on_z,
        one_dense_block=True,
    )
    x, dual = solution.primal, solution.dual
    return Step(
        z=x[:n_z],
        slack=np.maximum(x[s:], 0.0),
        target_multiplier=dual[:targets],
        angle_multiplier=dual[angles : angles + b] - dual[angles + b : angles + 2 * b],
        path_multiplier=dual[path:absolute],
        absolute_multiplier=dual[absolute : absolute + k] - dual[absolute + k : ranges],
        status=solution.status,
    )
