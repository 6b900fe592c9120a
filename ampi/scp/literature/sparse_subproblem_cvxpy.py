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
from dataclasses import dataclass
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
    p, change = problem, cp.Variable(problem.width, name="change")
    slacks = _Slacks.of(p)
    n, n_x, n_u = p.n_nodes, p.n_states, p.n_controls
    dx = cp.reshape(change[: n * n_x], (n, n_x), order="C")
    du = cp.reshape(change[n * n_x : -1], (n, n_u), order="C")
    constraints = _constraints(p, change, dx, du, slacks)
    if extra_constraints is not None:
        constraints.extend(extra_constraints(p.states + dx, p.controls + du))
    program = cp.Problem(cp.Minimize(_cost(p, change, slacks)), constraints)
    try:
        program.solve(solver=solver)
    except cp.error.SolverError:  # the solver gave up: an outcome, not a misuse
        return _unsolved(p, ConeStatus.NUMERICAL_ERROR)
    status = ConeStatus.of_cvxpy(program.status)
    if change.value is None or slacks.relaxation.value is None:
        return _unsolved(p, status)
    value = np.asarray(change.value)
    return SparseStep(
        states=value[: n * n_x].reshape(n, n_x),
        controls=value[n * n_x : -1].reshape(n, n_u),
        final=float(value[-1]),
        relaxation=float(slacks.relaxation.value),
        target_slack=np.maximum(np.asarray(slacks.miss.value), 0.0),
        limit_slack=np.maximum(np.asarray(slacks.excess.value), 0.0),
        dynamics_multipliers=np.asarray(constraints[0].dual_value).reshape(-1, n_x),
        objective=float(program.value),
        status=status,
    )


@dataclass(frozen=True, eq=False)
class _Slacks:
    """η, v and p of Eq. (1)."""

    relaxation: Any
    miss: Any
    excess: Any

    @classmethod
    def of(cls, p: SparseSubproblem) -> _Slacks:
        """Variables of a subproblem."""
        return cls(
            cp.Variable(nonneg=True, name="eta"),
            cp.Variable(len(p.target), nonneg=True, name="v"),
            cp.Variable(p.n_limits, nonneg=True, name="p"),
        )


# cvxpy overloads numpy's operators; type checkers see arrays where it builds expressions.
def _cost(p: SparseSubproblem, change: Any, slacks: _Slacks) -> Any:
    cost = p.gradient @ change + 0.5 * (p.curvature @ cp.square(change))
    cost += np.array([t.price for t in p.target]) @ slacks.miss
    cost += p.limit_price * cp.sum(slacks.excess)
    for term in p.absolute:
        cost += cp.norm1(term.offset + term.rows @ change)
    return cost if p.trust_price is None else cost + p.trust_price * slacks.relaxation


def _constraints(p: SparseSubproblem, change: Any, dx: Any, du: Any, slacks: _Slacks) -> list[Any]:
    radius = np.tile(p.trust_radius, p.n_nodes)[p.trust_rows]
    above, below = np.isfinite(p.upper), np.isfinite(p.lower)
    found: list[Any] = [
        p.dynamics @ change == -p.residual,
        p.prescribed @ change == p.prescribed_change,
        cp.abs(change[p.trust_rows]) <= slacks.relaxation * radius,
        change[above] <= p.upper[above],
        change[below] >= p.lower[below],
        p.limit_rows @ change <= p.limit_room + slacks.excess[p.limit_index],
    ]
    for k, held in enumerate(p.target):
        found.append(dx[-1, held.state] <= held.upper + slacks.miss[k])
        found.append(dx[-1, held.state] >= held.lower - slacks.miss[k])
    if p.trust_price is None:
        found.append(slacks.relaxation == 1.0)
    if p.control_cone:
        found.append(cp.norm(p.controls + du, axis=1) <= 1.0)
    return found


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
