"""Where a case starts: the multilinear continuation of the cases between it and the centre.

Let c be displaced from the hypercentre along axes i, j, k, and c − i the case one grid step nearer along
axis i. If the family x(p) had no mixed difference along the three,

    x(c) = x(c−i) + x(c−j) + x(c−k) − x(c−i−j) − x(c−i−k) − x(c−j−k) + x(c−i−j−k)       (1)

would be exact; the error is that mixed difference, far less than the step from any one neighbour. It
holds on uneven axes too, and all cases on the right are solved before c's nearest neighbours are.
With two displaced axes the first three kinds of terms reduce to x(c−i) + x(c−j) − x(c−i−j); with one
there is nothing to combine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from ampi.trajectory import Trajectory
from database.grid import Grid

MOST_AXES = 3  # seven records to read; a fourth axis gains nothing measurable


def corners(grid: Grid, case: int) -> list[tuple[float, int]]:
    """(sign, case) of the terms of Eq. (1); empty with fewer than two displaced axes."""
    index = np.array(np.unravel_index(case, grid.shape))
    step = np.sign(index - np.array(grid.centre))
    axes = [int(a) for a in np.flatnonzero(step)][:MOST_AXES]
    if len(axes) < 2:
        return []
    found = []
    for size in range(1, len(axes) + 1):
        for chosen in combinations(axes, size):
            corner = index.copy()
            corner[list(chosen)] -= step[list(chosen)]
            number = int(np.ravel_multi_index(tuple(corner), grid.shape))
            found.append(((-1.0) ** (size + 1), number))
    return found


def predicted(
    grid: Grid, case: int, solved: Callable[[int], Trajectory | None]
) -> Trajectory | None:
    """Eq. (1) from `solved` (None for a case without a solution); None if a term is missing."""
    terms = [(sign, solved(corner)) for sign, corner in corners(grid, case)]
    whole = [(sign, t) for sign, t in terms if t is not None]
    if not whole or len(whole) < len(terms):
        return None
    return replace(
        whole[0][1],
        states=np.sum([sign * t.states for sign, t in whole], axis=0),
        bank_rate=np.sum([sign * t.bank_rate for sign, t in whole], axis=0),
        final_time=float(np.sum([sign * t.final_time for sign, t in whole])),
    )
