"""The front door of the offline side: a mission in, a database file out.

    plan        which cases, each from which neighbours         (grid, continuation, plan)
    solve       portions of cases once their neighbours are kept, and alone what those leave
                                                                (attempts, jobs, schedule, engines)
    assemble    each block once its cases are kept              (blocks)
    merge       the blocks into one file, in index order        (writer)

Whatever is finished is on disk (records); only the last step writes the file.
"""

from __future__ import annotations

import errno
import pickle
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Thread
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset, partial_folder, stored_mission
from ampi.job import JobError
from ampi.missions.mission import Mission
from ampi.scp.capabilities import check
from ampi.scp.problem import OptimalControlProblem
from ampi.scp.solve import solve
from ampi.supervisor import require_workers
from ampi.trajectory import Status, Trajectory
from database.blocks import Block, blocks
from database.branches import STATIONS, branch_doubt, stations, suspects
from database.campaign import TIME_LIMIT, BuildError, Campaign, Solver, lost
from database.claim import claim, fingerprint_of
from database.engines import ClusterEngine, Engine, LocalEngine
from database.gains import GainSettings
from database.hdf5_file import decoded_block
from database.lock import LockedError, NoLocksError, exclusive
from database.plan import planned_tasks
from database.provenance import provenance
from database.records import (
    CaseRecord,
    block_path,
    count_records,
    discard_records,
    label_of,
    load_block,
    no_parts,
    record_path,
    recorded_cases,
)
from database.schedule import run_jobs
from database.writer import write_database

