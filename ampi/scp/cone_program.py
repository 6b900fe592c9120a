"""Convex cone programs, solved by Clarabel. No other module calls it.

minimise ½ yᵀPy + qᵀy   subject to   A y + s = b,   s in zeros × non-negatives × second-order cones   (1)
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]

USABLE = ("Solved", "AlmostSolved", "InsufficientProgress")


@dataclass(frozen=True, eq=False)
class ConeSolution:
    """y and the multipliers of the rows of Eq. (1); Clarabel's own word for how it ended."""

    primal: Array
    dual: Array
    objective: float
    status: str


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
) -> ConeSolution:
    """Solve Eq. (1).

    `quadratic` is upper triangular; the rows of A come in the order of the arguments' names. For
    `one_dense_block` the factorisation that was measured to be fastest on one is chosen.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
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
    return ConeSolution(
        np.array(found.x), np.array(found.z), float(found.obj_val), str(found.status)
    )
