"""The front door of the offline side: a mission in, a database file out."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ampi.dataset import TrajectoryDataset, partial_folder, stored_mission
from ampi.missions.mission import Mission
from ampi.scp.exact_hessian import SolverSettings
from ampi.trajectory import Trajectory
from database.continuation import layers
from database.gains import GainSettings
from database.grid import Grid
from database.jobs import (
    CaseRecord,
    load_record,
    read_fingerprint,
    record_path,
    run_layer,
    save_record,
    write_fingerprint,
)
from database.writer import package_version, write_database


class BuildError(ValueError):
    """A build that cannot start; the message says what is in its way."""


@dataclass(frozen=True)
class BuildReport:
    """What a build did."""

    path: Path
    cases: int
    solved: int
    resumed: int  # cases found already solved
    failures: tuple[str, ...]
    median_iterations: float
    worst_iterations: int
    seconds: float
    solve_seconds: float  # wall time of the solves alone
    worst_position_error: float  # m
    worst_limit: float  # greatest path constraint over its limit, between the nodes


@dataclass(frozen=True, eq=False)
class KnownCase:
    """An optimum that a build need not find again."""

    trajectory: Trajectory
    message: str  # how it was solved

    @classmethod
    def of(cls, dataset: TrajectoryDataset, case: int) -> KnownCase:
        """A case of an existing database."""
        message = dataset.message.ravel()[case].decode("utf-8", "replace")
        return cls(dataset.trajectory(case), message)


def build(
    mission: Mission,
    path: str | Path,
    *,
    n_jobs: int = 2,
    gains: GainSettings | None = None,
    known: Mapping[int, KnownCase] | None = None,
    advance: Callable[[int], None] | None = None,
) -> BuildReport:
    """Solve the mission's grid and write the trajectory database.

    Interrupted at any moment, the same call continues: finished cases are kept in `PATH.partial`
    until the file is whole.

    Parameters
    ----------
    mission
        From `load_mission`.
    path
        HDF5 file to write; an existing one is replaced only by a whole new one.
    n_jobs
        Worker processes; the file does not depend on it.
    gains
        Weights of the tracking gains.
    known
        Optima by case that are kept instead of solved, where the folder has no record yet: of a coarser
        grid, or of a database repaired.
    advance
        Called with the number of cases just finished.
    """
    began = time.perf_counter()
    path = Path(path)
    if not path.parent.is_dir():
        raise BuildError(f"path: the folder {path.parent} does not exist")
    grid, gains = Grid.from_mission(mission), gains or GainSettings()
    folder, notify = partial_folder(path), advance or (lambda count: None)
    _refuse_other_database(path, mission)
    _open_partial(folder, mission)
    for case, optimum in (known or {}).items():
        if load_record(folder, case, mission) is None:
            save_record(folder, CaseRecord(case, optimum.trajectory, optimum.message, 0, 0.0))
    resumed = 0
    for number, layer in enumerate(layers(grid)):
        open_cases = [p for p in layer if load_record(folder, p.case, mission) is None]
        resumed += len(layer) - len(open_cases)
        notify(len(layer) - len(open_cases))
        if open_cases:
            run_layer(mission.toml, folder, open_cases, n_jobs=n_jobs, advance=notify)
        if number == 0:
            _require_nominal(folder, layer[0].case, mission)
    solve_seconds = time.perf_counter() - began
    records = [_whole_record(folder, case, mission) for case in range(grid.size)]
    checks = write_database(path, mission, grid, records, gains)
    shutil.rmtree(folder)
    iterations = [r.trajectory.statistics.iterations for r in records if r.trajectory.status.ok]
    failures = tuple(
        f"{grid.describe(r.case)}: {r.message}" for r in records if not r.trajectory.status.ok
    )
    return BuildReport(
        path=path,
        cases=grid.size,
        solved=len(iterations),
        resumed=resumed,
        failures=failures,
        median_iterations=float(np.median(iterations)) if iterations else np.nan,
        worst_iterations=max(iterations, default=0),
        seconds=time.perf_counter() - began,
        solve_seconds=solve_seconds,
        worst_position_error=_greatest(checks["position_error"]),
        worst_limit=_greatest(checks["peak"]),
    )


def _greatest(values: np.ndarray) -> float:
    return float(np.nanmax(values)) if np.any(np.isfinite(values)) else float("nan")


def _refuse_other_database(path: Path, mission: Mission) -> None:
    """An existing file is replaced only by a new database of the same mission."""
    if path.exists() and stored_mission(path) != mission.toml:
        raise BuildError(
            f"{path} exists and is not a database of this mission ({mission.name}); "
            "nothing was overwritten: choose another path, or delete the file"
        )


def _require_nominal(folder: Path, case: int, mission: Mission) -> None:
    """Without a nominal optimum there is nothing to continue from, and nothing to fly."""
    record = _whole_record(folder, case, mission)
    if not record.trajectory.status.ok:
        shutil.rmtree(folder)
        raise BuildError(
            f"{mission.name}: the nominal problem has no solution: {record.message} "
            "Nothing was written; move the target, widen the limits, or try another guess"
        )


def _open_partial(folder: Path, mission: Mission) -> None:
    """Create the folder of records, or check that the one there belongs to this build."""
    settings = json.dumps(asdict(SolverSettings()), sort_keys=True)
    fingerprint = {
        "mission": mission.name,
        "mission_sha256": hashlib.sha256(mission.toml.encode()).hexdigest(),
        "solver_sha256": hashlib.sha256(settings.encode()).hexdigest(),
        "ampi_version": package_version("ampi"),
    }
    folder.mkdir(exist_ok=True)
    found = read_fingerprint(folder)
    if found is None:
        write_fingerprint(folder, fingerprint)
    elif found != fingerprint:
        differing = [k for k in fingerprint if found.get(k) != fingerprint[k]]
        raise BuildError(
            f"{folder} holds cases of another build (different {', '.join(differing)}); "
            "finish that build, choose another path, or delete the folder"
        )


def _whole_record(folder: Path, case: int, mission: Mission) -> CaseRecord:
    record = load_record(folder, case, mission)
    if record is None:  # solved, kept, and gone: someone else is at work in the folder
        raise BuildError(
            f"{record_path(folder, case)} has disappeared or changed during the build; "
            "is another process building the same file? Run the same build again"
        )
    return record
