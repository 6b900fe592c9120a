"""The front door of the offline side: a mission in, a database file out.

    plan        which cases, each from which neighbours         (grid, continuation, plan)
    solve       portions of cases once their neighbours are kept, and alone what those leave
                                                                (attempts, jobs, schedule, engines)
    again       what is not solved, from whatever is solved nearby  (second_pass)
    assemble    each block once its cases are kept              (blocks)
    merge       the blocks into one file, in index order        (writer)

Whatever is finished is on disk (records); only the last step writes the file.
"""

from __future__ import annotations

import math
import pickle
import shutil
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Thread
from typing import Any
from uuid import uuid4

import numpy as np

from ampi.dataset import (
    TrajectoryDataset,
    opened,
    partial_folder,
    refuse_while_written,
    seal_holds,
    stored_mission,
)
from ampi.missions.mission import Mission
from ampi.propagation.reintegration import flown_again
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.problem.capabilities import check
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.problem.shortfall import outcome_sentence
from ampi.scp.solve import solve
from ampi.tracker_design.riccati_gains import GainSettings
from ampi.trajectory import Status, Trajectory
from ampi.workers.supervisor import require_workers
from database.build_report import BuildReport, Tally
from database.estimate import MOST_EVER
from database.factory.claim import claim, differences, fingerprint_of
from database.factory.engines import ClusterEngine, Engine, LocalEngine
from database.factory.jobs import AssembleBlock
from database.factory.schedule import Task, run_jobs
from database.factory.second_pass import second_pass
from database.factory.tasks import planned_tasks
from database.file.blocks import Block, blocks
from database.file.encoded_block import SUMMARISED, BlockSummary, EncodedBlock
from database.file.provenance import provenance
from database.file.writer import write_database
from database.records.campaign import TIME_LIMIT, BuildError, Campaign, Solver, solver_name
from database.records.case_record import CaseRecord
from database.records.fingerprint import label_of
from database.records.lock import exclusive
from database.records.reader import RecordReader, lost
from database.records.record_files import (
    NOT_KEPT,
    Files,
    block_path,
    discard_records,
    load_block,
    no_parts,
    record_path,
    recorded_cases,
)
from database.stopped import told

KNOWN_AT_ONCE = 256  # records of a file


