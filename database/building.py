"""One run of a build, from what is kept on disk to the whole file."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Thread

import numpy as np

from ampi.dataset import (
    SENSITIVITIES,
    TrajectoryDataset,
    refuse_while_written,
    seal_holds,
)
from ampi.hdf5.seal import opened
from ampi.propagation.reintegration import flown_again
from ampi.scp.problem.shortfall import outcome_sentence
from ampi.trajectory import Status, Trajectory
from ampi.workers.engines import Engine
from ampi.workers.fingerprint import differences, label_of
from database.build_report import BuildReport, Tally
from database.factory.claim import claim, fingerprint_of
from database.factory.jobs import AssembleBlock
from database.factory.schedule import Task, run_jobs
from database.factory.second_pass import second_pass
from database.factory.tasks import planned_tasks
from database.file.blocks import Block, blocks
from database.file.encoded_block import SUMMARISED, BlockSummary, EncodedBlock
from database.file.provenance import provenance
from database.file.writer import write_database
from database.records.campaign import BuildError, Campaign
from database.records.case_record import CaseRecord
from database.records.reader import RecordReader, lost
from database.records.record_files import (
    NOT_KEPT,
    Files,
    block_path,
    discard_records,
    load_block,
    record_path,
    recorded_cases,
)

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


def already_whole(
    path: Path, campaign: Campaign, known: Mapping[int, KnownOptimum]
) -> BuildReport | None:
    """What a whole file says that this build would write; refuse one that was made otherwise."""
    if not path.exists() or campaign.folder.is_dir():
        return None
    refuse_while_written(path)
    if not seal_holds(path):
        return None
    fingerprint = fingerprint_of(campaign, {k: found.trajectory for k, found in known.items()})
    expected = provenance(campaign, fingerprint)
    with opened(path) as file:
        if SENSITIVITIES in file.attrs:
            expected.setdefault(SENSITIVITIES, "none")
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


@dataclass(eq=False)
class BuildRun:
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

    @classmethod
    def begin(
        cls,
        campaign: Campaign,
        path: Path,
        known: Mapping[int, KnownOptimum],
        engine: Engine,
        advance: Callable[[int], None],
        *,
        resume: bool,
    ) -> BuildRun:
        """Claim the folder of records, and count what is kept in it; the workers import meanwhile."""
        folder, taken_over = campaign.folder, {c: one.trajectory for c, one in known.items()}
        fingerprint = claim(
            folder, fingerprint_of(campaign, taken_over), campaign.toml, resume=resume
        )
        campaign = replace(campaign, label=label_of(fingerprint))
        files, damaged = recorded_cases(folder, campaign.grid.size, campaign.label)
        for file in damaged:
            file.unlink()
        _keep_known(campaign, files, known)
        attributes = provenance(campaign, fingerprint)
        settled = {case for case, flown in taken_over.items() if not flown.status.ok}
        return cls(campaign, path, attributes, engine, advance, settled, files)

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
