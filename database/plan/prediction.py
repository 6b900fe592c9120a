"""Where a case starts: the multilinear continuation of the cases between it and the centre.

Let c be displaced from the hypercentre along the axes A, and c − S the case one grid step nearer along
those in S ⊆ A. If the family x(p) had no mixed difference along all axes of A together,

    x(c) = Σ_{∅ ≠ S ⊆ A} (−1)^{|S|+1} x(c − S)                                   (1)

would be exact; the error is that mixed difference, far less than the step from any one neighbour, and
less with every axis. With two it reads x(c−i) + x(c−j) − x(c−i−j). It holds on uneven axes too, and all
cases on the right are solved before c's nearest neighbours are. The multipliers of the target are
continued like the states: they weigh the curvature of the first iteration, and those worked out from a
terminal error of metres were too coarse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from ampi.trajectory import Trajectory
from database.plan.grid import Grid

MOST_AXES = 6  # 63 terms, each read once by a process; the first six axes of a grid of more


def corners(grid: Grid, case: int) -> list[tuple[int, int]]:
    """(sign, case) of the terms of Eq. (1); empty with fewer than two displaced axes."""
    offset = np.array(np.unravel_index(case, grid.shape)) - np.array(grid.centre)
    strides = np.cumprod([1, *grid.shape[:0:-1]])[::-1]  # of case numbers, in C order
    steps = (np.sign(offset) * strides)[offset != 0].tolist()[:MOST_AXES]
    return [(sign, case - step) for sign, step in _terms(tuple(steps))]


def between(grid: Grid, cases: NDArray[np.int64]) -> NDArray[np.int64]:
    """All that cases (c,) may start from: neighbours and terms of Eq. (1), once each, in order."""
    offset = np.stack(np.unravel_index(cases, grid.shape), axis=1) - np.array(grid.centre)
    strides = np.cumprod([1, *grid.shape[:0:-1]])[::-1]
    steps = np.sign(offset) * strides
    first = steps
    if steps.shape[1] > MOST_AXES:
        order = np.argsort(steps == 0, axis=1, kind="stable")  # displaced axes first
        first = np.take_along_axis(steps, order[:, :MOST_AXES], axis=1)
    jumps = np.concatenate([first @ _subsets(first.shape[1]), steps], axis=1)
    return np.unique((cases[:, None] - jumps)[jumps != 0])


@lru_cache(maxsize=MOST_AXES)
def _subsets(axes: int) -> NDArray[np.int64]:
    """Every choice of axes, a column of zeros and ones each."""
    return np.array(list(product((0, 1), repeat=axes))).T


@lru_cache(maxsize=1024)  # few: the signs of the displaced axes
def _terms(steps: tuple[int, ...]) -> list[tuple[int, int]]:
    """(sign, step) of Eq. (1) for one step along each axis."""
    if len(steps) < 2:
        return []
    return [
        (1 if size % 2 else -1, sum(chosen))
        for size in range(1, len(steps) + 1)
        for chosen in combinations(steps, size)
    ]


def predicted(
    grid: Grid, case: int, solved: Callable[[int], Trajectory | None]
) -> Trajectory | None:
    """Eq. (1) from `solved` (None for a case without a solution); None if a term is missing."""
    terms = [(sign, solved(corner)) for sign, corner in corners(grid, case)]
    whole = [(sign, t) for sign, t in terms if t is not None]
    if not whole or len(whole) < len(terms):
        return None
    angle = [(s, t.angle_of_attack_rate) for s, t in whole if t.angle_of_attack_rate is not None]
    known = [(sign, t.target_multipliers) for sign, t in whole if t.target_multipliers is not None]
    return replace(
        whole[0][1],
        states=_combined([(sign, t.states) for sign, t in whole]),
        bank_rate=_combined([(sign, t.bank_rate) for sign, t in whole]),
        final_time=float(sum(sign * t.final_time for sign, t in whole)),
        target_multipliers=_combined(known) if len(known) == len(whole) else None,
        angle_of_attack_rate=_combined(angle) if len(angle) == len(whole) else None,
    )


def _combined(terms: list[tuple[int, np.ndarray]]) -> np.ndarray:
    total = np.zeros_like(terms[0][1])
    for sign, values in terms:
        if sign > 0:
            total += values
        else:
            total -= values
    return total
