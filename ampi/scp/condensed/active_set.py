"""The condensed subproblem by a primal-dual active set, where it is a small dense QP and nothing more.

Near a solution the subproblem (`subproblem`, Eq. 1) has few active rows and nothing bought off: then
e = C z + (x_f − x_target) is quadratic, s and v are zero, and what remains is

    minimise   ½ zᵀH z + gᵀz + Σ w e²   subject to   l ≤ R z ≤ u.                     (1)

With the rows A of R held at their bounds, H = L Lᵀ, K = (C; R_A) and z₀ = −H⁻¹g, one small system gives

    [K H⁻¹ Kᵀ + diag(1/2w, 0)] λ = (C z₀ + x_f − x_target; R_A z₀ − bound),   z = z₀ − H⁻¹Kᵀλ.   (2)

The next A holds the rows of A whose multiplier keeps its sign and the rows that are violated; when A
does not change, z is the exact solution. The iteration is a semi-smooth Newton method; it ends after a
few steps or not at all (along an arc on a limit it needs to begin with the rows that held the last
step), and whenever it does not, or a multiplier of the target exceeds its price, or
those of a limit exceed the penalty, `None` sends the subproblem to the interior-point solver.

An interior-point solver needs a dozen factorisations of the whole matrix and knows no warm start;
here all work is one Cholesky factor of H and triangular solves.

References
----------
Hintermüller, Ito, Kunisch (2003), SIAM J. Optim. 13, 865–888.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dtrtrs

from ampi.scp.condensed.subproblem import ConvexSubproblem, Step
from ampi.scp.cone_program import ConeStatus

Array = NDArray[np.float64]

MOST_CHANGES = 25  # of the active set
FEASIBLE = 1e-9  # a row beyond its bound by less counts as inside


@dataclass(frozen=True, eq=False)
class _Rows:
    """l ≤ R z ≤ u, in the order rates, angles, δt_f, limits."""

    matrix: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, problem: ConvexSubproblem) -> _Rows:
        """All inequalities on z."""
        final_time = np.zeros((1, len(problem.gradient)))
        final_time[0, problem.final_time_column] = 1.0
        rate = problem.rate_bounds
        radius, below = [problem.radius], np.full(len(problem.path_room), -np.inf)
        return cls(
            np.vstack([problem.rate_rows, problem.angle_rows, final_time, problem.path_rows]),
            np.concatenate([rate[0], problem.angle_lower, np.negative(radius), below]),
            np.concatenate([rate[1], problem.angle_upper, radius, problem.path_room]),
        )


def solve_active_set(problem: ConvexSubproblem) -> Step | None:
    """Solve Eq. (1); None where it is not the whole subproblem or the active set does not settle."""
    target = problem.target
    exact = target.lower == target.upper
    ranged = np.isfinite(target.lower) & ~exact
    if len(problem.absolute_value) > 0 or ranged.any():
        return None
    factor, info = dpotrf(problem.hessian, lower=1)
    if info != 0:
        return None
    rows, count = _Rows.of(problem), len(problem.target_error)
    start = -_solved(factor, problem.gradient)
    with np.errstate(divide="ignore"):
        give = np.where(exact, 0.0, 0.5 / target.weight)
    given = rows.lower == rows.upper
    side = given.astype(float)  # +1 at the upper bound, −1 at the lower
    if problem.path_held is not None:
        side[len(side) - len(problem.path_held) :] = problem.path_held
    for _ in range(MOST_CHANGES):
        active = np.flatnonzero(side)
        bound = np.where(side[active] > 0, rows.upper[active], rows.lower[active])
        kept = _solved(factor, np.vstack([problem.target_map, rows.matrix[active]]).T)  # L⁻¹Kᵀ
        system = kept.T @ kept
        system[np.arange(count), np.arange(count)] += give
        right = kept.T @ start + np.concatenate([problem.target_error, -bound])
        try:
            multiplier = np.linalg.solve(system, right)
        except np.linalg.LinAlgError:
            return None  # dependent rows
        z = _solved(factor, start - kept @ multiplier, transposed=True)
        value = rows.matrix @ z
        on_rows = np.zeros(len(side))
        on_rows[active] = multiplier[count:]
        above = (value > rows.upper + FEASIBLE) | ((side > 0) & (on_rows > 0.0))
        below = (value < rows.lower - FEASIBLE) | ((side < 0) & (on_rows < 0.0))
        following = np.where(given, 1.0, above.astype(float) - below.astype(float))
        if np.array_equal(following, side):
            return _step(problem, z, multiplier[:count], on_rows)
        side = following
    return None


def _solved(factor: Array, right: Array, *, transposed: bool = False) -> Array:
    """L⁻¹ or L⁻ᵀ times a vector or matrix."""
    return np.asarray(dtrtrs(factor, right, lower=1, trans=int(transposed))[0])


def _step(problem: ConvexSubproblem, z: Array, on_target: Array, on_rows: Array) -> Step | None:
    n, b, limits = len(problem.rate), len(problem.angle_rows), problem.n_limits
    on_path = on_rows[n + b + 1 :]
    per_limit = np.bincount(problem.path_kind, weights=on_path, minlength=limits)
    bought_off = np.any(np.abs(on_target) > problem.target_price)
    if bought_off or np.any(per_limit > problem.limit_penalty):
        return None
    return Step(
        z=z,
        slack=np.zeros(limits),
        target_multiplier=on_target,
        angle_multiplier=on_rows[n : n + b],
        path_multiplier=on_path,
        absolute_multiplier=np.zeros(0),
        status=ConeStatus.SOLVED,
    )
