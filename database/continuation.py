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
    lengths, jumps = (steps.tolist() for steps in _steps_to_the_centre(grid, offset))
    plan: list[list[PlannedCase]] = []
    for layer in range(int(distance.max()) + 1):
        cases = np.flatnonzero(distance == layer).tolist()
        plan.append([PlannedCase(c, _neighbours(c, lengths[c], jumps[c])) for c in cases])
    return plan


def _steps_to_the_centre(grid: Grid, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By case and axis: how long the step towards the centre is, and how far in case numbers."""
    strides = np.cumprod([1, *grid.shape[:0:-1]])[::-1]  # C order
    lengths = np.zeros(offset.shape)
    for i, (axis, centre) in enumerate(zip(grid.axes, grid.centre, strict=True)):
        at = offset[:, i] + centre
        lengths[:, i] = np.abs(axis[at] - axis[at - np.sign(offset[:, i])]) / np.ptp(axis)
    return lengths, np.sign(offset) * strides


def _neighbours(case: int, lengths: list[float], jumps: list[int]) -> tuple[int, ...]:
    """One step towards the centre along each displaced axis: the shortest step first."""
    found = [(step, case - jump) for step, jump in zip(lengths, jumps, strict=True) if jump]
    return tuple(neighbour for _, neighbour in sorted(found))
