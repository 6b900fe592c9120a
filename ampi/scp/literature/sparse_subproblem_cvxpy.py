"""The convex subproblem of `sparse_subproblem`, Eq. (1), stated in cvxpy.

The readable form of what `solve_sparse_subproblem` assembles for Clarabel: the same data, the same
step, with any conic solver that cvxpy knows. It is also the place for a convex constraint of one's own:

    def stay_south(x, u):                         # x (n, n_x), u (n, n_u): cvxpy expressions, scaled
        return [x[:, 2] <= np.radians(31.0)]      # latitude, node by node

    subproblem = partial(solve_sparse_subproblem_cvxpy, extra_constraints=stay_south)
    ampi.solve(mission, method="wang2020", subproblem=subproblem)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray

from ampi.scp.cone_program import ConeStatus
from ampi.scp.literature.sparse_subproblem import SparseStep, SparseSubproblem

Array = NDArray[np.float64]

ExtraConstraints = Callable[[Any, Any], list[cp.Constraint]]


def solve_sparse_subproblem_cvxpy(
    problem: SparseSubproblem,
    extra_constraints: ExtraConstraints | None = None,
    solver: str = "CLARABEL",
) -> SparseStep:
    """Solve Eq. (1) of `sparse_subproblem` through cvxpy.

    Parameters
    ----------
    problem
        Data of the subproblem.
    extra_constraints
        Given x + δx (n, n_x) and u + δu (n, n_u), scaled, returns further convex constraints.
    solver
        Name of an installed cvxpy solver for conic programs.
    """
    if solver not in cp.installed_solvers():
        raise ValueError(f"solver: expected one of {cp.installed_solvers()}, got {solver!r}")
    p = problem
    n, n_x, n_u = p.n_nodes, p.n_states, p.n_controls
    change = cp.Variable(p.width, name="change")
    relaxation = cp.Variable(nonneg=True, name="eta")
    miss = cp.Variable(len(p.target), nonneg=True, name="v")
    excess = cp.Variable(p.n_limits, nonneg=True, name="p")
    dx = cp.reshape(change[: n * n_x], (n, n_x), order="C")
    du = cp.reshape(change[n * n_x : -1], (n, n_u), order="C")

    # cvxpy overloads numpy's operators; type checkers see arrays where it builds expressions.
    change_: Any = change
    cost: Any = p.gradient @ change + 0.5 * (p.curvature @ cp.square(change))
    cost += np.array([t.price for t in p.target]) @ miss + p.limit_price * cp.sum(excess)
    for term in p.absolute:
        cost += cp.norm1(term.offset + term.rows @ change)
    trusted = change_[p.trust_rows]
    radius = np.tile(p.trust_radius, n)[p.trust_rows]
    above, below = np.isfinite(p.upper), np.isfinite(p.lower)
    constraints: list[Any] = [
        p.dynamics @ change_ == -p.residual,
        change_[p.fixed] == p.fixed_change,
        cp.abs(trusted) <= relaxation * radius,
        change_[above] <= p.upper[above],
        change_[below] >= p.lower[below],
        p.limit_rows @ change_ <= p.limit_room + excess[p.limit_kind],
    ]
    for k, held in enumerate(p.target):
        constraints.append(dx[n - 1, held.state] <= held.upper + miss[k])
        constraints.append(dx[n - 1, held.state] >= held.lower - miss[k])
    if p.trust_price is None:
        constraints.append(relaxation == 1.0)
    else:
        cost += p.trust_price * relaxation
    if p.control_cone:
        constraints.append(cp.norm(p.controls + du, axis=1) <= 1.0)
    if extra_constraints is not None:
        constraints.extend(extra_constraints(p.states + dx, p.controls + du))
    program = cp.Problem(cp.Minimize(cost), constraints)
    try:
        program.solve(solver=solver)
    except cp.error.SolverError:  # the solver gave up: an outcome, not a misuse
        return _unsolved(p, ConeStatus.NUMERICAL_ERROR)
    if change.value is None or relaxation.value is None:
        return _unsolved(p, ConeStatus.of_cvxpy(program.status))
    value = np.asarray(change.value)
    return SparseStep(
        states=value[: n * n_x].reshape(n, n_x),
        controls=value[n * n_x : -1].reshape(n, n_u),
        final=float(value[-1]),
        relaxation=float(relaxation.value),
        target_slack=np.maximum(np.asarray(miss.value), 0.0),
        limit_slack=np.maximum(np.asarray(excess.value), 0.0),
        dynamics_multipliers=np.asarray(constraints[0].dual_value).reshape(-1, n_x),
        objective=float(program.value),
        status=ConeStatus.of_cvxpy(program.status),
    )


def _unsolved(p: SparseSubproblem, status: ConeStatus) -> SparseStep:
    nan = np.full(p.width, np.nan)
    n_x = p.n_nodes * p.n_states
    return SparseStep(
        states=nan[:n_x].reshape(p.n_nodes, p.n_states),
        controls=nan[n_x:-1].reshape(p.n_nodes, p.n_controls),
        final=np.nan,
        relaxation=np.nan,
        target_slack=np.full(len(p.target), np.nan),
        limit_slack=np.full(p.n_limits, np.nan),
        dynamics_multipliers=np.full((len(p.residual) // p.n_states, p.n_states), np.nan),
        objective=np.nan,
        status=status,
    )
