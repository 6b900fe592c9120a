"""Solving the cases in parallel. A worker keeps its own result; a failed case is a record.

Every case is one file, written under another name, flushed to disk and renamed: a worker or a driver
that dies at any moment leaves whole records only, and the next run continues from them.
"""

from __future__ import annotations

import json
import os
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from ampi.missions.mission import Mission, parse_mission
from ampi.scp.solve import solve
from ampi.trajectory import Statistics, Status, Trajectory
from database.continuation import PlannedCase
from database.grid import Grid

Array = NDArray[np.float64]

PATH_STEPS = (4, 16)  # a failed case is retried along this many steps of p


@dataclass(frozen=True, eq=False)
class CaseRecord:
    """What is kept of one case."""

    case: int
    trajectory: Trajectory
    message: str
    solves: int  # optimal control problems solved to get there
    seconds: float


def record_path(folder: Path, case: int) -> Path:
    """File of one case."""
    return folder / f"case_{case:06d}.npz"


def save_record(folder: Path, record: CaseRecord) -> None:
    """Write, flush, rename: a record is whole or absent."""
    trajectory = record.trajectory
    target = record_path(folder, record.case)
    temporary = target.with_suffix(f".{os.getpid()}.tmp")
    with temporary.open("wb") as file:
        np.savez(
            file,
            states=trajectory.states,
            bank_rate=trajectory.bank_rate,
            scalars=np.array([trajectory.final_time, trajectory.cost, record.seconds]),
            counts=np.array(
                [int(trajectory.status), trajectory.statistics.iterations, record.solves]
            ),
            limit_excess=np.array(trajectory.statistics.limit_excess),
            message=np.array(record.message),
        )
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(target)


def load_record(folder: Path, case: int, mission: Mission) -> CaseRecord | None:
    """The record of a case, or None if it is absent or damaged (then it is solved again)."""
    try:
        with record_path(folder, case).open("rb") as file, np.load(file) as data:
            final_time, cost, seconds = (float(v) for v in data["scalars"])
            status, iterations, solves = (int(v) for v in data["counts"])
            excess = data["limit_excess"]
            trajectory = Trajectory(
                mesh=mission.pseudospectral_mesh,
                states=data["states"],
                bank_rate=data["bank_rate"],
                final_time=final_time,
                cost=cost,
                status=Status(status),
                statistics=Statistics(
                    iterations=iterations,
                    limit_excess=(float(excess[0]), float(excess[1]), float(excess[2])),
                ),
            )
            return CaseRecord(case, trajectory, str(data["message"]), solves, seconds)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


@lru_cache(maxsize=4)
def _mission_and_grid(toml: str) -> tuple[Mission, Grid]:
    mission = parse_mission(toml)
    return mission, Grid.from_mission(mission)


def solve_case(toml: str, folder: str, planned: PlannedCase) -> int:
    """Worker: solve one case from its neighbours' records and keep the result. Returns the case."""
    began = time.perf_counter()
    mission, grid = _mission_and_grid(toml)
    try:
        trajectory, solves, message = _attempts(mission, grid, Path(folder), planned)
    except Exception:  # whatever it was, it belongs in the record, not in the driver
        n = mission.pseudospectral_mesh.n_nodes
        nan = np.full((7, n), np.nan)
        trajectory = Trajectory(
            mission.pseudospectral_mesh, nan, nan[0], np.nan, np.nan, Status.ERROR
        )
        solves, message = 0, traceback.format_exc()
    record = CaseRecord(planned.case, trajectory, message, solves, time.perf_counter() - began)
    save_record(Path(folder), record)
    return planned.case


def _attempts(
    mission: Mission, grid: Grid, folder: Path, planned: PlannedCase
) -> tuple[Trajectory, int, str]:
    """From each neighbour at once, then along a path in p from the first; the centre from nothing."""
    goal = grid.point(planned.case)
    if not planned.neighbours:
        trajectory = solve(mission.with_parameters(goal))
        return trajectory, 1, trajectory.status.sentence
    starts: list[tuple[int, Trajectory]] = []
    for neighbour in planned.neighbours:
        record = load_record(folder, neighbour, mission)
        if record is not None and record.trajectory.status.ok:
            starts.append((neighbour, record.trajectory))
    log: list[str] = []
    solves = 0
    best: Trajectory | None = None
    for steps in (1, *PATH_STEPS):
        for neighbour, start in starts:
            origin, trajectory = grid.point(neighbour), start
            for k in range(1, steps + 1):
                at = origin + (goal - origin) * (k / steps)
                trajectory = solve(mission.with_parameters(at), guess=trajectory)
                solves += 1
                if not trajectory.status.ok:
                    break
            log.append(f"from case {neighbour} in {steps} step(s): {trajectory.status.sentence}")
            if trajectory.status.ok:
                return trajectory, solves, log[-1]
            best = trajectory if k == steps else best
    trajectory = solve(mission.with_parameters(goal))
    log.append(f"from a constant bank angle: {trajectory.status.sentence}")
    if best is not None and not trajectory.status.ok:
        trajectory = best
    return trajectory, solves + 1, "; ".join(log)


def run_layer(
    toml: str,
    folder: Path,
    layer: list[PlannedCase],
    *,
    n_jobs: int,
    advance: Callable[[int], None],
) -> None:
    """Solve the cases of one layer on `n_jobs` processes."""
    tasks = (delayed(solve_case)(toml, str(folder), planned) for planned in layer)
    with Parallel(n_jobs=n_jobs, return_as="generator_unordered") as pool:
        finished = pool(tasks)
        try:
            for _ in finished:
                advance(1)
        except BaseException:
            with warnings.catch_warnings():
                # joblib warns that tasks under way are dropped: they are, and will be solved again
                warnings.simplefilter("ignore", UserWarning)
                finished.close()
            raise


def write_fingerprint(folder: Path, fingerprint: dict[str, str]) -> None:
    """Mark a folder of records with what made it."""
    temporary = folder / "build.json.tmp"
    temporary.write_text(json.dumps(fingerprint, indent=1, sort_keys=True), encoding="utf-8")
    temporary.replace(folder / "build.json")


def read_fingerprint(folder: Path) -> dict[str, str] | None:
    """What made the records of a folder; None if it holds none."""
    try:
        return dict(json.loads((folder / "build.json").read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return None
