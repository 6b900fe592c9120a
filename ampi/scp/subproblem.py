"""The convex subproblem, condensed, and its solution by Clarabel.

    minimise   ½ zᵀH z + gᵀz + Σ w e² + Σ ν (v⁺ + v⁻) + ρ Σ_k s_k
    subject to C z − e − v⁺ + v⁻ = −(x_f − x_target)   elastic target
               −1 ≤ û + δû ≤ 1                          bank rate, at every node
               σ_lo ≤ Z_σ z ≤ σ_hi                      bank limit and trust region, one box
               |δt_f| ≤ Δ                               trust region
               G_ik J_i z − s_k ≤ 1 − g_ik              path limits, one slack per limit
               v⁺, v⁻, s ≥ 0                                                        (1)

The target is elastic (elastic_target) and ρ Σ s_k an exact penalty, L_∞ over the nodes of one limit:
the subproblem always has a solution, and v and s say what could not be met. Columns of A are
(z | e | v⁺ | v⁻ | s), rows top to bottom

    [  C   −I  −I   I   · ]  = target          [ rate  ·   ·   ·   · ]  two-sided, as ± rows
    [  Z_σ  ·   ·   ·   · ]  two-sided         [ ±e_tf ·   ·   ·   · ]
    [  GJ   ·   ·   ·  −1 ]  limits            [  ·    ·  −I  −I  −I ]  signs

`ampi/scp/subproblem_cvxpy.py` states the same problem in cvxpy; tests hold the two together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]

USABLE = ("Solved", "AlmostSolved", "InsufficientProgress")
N_LIMITS = 3


@dataclass(frozen=True, eq=False)
class ConvexSubproblem:
    """Data of Eq. (1): n_z free variables, 4 targets, n nodes, m path rows."""

    hessian: Array  # H (n_z, n_z), positive definite
    gradient: Array  # g (n_z,)
    target_map: Array  # C (4, n_z)
    target_error: Array  # x_f − x_target (4,)
    target_weights: Array  # w (4,)
    target_price: Array  # ν (4,)
    rate_rows: Array  # (n, n_z): δû at every node
    rate: Array  # û (n,)
    bank_rows: Array  # Z_σ (n, n_z), rad
    bank_lower: Array  # (n,)
    bank_upper: Array  # (n,)
    final_time_column: int
    radius: float  # Δ
    path_rows: Array  # (m, n_z)
    path_room: Array  # 1 − g (m,)
    path_kind: NDArray[np.intp]  # (m,), which of the limits
    path_node: NDArray[np.intp]  # (m,), at which node
    limit_penalty: float  # ρ

    def with_target_error(self, error: Array) -> ConvexSubproblem:
        """The same subproblem, its target row shifted (second-order correction)."""
        return replace(self, target_error=error)


@dataclass(frozen=True, eq=False)
class Step:
    """Solution of Eq. (1) with the multipliers that enter the Lagrangian."""

    z: Array
    slack: Array  # s (3,)
    target_multiplier: Array  # λ (4,)
    bank_multiplier: Array  # (n,), upper minus lower
    path_multiplier: Array  # (m,), ≥ 0
    status: str

    @property
    def usable(self) -> bool:
        """Whether `z` may be tried; the merit function decides whether it is kept."""
        return self.status in USABLE and bool(np.all(np.isfinite(self.z)))


def solve_cone_program(
    quadratic: sparse.csc_array,
    linear: Array,
    left: sparse.csc_array,
    right: Array,
    *,
    equalities: int,
    inequalities: int,
    second_order: tuple[int, ...] = (),
) -> clarabel.DefaultSolution:
    """minimise ½ yᵀPy + qᵀy subject to A y + s = b, s in zeros × non-negatives × cones (Clarabel).

    `quadratic` is upper triangular; the rows of A come in the order of the arguments' names.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    cones = [
        clarabel.ZeroConeT(equalities),
        clarabel.NonnegativeConeT(inequalities),
        *(clarabel.SecondOrderConeT(size) for size in second_order),
    ]
    return clarabel.DefaultSolver(
        sparse.csc_matrix(quadratic),
        linear,
        sparse.csc_matrix(left),
        right,
        cones,
        settings,
    ).solve()


def _settings() -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False
    settings.max_threads = 1  # measured: fastest on one small dense block
    settings.direct_solve_method = "qdldl"
    return settings


def _signs(problem: ConvexSubproblem) -> tuple[Array, Array, int]:
    """Rows on z of the inequalities and their bounds, in the order of Eq. (1)."""
    n_z = len(problem.gradient)
    final_time = np.zeros((2, n_z))
    final_time[:, problem.final_time_column] = 1.0, -1.0
    rows = np.vstack(
        [
            problem.rate_rows,
            -problem.rate_rows,
            problem.bank_rows,
            -problem.bank_rows,
            final_time,
            problem.path_rows,
        ]
    )
    bounds = np.concatenate(
        [
            1.0 - problem.rate,
            1.0 + problem.rate,
            problem.bank_upper,
            -problem.bank_lower,
            np.full(2, problem.radius),
            problem.path_room,
        ]
    )
    return rows, bounds, len(rows) - len(problem.path_room)


def solve_subproblem(problem: ConvexSubproblem) -> Step:
    """Solve Eq. (1) with Clarabel."""
    n_z, n, m = len(problem.gradient), len(problem.rate), len(problem.path_room)
    targets = len(problem.target_error)
    rows, bounds, first_path = _signs(problem)
    n_rows, n_signed = len(rows), 2 * targets + N_LIMITS
    width = n_z + targets + n_signed
    identity = np.eye(targets)

    left = np.zeros((targets + n_rows + n_signed, width))
    left[:targets, :n_z] = problem.target_map
    left[:targets, n_z : n_z + 3 * targets] = np.hstack([-identity, -identity, identity])
    left[targets : targets + n_rows, :n_z] = rows
    first_slack = width - N_LIMITS
    left[targets + first_path + np.arange(m), first_slack + problem.path_kind] = -1.0
    left[targets + n_rows :, n_z + targets :] = -np.eye(n_signed)
    right = np.concatenate([-problem.target_error, bounds, np.zeros(n_signed)])

    quadratic = np.zeros((width, width))
    quadratic[:n_z, :n_z] = np.triu(problem.hessian)
    on_error = np.arange(n_z, n_z + targets)
    quadratic[on_error, on_error] = 2.0 * problem.target_weights
    linear = np.concatenate(
        [
            problem.gradient,
            np.zeros(targets),
            problem.target_price,
            problem.target_price,
            np.full(N_LIMITS, problem.limit_penalty),
        ]
    )
    solution = clarabel.DefaultSolver(
        sparse.csc_matrix(quadratic),
        linear,
        sparse.csc_matrix(left),
        right,
        [clarabel.ZeroConeT(targets), clarabel.NonnegativeConeT(n_rows + n_signed)],
        _settings(),
    ).solve()
    y, dual = np.array(solution.x), np.array(solution.z)
    on_rows = dual[targets : targets + n_rows]
    return Step(
        z=y[:n_z],
        slack=np.maximum(y[first_slack:], 0.0),
        target_multiplier=dual[:targets],
        bank_multiplier=on_rows[2 * n : 3 * n] - on_rows[3 * n : 4 * n],
        path_multiplier=on_rows[first_path:],
        status=str(solution.status),
    )