DOUBTFUL_POSITION = 50.0  # m, of a re-integrated flight
DOUBTFUL_LIMIT = 1.005
KNOWN_AT_ONCE = 256  # files open at the same time


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
    solve_seconds: float  # wall time up to the merge: solves and re-integrations
    worst_position_error: float  # m
    worst_limit: float  # greatest path constraint over its limit, between the nodes
    suspects: tuple[int, ...]  # cases that may lie on another branch (database.branches)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against flying the file as it is.

        Where re-integration contradicts what the optimiser calls solved, a mesh too coarse; and where
        neighbours seem to lie on different branches.
        """
        found = []
        if self.worst_position_error > DOUBTFUL_POSITION:
            found.append(
                f"a flight lies {self.worst_position_error:.3g} m from its optimum, expected at most "
                f"{DOUBTFUL_POSITION:g} m"
            )
        if self.worst_limit > DOUBTFUL_LIMIT:
            found.append(
                f"a flight uses {100 * self.worst_limit:.4g} % of a limit, expected at most "
                f"{100 * DOUBTFUL_LIMIT:g} %"
            )
        found = [f"{text}; refine the mesh (ampi solve --refine shows how)" for text in found]
        if self.suspects:
            found.append(branch_doubt(self.suspects, self.path))
        return tuple(found)


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
    client: Any = None,
    resume: bool = True,
    time_limit: float = TIME_LIMIT,
    gains: GainSettings | None = None,
    solver: Solver = solve,
    known: Mapping[int, KnownCase] | None = None,
    advance: Callable[[int], None] | None = None,
) -> BuildReport:
    """Solve the mission's grid and write the trajectory database.

    Interrupted at any moment, the same call continues: finished cases are kept in `PATH.partial`
    until the file is whole. The file does not depend on interruptions, nor on where cases are solved.

    Parameters
    ----------
    mission
        From `load_mission`.
    path
        HDF5 file to write; an existing one is replaced only by a whole new one.
    n_jobs
        Worker processes on this machine.
    client
        A `distributed.Client`: its workers instead; they must see the folder of `path`.
    resume
        Continue from the cases that an interrupted build has kept; False starts afresh.
    time_limit
        Of one solve (s); one that takes longer is ended, and its case tried along another path.
    gains
        Weights of the tracking gains.
    solver
        The optimiser, a function of a module: another one to measure the runner by itself.
    known
        Optima by case that are kept instead of solved, where the folder has no record yet: of a coarser
        grid, or of a database repaired.
    advance
        Called with the number of cases just finished.

    Raises
    ------
    BuildError
        If the build cannot start or go on; what is finished stays.
    """
    require_workers(n_jobs)
    if not 0.0 < time_limit < np.inf:
        raise BuildError(f"time_limit: expected a positive number of seconds, got {time_limit}")
    path = Path(path).absolute()  # what `advance` or a solver does may change the working folder
    if not path.parent.is_dir():
        raise BuildError(f"path: the folder {path.parent} does not exist")
    _refuse_unknown(mission, solver)
    _refuse_other_database(path, mission)
    folder = partial_folder(path)
    settings = gains or GainSettings()
    campaign = Campaign(mission.toml, folder, solver, time_limit, settings, build=str(uuid4()))
    try:
        pickle.dumps(campaign)
    except (pickle.PicklingError, AttributeError, TypeError):
        raise BuildError(
            f"solver: expected a function that workers can import, got {solver!r}; "
            "define it at the top of a module"
        ) from None
    with (
        _told(folder, path),
        exclusive(folder),
        no_parts(folder),
        _engine(n_jobs, client) as engine,
    ):
        # while the workers import what they need
        taken_over = {case: found.trajectory for case, found in (known or {}).items()}
        fingerprint = claim(
            folder, fingerprint_of(campaign, taken_over), mission.toml, resume=resume
        )
        campaign = replace(campaign, label=label_of(fingerprint))
        _keep_known(campaign, known or {})
        attributes = provenance(campaign, fingerprint)
        return _Build(campaign, path, attributes, engine, advance or (lambda count: None)).run()


def _keep_known(campaign: Campaign, known: Mapping[int, KnownCase]) -> None:
    """Records of the optima that are known, where there are none yet."""
    missing = [case for case in known if campaign.record(case) is None]
    for k in range(0, len(missing), KNOWN_AT_ONCE):
        campaign.keeping(
            CaseRecord(case, known[case].trajectory, known[case].message, 0, 0.0)
            for case in missing[k : k + KNOWN_AT_ONCE]
        )()


def _engine(n_jobs: int, client: Any) -> AbstractContextManager[Engine]:
    """Its workers import what they need while this process plans."""
    return closing(LocalEngine(n_jobs) if client is None else ClusterEngine(client))


@dataclass(eq=False)
class _Build:
    """One run of the build: plan, solve and assemble, merge, report."""

    campaign: Campaign
    path: Path
    attributes: Mapping[str, object]
    engine: Engine
    advance: Callable[[int], None]
    began: float = field(default_factory=time.perf_counter)

    def run(self) -> BuildReport:
        """From what is kept to the whole file."""
        campaign, grid = self.campaign, self.campaign.grid
        nominal = int(np.ravel_multi_index(grid.centre, grid.shape))
        kept = recorded_cases(campaign.folder, grid.size)
        for case in map(int, np.flatnonzero(kept)):
            if self.record(case) is None:  # what cannot be read would pass for a result
                kept[case] = False
                record_path(campaign.folder, case).unlink(missing_ok=True)
        if kept[nominal]:
            self.require_nominal(nominal)
        resumed = int(np.count_nonzero(kept))
        self.advance(resumed)

        def finished(case: int) -> None:
            if case == nominal:
                self.require_nominal(nominal)
            self.advance(1)

        tasks = planned_tasks(campaign, kept, self.engine.width)
        run_jobs(tasks, kept, self.engine, finished)
        Thread(target=self.engine.close).start()  # they end while the file is written
        solve_seconds = time.perf_counter() - self.began
        tally = _Tally(np.full((grid.size, STATIONS), np.nan, np.float32))
        final_time = self.require_nominal(nominal).trajectory.final_time
        write_database(self.path, campaign, self.attributes, final_time, tally.count(self))
        discard_records(campaign.folder)
        # the file is whole; what is left `exclusive` sees to
        shutil.rmtree(campaign.folder, ignore_errors=True)
        iterations = tally.iterations
        return BuildReport(
            path=self.path,
            cases=grid.size,
            solved=iterations.total(),
            resumed=resumed,
            failures=tuple(tally.failures),
            median_iterations=_median(iterations),
            worst_iterations=max(iterations, default=0),
            seconds=time.perf_counter() - self.began,
            solve_seconds=solve_seconds,
            worst_position_error=tally.worst_position_error,
            worst_limit=tally.worst_limit,
            suspects=tuple(suspects(grid, tally.bank)),
        )

    def record(self, case: int) -> CaseRecord | None:
        """What is kept of a case."""
        return self.campaign.record(case)

    def block(self, block: Block) -> bytes:
        """An assembled block."""
        encoded = load_block(self.campaign.folder, block.number, self.campaign.label)
        if encoded is None:
            raise BuildError(
                f"{block_path(self.campaign.folder, block.number)} has disappeared or changed during "
                "the build; run the same build again"
            )
        return encoded

    def require_nominal(self, case: int) -> CaseRecord:
        """Without a nominal optimum there is nothing to continue from, and nothing to fly."""
        record, folder = self.record(case), self.campaign.folder
        if record is None:
            raise BuildError(f"{lost(folder, case)}; run the same build again")
        if record.trajectory.status is Status.ERROR:  # no verdict: it raised, hung or was killed
            record_path(folder, case).unlink()
            raise BuildError(
                f"{self.campaign.mission.name}: the nominal problem could not be solved "
                f"({record.message}); run the same build again when that is mended"
            )
        if not record.trajectory.status.ok:
            shutil.rmtree(folder, ignore_errors=True)
            raise BuildError(
                f"{self.campaign.mission.name}: the nominal problem has no solution "
                f"({record.message}) Nothing was written; move the target, widen the limits, "
                "or try another guess"
            )
        return record


TALLIED = ("status", "iterations", "position_error", "peak", "states")


@dataclass(eq=False)
class _Tally:
    """What the report says, gathered while the blocks pass by."""

    bank: NDArray[np.float32]  # (c, s), rad: of each case at the stations; NaN if unsolved
    iterations: Counter[int] = field(default_factory=Counter)  # how many solved cases took so many
    failures: list[str] = field(default_factory=list)
    worst_position_error: float = float("nan")
    worst_limit: float = float("nan")

    def count(self, run: _Build) -> Iterator[tuple[Block, bytes]]:
        """Pass the blocks on, in index order."""
        grid = run.campaign.grid
        for block in blocks(grid.shape):
            encoded = run.block(block)
            values = decoded_block(encoded, block.shape, TALLIED)
            good = values["status"].ravel() == int(Status.SOLVED)
            cases = block.cases(grid.shape)
            bank = stations(values["states"]).reshape(-1, STATIONS)
            self.bank[cases] = np.where(good[:, None], bank, np.nan)
            self.iterations.update(values["iterations"].ravel()[good].tolist())
            if not good.all():
                messages = decoded_block(encoded, block.shape, ("message",))["message"].ravel()
                for k in np.flatnonzero(~good):
                    case = grid.describe(cases[k])
                    self.failures.append(f"{case}: {messages[k].decode('utf-8', 'replace')}")
            self.worst_position_error = _worst(self.worst_position_error, values["position_error"])
            self.worst_limit = _worst(self.worst_limit, values["peak"])
            yield block, encoded


def _median(counts: Counter[int]) -> float:
    """Of numbers that are counted; NaN of none."""
    values = np.sort(np.fromiter(counts, dtype=float))
    upto = np.cumsum([counts[int(value)] for value in values])
    half = 0.5 * counts.total()
    if half == 0.0:
        return float("nan")
    low, high = np.searchsorted(upto, half), np.searchsorted(upto, half, side="right")
    return float(0.5 * (values[low] + values[high]))


def _worst(before: float, values: np.ndarray) -> float:
    return float(np.fmax(before, np.fmax.reduce(values, axis=None)))


@contextmanager
def _told(folder: Path, path: Path) -> Iterator[None]:
    """What stops a build from outside, in one sentence that says how to go on."""
    try:
        yield
    except LockedError as locked:
        raise BuildError(
            f"{path} is being built by {locked.holder}; wait for it, or choose another path"
        ) from None
    except NoLocksError as error:
        raise BuildError(
            f"{folder}: its file system has no locks ({error}), so nothing would keep two builds of one "
            "file apart; choose a path on another file system, or mount this one with locks"
        ) from None
    except OSError as error:
        reason = error.strerror or str(error)
        way_out = _WAYS_OUT.get(error.errno or 0, "run the same build again when that is mended")
        raise BuildError(
            f"{error.filename or folder}: {reason}; {_kept(folder)}{way_out}"
        ) from None
    except JobError as error:
        raise BuildError(f"{path}: {error}; {_kept(folder)}run the same build again") from None


_WAYS_OUT = {
    errno.ENOENT: "run the same build again, or choose another path",
    errno.ENOSPC: "make room and run the same build again",
    errno.EDQUOT: "make room and run the same build again",
    errno.EFBIG: "allow larger files and run the same build again",
    errno.EROFS: "choose a folder that can be written",
    errno.EACCES: "choose a folder that can be written",
    errno.EPERM: "choose a folder that can be written",
}


def _kept(folder: Path) -> str:
    try:
        count = count_records(folder)
    except OSError:
        return ""
    return f"{count} finished cases are kept in {folder}: " if count else ""


def _refuse_unknown(mission: Mission, solver: Solver) -> None:
    """What a case asks for the optimiser must know, and all must have the same rows of the target."""
    rows = OptimalControlProblem.from_mission(mission).target.state
    points = [mission.nominal_parameters]
    for i, axis in enumerate(mission.grid_axes):
        for value in axis:
            points.append(mission.nominal_parameters)
            points[-1][i] = value
    for point in points:
        there = mission.with_parameters(point)
        if solver is solve:
            check(there, "exact_hessian")
        if not np.array_equal(OptimalControlProblem.from_mission(there).target.state, rows):
            i = int(np.flatnonzero(point != points[0])[0])
            raise BuildError(
                f"grid.{mission.parameters[i].key}: expected a target of the same rows at every point, "
                "got one row more or less where its weight is 0; leave out that point"
            )


def _refuse_other_database(path: Path, mission: Mission) -> None:
    """An existing file is replaced only by a new database of the same mission."""
    if path.exists() and stored_mission(path) != mission.toml:
        raise BuildError(
            f"{path} exists and is not a database of this mission ({mission.name}); "
            "nothing was overwritten: choose another path, or delete the file"
        )
