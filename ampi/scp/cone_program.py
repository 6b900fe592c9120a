"""Convex cone programs, solved by Clarabel. No other module calls it.

minimise ½ yᵀPy + qᵀy   subject to   A y + s = b,   s in zeros × non-negatives × second-order cones   (1)
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]


class ConeStatus(StrEnum):
    """How a conic solver ended, in Clarabel's words; of another solver, the nearest of them."""

    SOLVED = "Solved"
    ALMOST_SOLVED = "AlmostSolved"
    INSUFFICIENT_PROGRESS = "InsufficientProgress"
    PRIMAL_INFEASIBLE = "PrimalInfeasible"
    DUAL_INFEASIBLE = "DualInfeasible"
    ALMOST_PRIMAL_INFEASIBLE = "AlmostPrimalInfeasible"
    ALMOST_DUAL_INFEASIBLE = "AlmostDualInfeasible"
    MAX_ITERATIONS = "MaxIterations"
    MAX_TIME = "MaxTime"
    NUMERICAL_ERROR = "NumericalError"
    CALLBACK_TERMINATED = "CallbackTerminated"
    UNSOLVED = "Unsolved"

    @classmethod
    def of_cvxpy(cls, status: str) -> ConeStatus:
        """From cvxpy's word."""
        return _OF_CVXPY.get(status, cls.NUMERICAL_ERROR)

    @property
    def is_usable(self) -> bool:
        """Whether the point may be taken: its residuals are small, though perhaps not as asked."""
        usable = (ConeStatus.SOLVED, ConeStatus.ALMOST_SOLVED, ConeStatus.INSUFFICIENT_PROGRESS)
        return self in usable


_OF_CVXPY = {
    "optimal": ConeStatus.SOLVED,
    "optimal_inaccurate": ConeStatus.ALMOST_SOLVED,
    "infeasible": ConeStatus.PRIMAL_INFEASIBLE,
    "infeasible_inaccurate": ConeStatus.ALMOST_PRIMAL_INFEASIBLE,
    "unbounded": ConeStatus.DUAL_INFEASIBLE,
    "unbounded_inaccurate": ConeStatus.ALMOST_DUAL_INFEASIBLE,
    "user_limit": ConeStatus.MAX_ITERATIONS,
}


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """y and the multipliers of the rows of Eq. (1), and how it ended."""

    primal: Array
    dual: Array
    objective: float
    status: ConeStatus


def solve_cone_program(
    quadratic: sparse.csc_array,
    linear: Array,
    left: sparse.csc_array,
    right: Array,
    *,
    equalities: int,
    inequalities: int,
    second_order: tuple[int, ...] = (),
    one_dense_block: bool = False,
    equilibrated: bool = True,
) -> ConeSolution:
    """Solve Eq. (1).

    `quadratic` is upper triangular; the rows of A come in the order of the arguments' names. For
    `one_dense_block` the factorisation that was measured to be fastest on one is chosen. Rows and
    columns are `equilibrated` first, or taken as they are.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.equilibrate_enable = equilibrated
    if one_dense_block:
        settings.presolve_enable = False
        settings.direct_solve_method = "qdldl"
    cones = [
        clarabel.ZeroConeT(equalities),
        clarabel.NonnegativeConeT(inequalities),
        *(clarabel.SecondOrderConeT(size) for size in second_order),
    ]
    matrices = sparse.csc_matrix(quadratic), linear, sparse.csc_matrix(left), right
    found = clarabel.DefaultSolver(*matrices, cones, settings).solve()
    status = ConeStatus(str(found.status))
    return ConeSolution(np.array(found.x), np.array(found.z), float(found.obj_val), status)
