"""The convex subproblem of `subproblem`, Eq. (1), stated in cvxpy.

The readable form of what `solve_subproblem` writes as one matrix for Clarabel: same data, same
`Step`, multipliers of the same sign. It is some ten times slower, and is the place to try another
solver or one more convex constraint on z = (δu, δt_f, δy₀):

    minimise   ½ zᵀH z + gᵀz + Σ w e² + Σ ν (v⁺ + v⁻) + Σ_j a_j |c_j + L_j z| + ρ Σ_k s_k
    subject to target       C z + (x_f − x_target) = e + v⁺ − v⁻
               range        e_lo ≤ e ≤ e_hi
               rate         −1 ≤ û + δû ≤ 1
               angles       y_lo ≤ Z_y z ≤ y_hi
               final_time   |δt_f| ≤ Δ
               path         GJ z ≤ 1 − g + s_k
               absolute     ±(c + L z) ≤ y
               signs        v⁺, v⁻, s ≥ 0

with y the epigraph of |·|, whose two multipliers give κ.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cvxpy as cp
import numpy as np

from ampi.scp.condensed.subproblem import ConvexSubproblem, Step
from ampi.scp.cone_program import ConeStatus


def solve_subproblem_cvxpy(
    problem: ConvexSubproblem,
    extra_constraints: Callable[[cp.Variable], list[cp.Constraint]] | None = None,
    solver: str = "CLARABEL",
) -> Step:
    """Solve Eq. (1) of `subproblem` through cvxpy.

    Parameters
    ----------
    problem
        Data of the subproblem, with radius, price and penalty set.
    extra_constraints
        Given the variable z, returns further convex constraints on it.
    solver
        Name of an installed cvxpy solver for quadratic programs.

    Returns
    -------
    Step
        As from `solve_subproblem`; without a solution not `usable`.
    """
    # cvxpy overloads numpy's operators; type checkers see arrays where it builds expressions.
    z: Any = cp.Variable(len(problem.gradient), name="z")
    e, v_plus, v_minus = (cp.Variable(len(problem.target_error)) for _ in range(3))
    s = cp.Variable(problem.n_limits, name="s")
    y = cp.Variable(max(len(problem.absolute_value), 1), name="y")
    cost = 0.5 * cp.quad_form(z, cp.psd_wrap(problem.hessian)) + problem.gradient @ z
    cost += problem.target.weight @ cp.square(e) + problem.target_price @ (v_plus + v_minus)
    cost += problem.limit_penalty * cp.sum(s)
    target: Any = problem.target_map @ z + problem.target_error == e + v_plus - v_minus
    angles = _between(problem.angle_lower, problem.angle_rows @ z, problem.angle_upper)
    rate_lower, rate_upper = problem.rate_bounds
    constraints: list[Any] = [target, *angles, v_plus >= 0.0, v_minus >= 0.0, s >= 0.0]
    constraints += _between(rate_lower, problem.rate_rows @ z, rate_upper)
    constraints.append(cp.abs(z[problem.final_time_column]) <= problem.radius)
    bounded = np.flatnonzero(np.isfinite(problem.target.lower))
    if len(bounded) > 0:
        lower, upper = problem.target.lower[bounded], problem.target.upper[bounded]
        constraints += _between(lower, e[bounded], upper)
    absolute: list[Any] = []
    if len(problem.absolute_value) > 0:
        inside: Any = problem.absolute_value + problem.absolute_rows @ z
        absolute = [inside <= y, -inside <= y]
        cost += problem.absolute_weight @ y
    path: list[Any] = []
    if len(problem.path_room) > 0:
        path = [problem.path_rows @ z <= problem.path_room + s[problem.path_kind]]
    own = [] if extra_constraints is None else extra_constraints(z)

    if solver not in cp.installed_solvers():
        raise ValueError(f"solver: expected one of {cp.installed_solvers()}, got {solver!r}")
    program = cp.Problem(cp.Minimize(cost), [*constraints, *absolute, *path, *own])
    try:
        program.solve(solver=solver)
    except cp.error.SolverError:  # the solver gave up: an outcome, not a misuse
        return _unsolved(problem, ConeStatus.NUMERICAL_ERROR)
    if z.value is None or s.value is None:
        return _unsolved(problem, ConeStatus.of_cvxpy(program.status))
    return _step(program, z, s, target, angles, path, absolute)


def _step(
    program: cp.Problem,
    z: Any,
    s: Any,
    target: Any,
    angles: list[Any],
    path: list[Any],
    absolute: list[Any],
) -> Step:
    return Step(
        z=np.asarray(z.value),
        slack=np.maximum(s.value, 0.0),
        target_multiplier=np.asarray(target.dual_value),
        angle_multiplier=np.asarray(angles[1].dual_value - angles[0].dual_value),
        path_multiplier=np.asarray(path[0].dual_value) if path else np.zeros(0),
        absolute_multiplier=(
            np.asarray(absolute[0].dual_value - absolute[1].dual_value) if absolute else np.zeros(0)
        ),
        status=ConeStatus.of_cvxpy(program.status),
    )


def _between(lower: Any, value: Any, upper: Any) -> list[Any]:
    return [value >= lower, value <= upper]


def _unsolved(problem: ConvexSubproblem, status: ConeStatus) -> Step:
    return Step(
        z=np.full(len(problem.gradient), np.nan),
        slack=np.full(problem.n_limits, np.nan),
        target_multiplier=np.full(len(problem.target_error), np.nan),
        angle_multiplier=np.full(len(problem.angle_rows), np.nan),
        path_multiplier=np.full(len(problem.path_room), np.nan),
        absolute_multiplier=np.full(len(problem.absolute_value), np.nan),
        status=status,
    )
