"""Blocks: runs of neighbouring cases that are assembled, kept and written together.

A block is one chunk of the file: as many of the last axes as fit in `BLOCK_CASES` cases, one index on
the others. Whatever the size of the grid, no process holds more than a block; and because re-integration
chooses its step for all cases of a block together, blocks depend on the shape of the grid alone, and so
do the bytes of the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import FIELDS
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.propagation import reintegrate_many
from ampi.scp.problem import OptimalControlProblem
from database.gains import GainSettings, vertex_gains
from database.grid import Grid
from database.records import CaseRecord

Array = NDArray[np.float64]

BLOCK_CASES = 256
MESSAGE_BYTES = np.dtype(FIELDS["message"].dtype).itemsize


@dataclass(frozen=True)
class Block:
    """A hyperslab of the grid."""

    number: int
    start: tuple[int, ...]
    shape: tuple[int, ...]

    @property
    def slices(self) -> tuple[slice, ...]:
        """Where it lies in the grid."""
        return tuple(
            slice(begin, begin + n) for begin, n in zip(self.start, self.shape, strict=True)
        )

    def cases(self, grid_shape: tuple[int, ...]) -> list[int]:
        """Its cases in C order."""
        index = np.indices(self.shape).reshape(len(self.shape), -1) + np.array(self.start)[:, None]
        return [int(case) for case in np.ravel_multi_index(tuple(index), grid_shape)]


def block_shape(grid_shape: tuple[int, ...]) -> tuple[int, ...]:
    """Greatest shape of a block: the last axes whole, one cut, one index on the first."""
    room, shape = BLOCK_CASES, []
    for n in reversed(grid_shape):
        shape.append(min(n, room))
        room = room // n if n <= room else 1
        room = max(room, 1)
    return tuple(reversed(shape))


def blocks(grid_shape: tuple[int, ...]) -> Iterator[Block]:
    """All blocks in index order."""
    counts = _counts(grid_shape)
    for number, index in enumerate(np.ndindex(counts)):
        yield _block(grid_shape, number, index)


def blocks_at(grid_shape: tuple[int, ...], centre: int, away: int) -> Iterator[Block]:
    """Those whose cases lie, on the first axis, up to `away` points from `centre`, and no farther."""
    counts, size = _counts(grid_shape), block_shape(grid_shape)[0]
    each = int(np.prod(counts[1:]))
    for first in range(counts[0]):
        last = min((first + 1) * size, grid_shape[0]) - 1
        if max(abs(first * size - centre), abs(last - centre)) == away:
            for k, index in enumerate(np.ndindex(counts[1:])):
                yield _block(grid_shape, first * each + k, (first, *index))


def _counts(grid_shape: tuple[int, ...]) -> tuple[int, ...]:
    """Blocks along each axis."""
    return tuple(-(-n // size) for n, size in zip(grid_shape, block_shape(grid_shape), strict=True))


def _block(grid_shape: tuple[int, ...], number: int, index: tuple[int, ...]) -> Block:
    shape = block_shape(grid_shape)
    start = tuple(i * size for i, size in zip(index, shape, strict=True))
    part = tuple(
        min(size, n - begin) for size, n, begin in zip(shape, grid_shape, start, strict=True)
    )
    return Block(number, start, part)


def assemble(
    mission: Mission, block: Block, records: list[CaseRecord], settings: GainSettings
) -> dict[str, NDArray[Any]]:
    """Everything the file holds of a block's cases, each array in the block's shape."""
    mesh = mission.pseudospectral_mesh
    cases, n = len(records), mesh.n_nodes
    states = np.stack([r.trajectory.states for r in records])
    rate = np.stack([r.trajectory.bank_rate for r in records])
    final_time = np.array([r.trajectory.final_time for r in records])
    good = np.array([r.trajectory.status.ok for r in records])
    for array in (states, rate, final_time):
        array[~good] = np.nan
    gains = np.full((cases, 7, n), np.nan)
    multipliers = np.full((cases, len(OptimalControlProblem.from_mission(mission).target)), np.nan)
    for row, record in zip(multipliers, records, strict=True):
        found = record.trajectory.target_multipliers
        if record.trajectory.status.ok and found is not None:  # a stand-in has none
            row[:] = found
    errors = {
        name: np.full(cases, np.nan) for name in ("position_error", "altitude_error", "speed_error")
    }
    peak = np.full((cases, len(PathLimits.of(mission).names)), np.nan)
    if good.any():
        grid = Grid.from_mission(mission)
        solved = [r.case for r in records if r.trajectory.status.ok]
        family = mission.family([grid.point(case) for case in solved])
        gains[good] = vertex_gains(family, mesh, states[good], final_time[good], settings)
        check = reintegrate_many(family, mesh, states[good], final_time[good])
        for name, error in errors.items():
            error[good] = getattr(check, name)
        peak[good] = check.peak
    values: dict[str, NDArray[Any]] = {
        "states": states,
        "bank_rate": rate,
        "gains": gains,
        "target_multipliers": multipliers,
        "final_time": final_time,
        "cost": np.array([r.trajectory.cost for r in records]),
        "status": np.array([int(r.trajectory.status) for r in records]),
        "iterations": np.array([r.trajectory.statistics.iterations for r in records]),
        **errors,
        "peak": peak,
        "message": np.array([_cut(r.message) for r in records], dtype=FIELDS["message"].dtype),
    }
    return {name: v.reshape(*block.shape, *v.shape[1:]) for name, v in values.items()}


def _cut(message: str) -> bytes:
    """UTF-8 of a message, cut between characters."""
    return message.encode("utf-8")[:MESSAGE_BYTES].decode("utf-8", "ignore").encode("utf-8")
