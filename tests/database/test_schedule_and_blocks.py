"""Laws of the order of work, of the blocks, and of the file they are written to."""

from __future__ import annotations

import errno
import resource
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.hdf5.file_sink import FileSink
from ampi.workers.engines import Tell
from ampi.workers.job import JobError
from database.factory.jobs import Job, Kept
from database.factory.schedule import LEAST_FORESIGHT, Task, run_jobs
from database.file.blocks import BLOCK_CASES, blocks, blocks_at
from database.file.encoded_block import COUNTED, EncodedBlock, encoded_block, stations
from database.file.hdf5_file import _write_chunks, create
from database.records.record_files import NOT_KEPT, nowhere

shapes = st.lists(st.integers(1, 5), min_size=1, max_size=6).map(tuple)


@settings(deadline=None, max_examples=40)
@given(shapes)
def test_blocks_hold_every_case_once_and_few_each(shape: tuple[int, ...]) -> None:
    seen = np.zeros(shape, dtype=int)
    flat = []
    for number, block in enumerate(blocks(shape)):
        assert block.number == number
        assert 0 < np.prod(block.shape) <= BLOCK_CASES
        seen[block.slices] += 1
        cases = block.cases(shape)
        np.testing.assert_array_equal(
            cases, np.arange(seen.size).reshape(shape)[block.slices].ravel()
        )
        flat.extend(cases)
    assert np.all(seen == 1)
    assert len(flat) == seen.size


@settings(deadline=None, max_examples=40)
@given(shapes, st.data())
def test_blocks_by_distance_on_the_first_axis_are_the_same_blocks(
    shape: tuple[int, ...], data: st.DataObject
) -> None:
    centre = data.draw(st.integers(0, shape[0] - 1))
    found = {}
    for away in range(shape[0]):
        for block in blocks_at(shape, centre, away):
            first = np.unravel_index(block.cases(shape), shape)[0]
            assert np.abs(first - centre).max() == away
            found[block.number] = block
    assert [found[number] for number in sorted(found)] == list(blocks(shape))


def test_a_long_axis_is_cut() -> None:
    assert [b.shape for b in blocks((300,))] == [(256,), (44,)]
    assert {b.shape for b in blocks((3,) * 6)} == {(1, 3, 3, 3, 3, 3)}


@dataclass(frozen=True)
class Numbered:
    """A job as far as the schedule looks at one: it solves the case of its number, or leaves it."""

    number: int
    leaves: bool = False
    result: Path = Path(__file__)

    def placed(self, files: Mapping[int, int]) -> Numbered:
        assert NOT_KEPT not in files.values()
        return self

    def evidence(self, kept: Kept) -> Path:
        return self.result

    def __str__(self) -> str:
        return f"job {self.number}"

    @property
    def cases(self) -> tuple[int, ...]:
        return (self.number,)

    def left(self, kept: Kept) -> list[Job]:
        return [] if kept else [Numbered(self.number)]  # type: ignore[list-item]


@dataclass
class ShuffledEngine:
    """Finishes what is under way in an order of its own, from another thread."""

    seed: int
    room: int = 5
    width: int = 5
    log: list[int] = field(default_factory=list)
    bad: int = -1  # the job that raises
    open: list[tuple[Job, Tell]] = field(default_factory=list)

    def submit(self, job: Job, tell: Tell) -> None:
        assert len(self.open) < self.room
        self.open.append((job, tell))
        threading.Timer(0.001, self._finish_one).start()

    def _finish_one(self) -> None:
        rng = np.random.default_rng([self.seed, len(self.log)])
        job, tell = self.open.pop(int(rng.integers(len(self.open))))
        (case,) = job.cases
        self.log.append(case)
        kept = () if job.leaves else (job.cases,)  # type: ignore[attr-defined]
        tell(RuntimeError("boom") if case == self.bad else kept)

    def close(self) -> None:
        """Nothing to end."""