@dataclass(frozen=True, eq=False)
class KnownOptimum:
    """An optimum that a build need not find again."""

    trajectory: Trajectory
    message: str  # how it was solved

    @classmethod
    def of(cls, dataset: TrajectoryDataset, case: int) -> KnownOptimum:
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
    settings: SolverSettings | None = None,
    known: Mapping[int, KnownOptimum] | None = None,
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
        Continue from the cases that an interrupted build has kept, or find the file already whole;
        False starts afresh.
    time_limit
        Of one solve (s); one that takes longer is ended, and its case tried along another path.
    gains
        Weights of the tracking gains.
    solver
        The optimiser, a function of a module: another one to measure the runner by itself.
    settings
        Solver settings of `ampi.solve`, for every solve of the build; the defaults need no tuning.
    known
        Optima by case that are kept instead of solved, where the folder has no record yet: of a coarser
        grid, or of a database repaired.
    advance
        Called with the number of cases just finished.

    Raises
    ------
    BuildError
        If the build cannot start or go on; what is finished stays.
    MissionError
        If the mission, or a point of its grid, says what no mission file could.
    """
    if not isinstance(mission, Mission):
        raise BuildError(
            f"mission: expected a Mission, got {mission!r:.60}; load one with ampi.load_mission(name)"
        )
    mission.checked()
    require_workers(n_jobs)
    if not 0.0 < time_limit < np.inf:
        raise BuildError(f"time_limit: expected a positive number of seconds, got {time_limit}")
    size = math.prod(len(p.offsets) for p in mission.parameters)
    if size > MOST_EVER:
        raise BuildError(
            f"{mission.name}: expected a grid of at most {MOST_EVER:,} cases, got {size:,}; give its "
            "axes fewer points"
        )
    if not Path(path).parent.is_dir():
        raise BuildError(f"{path}: the folder {Path(path).parent} does not exist")
    path = Path(path).absolute()  # what `advance` or a solver does may change the working folder
    _refuse_unknown(mission, solver, settings)
    _refuse_other_database(path, mission)
    folder = partial_folder(path)
    campaign = Campaign(
        mission.toml,
        folder,
        solver,
        settings or SolverSettings(),
        time_limit,
        gains or GainSettings(),
        build=str(uuid4()),
    )
    try:
        pickle.dumps(campaign)
    except (pickle.PicklingError, AttributeError, TypeError):
        raise BuildError(
            f"solver: expected a function that workers can import, got {solver!r}; "
            "define it at the top of a module"
        ) from None
    taken_over = {case: found.trajectory for case, found in (known or {}).items()}
    if resume and path.exists() and not folder.is_dir():
        refuse_while_written(path)
        if seal_holds(path):
            return _already_whole(path, campaign, fingerprint_of(campaign, taken_over))
    with (
        told(folder, path),
        exclusive(folder),
        no_parts(folder),
        _engine(n_jobs, client) as engine,
    ):
        # while the workers import what they need
        fingerprint = claim(
            folder, fingerprint_of(campaign, taken_over), mission.toml, resume=resume
        )
        campaign = replace(campaign, label=label_of(fingerprint))
        files, damaged = recorded_cases(folder, campaign.grid.size, campaign.label)
        for file in damaged:
            file.unlink()
        _keep_known(campaign, files, known or {})
        attributes = provenance(campaign, fingerprint)
        settled = {case for case, flown in taken_over.items() if not flown.status.ok}
        notify = advance or (lambda count: None)
        return _Build(campaign, path, attributes, engine, notify, settled, files).run()


def _already_whole(path: Path, campaign: Campaign, fingerprint: dict[str, str]) -> BuildReport:
    """What the file says that this build would write; refuse one that was made otherwise."""
    expected = provenance(campaign, fingerprint)
    with opened(path) as file:
        found = {key: file.attrs.get(key) for key in expected}
        different = differences(
            {key: str(value) for key, value in found.items()},
            {key: str(value) for key, value in expected.items()},
        )
        if different:
            raise BuildError(
                f"{path} is a whole database of this mission, made otherwise (different "
                f"{', '.join(different)}); nothing was overwritten: keep it, choose another path, or "
                "build it anew with --no-resume (resume=False)"
            )
        tally, shape = Tally.of(campaign.mission), campaign.grid.shape
        for block in blocks(shape):
            values = {name: file[name][block.slices] for name in SUMMARISED}
            tally.count(block.cases(shape), BlockSummary.of(values))
    return tally.report(path, resumed=campaign.grid.size, already_whole=True)


def _keep_known(campaign: Campaign, files: Files, known: Mapping[int, KnownOptimum]) -> None:
    """Records of the optima that are known, where `files` has none yet."""
    missing = [case for case in known if files[case] == NOT_KEPT]
    for k in range(0, len(missing), KNOWN_AT_ONCE):
        cases = missing[k : k + KNOWN_AT_ONCE]
        records = [
            CaseRecord(case, known[case].trajectory, known[case].message, 0, 0.0) for case in cases
        ]
        campaign.keeping(records)()
        files[cases] = cases[0]


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
    settled: Collection[int]  # unsolved cases that are known: not to be tried again
    files: Files  # where the record of each case lies
    again: set[int] = field(default_factory=set)  # blocks that a second pass has assembled anew
    began: float = field(default_factory=time.perf_counter)

    def run(self) -> BuildReport:
        """From what is kept to the whole file."""
        campaign, grid = self.campaign, self.campaign.grid
        nominal = int(np.ravel_multi_index(grid.centre, grid.shape))
        final_time = np.nan
        if self.files[nominal] != NOT_KEPT:
            final_time = self.required(nominal).final_time
        resumed = int(np.count_nonzero(self.files != NOT_KEPT))
        self.advance(resumed)

        def finished(cases: tuple[int, ...]) -> None:
            nonlocal final_time
            if nominal in cases:  # what follows from it is being solved meanwhile
                final_time = self.required(nominal).final_time
            self.advance(len(cases))

        tasks = planned_tasks(campaign, self.files, self.engine.width)
        run_jobs(tasks, self.files, self.engine, finished)
        self.try_again()
        Thread(target=self.engine.close).start()  # they end while the file is written
        solve_seconds = time.perf_counter() - self.began
        tally = Tally.of(campaign.mission)
        write_database(self.path, campaign, self.attributes, final_time, self.tallied(tally))
        discard_records(campaign.folder)
        # the file is whole; what is left `exclusive` sees to
        shutil.rmtree(campaign.folder, ignore_errors=True)
        return tally.report(
            self.path,
            resumed=resumed,
            already_whole=False,
            seconds=time.perf_counter() - self.began,
            solve_seconds=solve_seconds,
        )

    def try_again(self) -> None:
        """A second pass over the cases that are not solved, and over the blocks that hold them.

        What raised, hung or killed its worker from every start has had its chances, dear ones.
        """
        shape, unsolved = self.campaign.grid.shape, list[int]()
        for block in blocks(shape):
            failed = self.block(block).summary.unsolved
            cases = block.cases(shape)
            found = [
                int(cases[k]) for k, (status, _) in failed.items() if status is not Status.ERROR
            ]
            found = [case for case in found if case not in self.settled]
            unsolved += found
            if found:
                self.again.add(block.number)
        if not unsolved:
            return
        self.campaign = second_pass(self.campaign, self.files, unsolved, self.engine)
        folder, label = self.campaign.round_folder, self.campaign.label
        tasks = (
            Task(AssembleBlock(self.campaign, block), block.cases(shape))
            for block in blocks(shape)
            if block.number in self.again and load_block(folder, block.number, label) is None
        )
        run_jobs(tasks, self.files, self.engine, lambda cases: None)

    def tallied(self, tally: Tally) -> Iterator[tuple[Block, EncodedBlock]]:
        """The blocks in index order, counted on the way."""
        shape = self.campaign.grid.shape
        for block in blocks(shape):
            encoded = self.block(block)
            tally.count(block.cases(shape), encoded.summary)
            yield block, encoded

    def block(self, block: Block) -> EncodedBlock:
        """An assembled block."""
        again = self.campaign.rounds and block.number in self.again
        folder = self.campaign.round_folder if again else self.campaign.folder
        encoded = load_block(folder, block.number, self.campaign.label)
        if encoded is None:
            raise BuildError(f"{lost(block_path(folder, block.number))}; run the same build again")
        return EncodedBlock.unpacked(encoded)

    def required(self, case: int) -> Trajectory:
        """The nominal optimum: without it there is nothing to continue from, and nothing to fly."""
        campaign, mission = self.campaign, self.campaign.mission
        record = RecordReader(campaign, {case: int(self.files[case])}).record(case)
        nominal, message = record.trajectory, record.message
        if nominal.status is Status.ERROR:  # no verdict: it raised, hung or was killed
            record_path(campaign.folder, case).unlink()
            raise BuildError(
                f"{mission.name}: the nominal problem could not be solved "
                f"({message}); run the same build again when that is mended"
            )
        help_ = "move the target, widen the limits"
        if nominal.status.ok and campaign.judged:
            nominal = flown_again(mission, nominal)
            message, help_ = outcome_sentence(mission, nominal), "refine the mesh, ask for a margin"
        if not nominal.status.ok:
            self.engine.close()  # what follows from it is being solved
            shutil.rmtree(campaign.folder, ignore_errors=True)
            raise BuildError(
                f"{mission.name}: the nominal problem has no solution ({message}) Nothing was "
                f"written; {help_}, or try another guess"
            )
        return nominal


def _refuse_unknown(mission: Mission, solver: Solver, settings: SolverSettings | None) -> None:
    """What a case asks for the optimiser must know, and all must have the same rows of the target."""
    if settings is not None and solver is not solve:
        raise BuildError(
            f"settings: expected None with another optimiser than ampi.solve ({solver_name(solver)}), "
            "got some; leave them out"
        )
    if not isinstance(settings, SolverSettings | None):
        raise BuildError(f"settings: expected SolverSettings or None, got {settings!r}")
    rows = OptimalControlProblem.of(mission).target.state
    points = [mission.nominal_parameters]
    for i, axis in enumerate(mission.grid_axes):
        for value in axis:
            points.append(mission.nominal_parameters)
            points[-1][i] = value
    for point in points:
        there = mission.with_parameters(point)
        if solver is solve:
            check(there, "exact_hessian")
        if not np.array_equal(OptimalControlProblem.of(there).target.state, rows):
            i = int(np.flatnonzero(point != points[0])[0])
            raise BuildError(
                f"grid.{mission.parameters[i].key}: expected a target of the same rows at every point, "
                "got one row more or less where its weight is 0; leave out that point"
            )


def _refuse_other_database(path: Path, mission: Mission) -> None:
    """An existing file is replaced only by a new database of the same mission."""
    if path.is_dir():
        raise BuildError(f"{path}: expected a file to write, got a folder")
    if path.exists() and stored_mission(path) != mission.toml:
        raise BuildError(
            f"{path} exists and is not a database of this mission ({mission.name}); "
            "nothing was overwritten: choose another path, or delete the file"
        )
