"""In which order the grid is solved, and from which neighbour each case starts.

From the hypercentre outwards, in layers of equal Manhattan distance. A case's neighbours lie one grid
step nearer to the centre along one axis: they are all solved before the layer begins, so the choice
never depends on timing, and the database is the same for any number of workers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from database.grid import Grid


@dataclass(frozen=True)
class PlannedCase:
    """One case and the solved cases it may start from, best first."""

    case: int
    neighbours: tuple[int, ...]


def layers(grid: Grid) -> list[list[PlannedCase]]:
    """Cases by distance from the hypercentre; the first layer is the centre alone."""
    index = np.stack(np.unravel_index(np.arange(grid.size), grid.shape), axis=1)
    offset = index - np.array(grid.centre)
    distance = np.abs(offset).sum(axis=1)
    plan: list[list[PlannedCase]] = []
    for layer in range(int(distance.max()) + 1):
        cases = np.flatnonzero(distance == layer)
        plan.append([PlannedCase(int(c), _neighbours(grid, index[c], offset[c])) for c in cases])
    return plan


def _neighbours(grid: Grid, index: np.ndarray, offset: np.ndarray) -> tuple[int, ...]:
    """One step towards the centre along each displaced axis: the shortest step first."""
    found: list[tuple[float, int]] = []
    for axis in np.flatnonzero(offset):
        towards = index.copy()
        towards[axis] -= np.sign(offset[axis])
        width = grid.axes[axis][-1] - grid.axes[axis][0]
        step = abs(grid.axes[axis][index[axis]] - grid.axes[axis][towards[axis]]) / width
        found.append((float(step), int(np.ravel_multi_index(tuple(towards), grid.shape))))
    return tuple(case for _, case in sorted(found))