@pytest.mark.parametrize("seed", range(5))
def test_no_job_runs_before_what_it_needs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 3 * LEAST_FORESIGHT
    needs = [tuple(rng.integers(0, i, 3).tolist()) if i else () for i in range(n)]
    engine, finished = ShuffledEngine(seed), list[int]()
    files = np.where(rng.random(n) < 0.2, np.arange(n), NOT_KEPT).astype(np.int32)
    leaving = rng.random(n) < 0.3
    before, looked_at = set(np.flatnonzero(files != NOT_KEPT).tolist()), 0

    def plan() -> Iterator[Task]:
        nonlocal looked_at
        for i in sorted(set(range(n)) - before):
            looked_at += 1
            assert looked_at <= len(finished) + engine.room + LEAST_FORESIGHT + 1
            yield Task(Numbered(i, bool(leaving[i])), np.array(needs[i], int))  # type: ignore[arg-type]

    run_jobs(plan(), files, engine, finished.extend)
    assert (files == np.arange(n)).all()
    assert sorted(finished) == sorted(set(range(n)) - before)
    assert sorted(engine.log) == sorted([*finished, *(i for i in finished if leaving[i])])
    for case in finished:
        for needed in set(needs[case]) - before:
            assert finished.index(needed) < finished.index(case)


def test_what_a_job_raises_ends_the_run() -> None:
    task = Task(Numbered(0), np.array([1]))  # type: ignore[arg-type]
    files = np.array([NOT_KEPT, 1], np.int32)
    with pytest.raises(RuntimeError, match="boom"):
        run_jobs([task], files, ShuffledEngine(0, bad=0), print)


def test_a_result_that_is_not_there_ends_the_run(tmp_path: Path) -> None:
    task = Task(Numbered(0, result=tmp_path / "nowhere"), np.zeros(0, int))  # type: ignore[arg-type]
    with pytest.raises(
        JobError, match=rf"job 0: its result is not in {tmp_path}; the workers must"
    ):
        run_jobs([task], nowhere(1), ShuffledEngine(0), print)


def test_a_sink_takes_everything_and_tells_later(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with FileSink(tmp_path / "a", "w+") as sink:
        assert sink.write(b"x" * 100) == 100
        sink.check()
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
        try:
            assert sink.write(b"x" * 2000) == 2000
            assert sink.truncate(5000) == 5000
            assert sink.write(b"x") == 1
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        with pytest.raises(OSError, match="File too large") as told:
            sink.check()
    assert told.value.errno == errno.EFBIG
    assert (tmp_path / "a").stat().st_size <= 1000


def test_a_block_at_the_edge_is_copied_as_hdf5_would_write_it(tmp_path: Path) -> None:
    # Chunks of whole blocks; the last block is smaller, and its chunk is filled up.
    rng = np.random.default_rng(5)
    values = {
        "states": rng.normal(size=(7, 7, 5)),
        "status": np.array([0, 3, 0, 0, 0, 5, 0]),
        "iterations": rng.integers(0, 9, 7),
        "position_error": rng.normal(size=7),
        "peak": rng.normal(size=(7, 2)),
        "message": rng.integers(0, 9, 7).astype("S1000"),
    }
    pieces = (slice(0, 3), slice(3, 6), slice(6, 7))
    path, unsolved = tmp_path / "chunks.h5", dict[int, bytes]()
    with h5py.File(path, "w") as file:
        for name, array in values.items():
            create(file, name, array.shape, (3, *array.shape[1:]))
        fields = {name: file[name].id for name in values}
        for piece in pieces:
            part = {name: array[piece] for name, array in values.items()}
            block = EncodedBlock.unpacked(encoded_block(part, (3,)).packed())
            _write_chunks(fields, (piece,), block.chunks)
            for name in COUNTED:
                counted = block.summary.numbers[name]
                assert np.array_equal(counted.reshape(part[name].shape), part[name])
            assert np.array_equal(block.summary.numbers["bank"], stations(part["states"]))
            for place, (status, message) in block.summary.unsolved.items():
                assert status == part["status"][place]
                unsolved[piece.start + place] = message
    assert unsolved == {1: values["message"][1], 5: values["message"][5]}
    with h5py.File(path) as file:
        for name, array in values.items():
            assert np.array_equal(file[name][()], array)
