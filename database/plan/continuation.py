"""In which order the grid is solved, and from which neighbour each case starts.

From the hypercentre outwards, in layers of equal Manhattan distance. A case's neighbours lie one grid
step nearer to the centre along one axis: they are all solved before the layer begins, so the choice
never depends on timing, and the database is the same for any number of workers.

The grid may hold millions of cases: what is kept of each is its distance, four bytes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from database.plan.grid import Grid

Cases = NDArray[np.int64]


@dataclass(frozen=True)
class PlannedCase:
    """One case and the solved cases it may start from, best first."""

    case: int
    neighbours: tuple[int, ...]


def streamed(grid: Grid) -> Iterator[tuple[int, Cases]]:
    """Parts of layers in the order in which they are solved, each with its distance on the first axis.

    Along the first axis from the centre outwards, and at each distance there by layers, so that all of
    one index on the first axis is soon solved. The first part is the centre alone.
    """
    distance = _distances(grid)
    rows = np.arange(len(distance)) - grid.centre[0]
    for away in range(int(np.abs(rows).max()) + 1):
        here = np.flatnonzero(np.abs(rows) == away)
        there = distance[here]
        for layer in range(away, int(there.max()) + 1):
            row, column = np.nonzero(there == layer)
            yield away, here[row] * distance.shape[1] + column


def layers(grid: Grid) -> list[list[PlannedCase]]:
    """Whole layers, of a grid that is not too large for lists."""
    distance = _distances(grid).ravel()
    return [
        planned(grid, np.flatnonzero(distance == layer)) for layer in range(int(distance.max()) + 1)
    ]


def _distances(grid: Grid) -> NDArray[np.int32]:
    """Manhattan distance of every case from the centre, (first axis, all others)."""
    found = np.zeros(grid.shape, dtype=np.int32)
    for axis, (n, centre) in enumerate(zip(grid.shape, grid.centre, strict=True)):
        away = np.abs(np.arange(n, dtype=np.int32) - np.int32(centre))
        found += away.reshape([-1 if i == axis else 1 for i in range(len(grid.shape))])
    return found.reshape(grid.shape[0], -1)


def planned(grid: Grid, cases: Cases) -> list[PlannedCase]:
    """These cases with their neighbours: one step towards the centre along each displaced axis.

    The shortest step first, over the span of its axis.
    """
    index = np.stack(np.unravel_index(cases, grid.shape), axis=1)
    toward = np.sign(index - np.array(grid.centre))
    strides = np.cumprod([1, *grid.shape[:0:-1]])[::-1]  # C order
    lengths = np.zeros(index.shape)
    for i, axis in enumerate(grid.axes):
        step = axis[index[:, i]] - axis[index[:, i] - toward[:, i]]
        lengths[:, i] = np.abs(step) / np.ptp(axis)
    jumps = toward * strides
    found = []
    for i, case in enumerate(cases.tolist()):
        steps = zip(lengths[i].tolist(), jumps[i].tolist(), strict=True)
        nearest = sorted((length, case - jump) for length, jump in steps if jump)
        found.append(PlannedCase(case, tuple(neighbour for _, neighbour in nearest)))
    return found
