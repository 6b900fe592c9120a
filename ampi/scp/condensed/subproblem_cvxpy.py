"""The convex subproblem of `subproblem`, Eq. (1), stated in cvxpy.

The readable form of what `solve_subproblem` writes as one matrix for Clarabel: same data, same
`Step`, multipliers of the same sign. It is some ten times slower, and is the place to try another
solver or one more convex constraint on z = (δu, δt_f, δσ₀):

    minimise   ½ zᵀH z + gᵀz + Σ w e² + Σ ν (v⁺ + v⁻) + Σ_j a_j |c_j + L_j z| + ρ Σ_k s_k
    subject to target       C z + (x_f − x_target) = e + v⁺ − v⁻
               range        e_lo ≤ e ≤ e_hi
               rate         −1 ≤ û + δû ≤ 1
               bank         σ_lo ≤ Z_σ z ≤ σ_hi
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

STATUS = {  # cvxpy's words in Clarabel's, which `Step.usable` knows
    cp.OPTIMAL: "Solved",
    cp.OPTIMAL_INACCURATE: "AlmostSolved",
}


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
        As from `solve_subproblem`. Without a solution `z` is NaN and `usable` False.
    """
    n_targets = len(problem.target_error)
    z = cp.Variable(len(problem.gradient), name="z")
    e = cp.Variable(n_targets, name="e")
    v_plus = cp.Variable(n_targets, name="v_plus")
    v_minus = cp.Variable(n_targets, name="v_minus")
    s = cp.Variable(problem.n_limits, name="s")
    y = cp.Variable(max(len(problem.absolute_value), 1), name="y")

    cost = 0.5 * cp.quad_form(z, cp.psd_wrap(problem.hessian)) + problem.gradient @ z
    miss = problem.target.weight @ cp.square(e) + problem.target_price @ (v_plus + v_minus)
    excess = problem.limit_penalty * cp.sum(s)

    # cvxpy overloads numpy's operators; type checkers see arrays where it builds expressions.
    rate_change: Any = problem.rate_rows @ z
    rate_lower, rate_upper = problem.rate_bounds
    bank_change: Any = problem.bank_rows @ z
    target: Any = problem.target_map @ z + problem.target_error == e + v_plus - v_minus
    bank_lower = bank_change >= problem.bank_lower
    bank_upper = bank_change <= problem.bank_upper
    constraints: list[cp.Constraint] = [
        target,
        rate_change <= rate_upper,
        rate_change >= rate_lower,
        bank_lower,
        bank_upper,
        cp.abs(z[problem.final_time_column]) <= problem.radius,
        v_plus >= 0.0,
        v_minus >= 0.0,
        s >= 0.0,
    ]
    bounded = np.flatnonzero(np.isfinite(problem.target.lower))
    if len(bounded) > 0:
        constraints += [
            e[bounded] >= problem.target.lower[bounded],
            e[bounded] <= problem.target.upper[bounded],
        ]
    above: Any = None
    below: Any = None
    if len(problem.absolute_value) > 0:
        inside: Any = problem.absolute_value + problem.absolute_rows @ z
        above, below = inside <= y, -inside <= y
        cost += problem.absolute_weight @ y
        constraints += [above, below]
    path: Any = None
    if len(problem.path_room) > 0:
        path = problem.path_rows @ z <= problem.path_room + s[problem.path_kind]
        constraints.append(path)
    if extra_constraints is not None:
        constraints.extend(extra_constraints(z))

    if solver not in cp.installed_solvers():
        raise ValueError(f"solver: expected one of {cp.installed_solvers()}, got {solver!r}")
    program = cp.Problem(cp.Minimize(cost + miss + excess), constraints)
    try:
        program.solve(solver=solver)
    except cp.error.SolverError:  # the solver gave up: an outcome, not a misuse
        return _unsolved(problem, "solver_error")
    if z.value is None or s.value is None:
        return _unsolved(problem, str(program.status))
    return Step(
        z=np.asarray(z.value),
        slack=np.maximum(s.value, 0.0),
        target_multiplier=np.asarray(target.dual_value),
        bank_multiplier=np.asarray(bank_upper.dual_value - bank_lower.dual_value),
        path_multiplier=np.zeros(0) if path is None else np.asarray(path.dual_value),
        absolute_multiplier=(
            np.zeros(0) if above is None else np.asarray(above.dual_value - below.dual_value)
        ),
        status=STATUS.get(program.status, str(program.status)),
    )


def _unsolved(problem: ConvexSubproblem, status: str) -> Step:
    return Step(
        z=np.full(len(problem.gradient), np.nan),
        slack=np.full(problem.n_limits, np.nan),
        target_multiplier=np.full(len(problem.target_error), np.nan),
        bank_multiplier=np.full(len(problem.bank_rows), np.nan),
        path_multiplier=np.full(len(problem.path_room), np.nan),
        absolute_multiplier=np.full(len(problem.absolute_value), np.nan),
        status=status,
    )
