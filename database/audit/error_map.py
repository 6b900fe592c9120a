"""Where does interpolating the database cost most, and where would one more point pay?

The error of multilinear interpolation is, to leading order, a sum over the axes. In a cell [l, r] of one
axis it is at most |f″| (r − l)² / 8, in its middle. Three neighbouring points a < b < c give f″ without
another solve: leave b out, predict it from a and c, and the miss δ (`coherence`, Eq. (1)) is
½ f″ (b − a)(c − b), so

    e = |δ| (r − l)² / [4 (b − a)(c − b)]                                                     (1)

for both cells of the triple; a cell of two triples takes the greater. An axis of two points leaves
nothing out: there the problem is solved in the middle of the cell, at the hypercentre and at other lines
of the grid, and e is the error found. Each cell reports the 90th percentile over the lines of the grid.

A new point in the middle of a cell takes ¾ of its e away there. With w the cell's share of its axis,

    gain = mean over the quantities of ¾ w e / Σ w e,                                         (2)

the sum over all cells of all axes; the point that pays most has the greatest gain per new case.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset
from ampi.missions.mission import Mission
from ampi.physics.state import ALTITUDE, BANK, SPEED
from ampi.scp.solve import optimum
from ampi.trajectory import Trajectory
from ampi.workers.in_order import in_workers
from ampi.workers.job import JobError, finished
from database.audit.branches import halfway
from database.audit.coherence import chord_misses, family_rows, on_turn_of_rows
from database.plan.grid import Grid

Array = NDArray[np.float64]

PERCENTILE = 90.0
COLUMNS = ("altitude_m", "speed_m_per_s", "bank_deg", "final_time_s")
ROW_OF = (ALTITUDE, SPEED, BANK, -1)  # of the states, then the final time
TO_PRINTED = np.array([1.0, 1.0, np.degrees(1.0), 1.0])
LINES = 6  # lines of the grid probed on an axis of two points


@dataclass(frozen=True)
class CellError:
    """Interpolation error in one cell of one axis, and what one more point there would bring."""

    parameter: str
    key: str  # as written in the grid; `low` and `high` are offsets in its unit
    low: float
    high: float
    source: str  # "leave-one-out" or "probes"
    errors: dict[str, float]  # 90th percentile over the lines; NaN where failed cases hide it
    gain: float  # share of the whole error that a point in the middle takes away, Eq. (2)
    new_cases: int

    @property
    def gain_per_case(self) -> float:
        """What a solve in this cell pays."""
        return self.gain / self.new_cases


def error_map(
    dataset: TrajectoryDataset, *, n_jobs: int = 2, seed: int = 2016
) -> tuple[CellError, ...]:
    """Every cell of every axis, in the order of the grid.

    Parameters
    ----------
    dataset
        From `read_dataset`.
    n_jobs
        Worker processes for the probes on axes of two points.
    seed
        Of the choice of their lines.
    """
    probed = _probed(dataset, n_jobs, seed)
    rows, cells = family_rows(dataset), []
    for i, (parameter, axis) in enumerate(
        zip(dataset.mission.parameters, dataset.axes, strict=True)
    ):
        if len(axis) > 2:
            errors, source = _left_out(axis, np.moveaxis(rows, i, 0)), "leave-one-out"
        else:
            errors, source = probed[i], "probes"
        width = np.diff(axis) / (axis[-1] - axis[0])
        cells += [(parameter, j, source, errors[j], width[j]) for j in range(len(axis) - 1)]
    weighted = np.array([w * e for *_, e, w in cells])
    total = np.nansum(weighted, axis=0)
    share = np.divide(weighted, total, out=np.zeros_like(weighted), where=total > 0.0)
    cases = int(np.prod(dataset.shape))
    return tuple(
        CellError(
            parameter=parameter.name,
            key=parameter.key,
            low=parameter.offsets[j],
            high=parameter.offsets[j + 1],
            source=source,
            errors=dict(zip(COLUMNS, e.tolist(), strict=True)),
            gain=float(0.75 * part.mean()),
            new_cases=cases // len(parameter.offsets),
        )
        for (parameter, j, source, e, _), part in zip(cells, share, strict=True)
    )


def best_cell(cells: tuple[CellError, ...], parameter: str | None = None) -> CellError:
    """Where one more point pays most, on one axis or on any; the first of equals.

    Raises
    ------
    ValueError
        If the database does not disperse `parameter`, or nothing is known of its cells.
    """
    candidates = [c for c in cells if parameter in (None, c.parameter, c.key)]
    if not candidates:
        names = ", ".join(dict.fromkeys(c.parameter for c in cells))
        raise ValueError(f"parameter: expected one of {names}, got {parameter!r}")
    candidates = [c for c in candidates if np.isfinite(c.gain)]
    if not candidates:
        raise ValueError(
            "no cell of these axes has a known error: too many cases without a solution around them"
        )
    return max(candidates, key=lambda cell: cell.gain_per_case)


def _left_out(axis: Array, rows: Array) -> Array:
    """Eq. (1) for every cell of an axis, (k − 1, 4)."""
    miss = chord_misses(axis, rows)[..., list(ROW_OF)] * TO_PRINTED
    typical = np.stack([_typical(lines) for lines in miss.reshape(len(miss), -1, len(COLUMNS))])
    step = np.diff(axis)
    curvature = typical / (4.0 * step[:-1] * step[1:])[:, None]
    error = np.full((len(step), len(COLUMNS)), np.nan)
    error[:-1] = curvature * step[:-1, None] ** 2
    error[1:] = np.fmax(error[1:], curvature * step[1:, None] ** 2)
    return error


def _typical(errors: Array) -> Array:
    """Percentile over the lines (l, 4) without those of failed cases; NaN if none is left."""
    known = errors[np.all(np.isfinite(errors), axis=1)]
    return np.percentile(known, PERCENTILE, axis=0) if len(known) else np.full(len(COLUMNS), np.nan)


def _probed(dataset: TrajectoryDataset, n_jobs: int, seed: int) -> dict[int, Array]:
    """Error in the middle of the only cell of each axis of two points, (1, 4)."""
    axes = [i for i, axis in enumerate(dataset.axes) if len(axis) == 2]
    middles = {i: _middles(dataset, i, seed) for i in axes}
    jobs = [middle for i in axes for middle in middles[i]]
    with closing(in_workers(__name__, jobs, n_jobs)) as results:
        found = {i: [next(results) for _ in middles[i]] for i in axes}
    return {i: _typical(np.array(e).reshape(-1, len(COLUMNS)))[None] for i, e in found.items()}


def _middles(dataset: TrajectoryDataset, i: int, seed: int) -> list[Middle]:
    """Of lines along axis `i` that have both ends, the nominal one first."""
    grid, solved = Grid.from_mission(dataset.mission), np.moveaxis(dataset.solved, i, 0)
    whole = np.flatnonzero(solved.all(axis=0).ravel())
    others = solved.shape[1:]
    centre = [c for j, c in enumerate(grid.centre) if j != i]
    nominal = int(np.ravel_multi_index(centre, others)) if centre else 0
    chosen = np.random.default_rng([seed, i]).permutation(whole[whole != nominal])[: LINES - 1]
    middles = []
    for line in [nominal, *sorted(chosen.tolist())]:
        at = [int(k) for k in np.unravel_index(line, others)] if centre else []
        ends = [int(np.ravel_multi_index((*at[:i], end, *at[i:]), grid.shape)) for end in range(2)]
        if all(dataset.solved.ravel()[end] for end in ends):
            point = 0.5 * (grid.point(ends[0]) + grid.point(ends[1]))
            one, other = (dataset.trajectory(end) for end in ends)
            middles.append(Middle(dataset.mission, point, one, other))
    return middles


@dataclass(frozen=True, eq=False)
class Middle:
    """A point between two optima, as a job (ampi.workers.job)."""

    mission: Mission
    point: Array
    one: Trajectory
    other: Trajectory

    def compute(self, announce: Callable[[int], None]) -> Future[Array]:
        """The interpolation error there, (4,)."""
        announce(0)
        return finished(_middle_error(self.mission, self.point, self.one, self.other))

    def without(self, attempt: int) -> Middle:
        """There is one way only."""
        return self

    def give_up(self, reason: str) -> Array:
        """A point that kills a process says nothing of the database."""
        raise JobError(f"the middle of a cell could not be solved: {reason}")


def _middle_error(mission: Mission, point: Array, one: Trajectory, other: Trajectory) -> Array:
    middle = halfway(one, other)
    truth = optimum(mission.with_parameters(point), guess=middle)
    if not truth.status.ok:
        return np.full(len(COLUMNS), np.nan)
    difference = np.abs(on_turn_of_rows(middle.states, truth.states) - truth.states).max(axis=1)
    final_time = abs(middle.final_time - truth.final_time)
    return np.append(difference, final_time)[list(ROW_OF)] * TO_PRINTED
