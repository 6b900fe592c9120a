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

from ampi.dataset import ANGLE_RATE, FIELDS
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.state import N_STATES
from ampi.propagation.reintegration import flight_checks
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.problem.shortfall import outcome_sentence
from ampi.tracker_design.riccati_gains import GainSettings, vertex_gains
from ampi.trajectory import Status
from database.plan.grid import Grid
from database.records.case_record import CaseRecord

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

    def cases(self, grid_shape: tuple[int, ...]) -> NDArray[np.int64]:
        """Its cases in C order."""
        index = np.indices(self.shape).reshape(len(self.shape), -1) + np.array(self.start)[:, None]
        return np.ravel_multi_index(tuple(index), grid_shape)


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
    mission: Mission,
    block: Block,
    records: list[CaseRecord],
    settings: GainSettings,
    *,
    judged: bool = True,
) -> dict[str, NDArray[Any]]:
    """Everything the file holds of a block's cases, each array in the block's shape.

    Every solution is flown again. If they are to be `judged`, one whose flight is another than its
    nodes say, or exceeds a limit, is none: its status is `INACCURATE`, and its errors tell why.
    """
    mesh, grid = mission.pseudospectral_mesh, Grid.from_mission(mission)
    cases = len(records)
    status = np.array([int(r.trajectory.status) for r in records])
    messages = [r.message for r in records]
    states = np.stack([r.trajectory.states for r in records])
    rates = np.stack([r.trajectory.controls for r in records])
    final_time = np.array([r.trajectory.final_time for r in records])
    errors = {
        name: np.full(cases, np.nan) for name in ("position_error", "altitude_error", "speed_error")
    }
    peak = np.full((cases, len(PathLimits.of(mission).names)), np.nan)
    solved = np.flatnonzero(status == int(Status.SOLVED))
    if len(solved):
        family = mission.family([grid.point(records[k].case) for k in solved])
        flights = flight_checks(family, mesh, states[solved], final_time[solved])
        for member, (k, flight) in enumerate(zip(solved, flights, strict=True)):
            for name, error in errors.items():
                error[k] = getattr(flight, name)
            peak[k] = list(flight.use.values())
            if judged and not flight.accurate:
                status[k] = int(Status.INACCURATE)
                optimum, attempt = records[k].trajectory, messages[k].partition(": ")[0]
                said = outcome_sentence(family.member(member), optimum.judged_by(flight))
                messages[k] = f"{attempt}: {said}"
    good = status == int(Status.SOLVED)
    for array in (states, rates, final_time):
        array[~good] = np.nan
    gains = np.full((cases, N_STATES, mesh.n_nodes), np.nan)
    if good.any():
        family = mission.family([grid.point(records[k].case) for k in np.flatnonzero(good)])
        gains[good] = vertex_gains(family, mesh, states[good], final_time[good], settings)
    values: dict[str, NDArray[Any]] = {
        "states": states,
        "bank_rate": rates[:, 0],
        **({ANGLE_RATE: rates[:, 1]} if mission.n_states > N_STATES else {}),
        "gains": gains,
        "target_multipliers": _target_multipliers(mission, records, good),
        "final_time": final_time,
        "cost": np.array([r.trajectory.cost for r in records]),
        "status": status,
        "iterations": np.array([r.trajectory.statistics.iterations for r in records]),
        **errors,
        "peak": peak,
        "message": np.array([_cut(m) for m in messages], dtype=FIELDS["message"].dtype),
    }
    return {name: v.reshape(*block.shape, *v.shape[1:]) for name, v in values.items()}


def _target_multipliers(
    mission: Mission, records: list[CaseRecord], good: NDArray[np.bool_]
) -> Array:
    """Those of the `good` cases, (c, m); NaN where there are none, as of a stand-in."""
    rows = len(OptimalControlProblem.of(mission).target)
    values = np.full((len(records), rows), np.nan)
    for row, record, ok in zip(values, records, good, strict=True):
        found = record.trajectory.target_multipliers
        if ok and found is not None:
            row[:] = found
    return values


def _cut(message: str) -> bytes:
    """UTF-8 of a message, cut between characters."""
    return message.encode("utf-8")[:MESSAGE_BYTES].decode("utf-8", "ignore").encode("utf-8")
