"""What a build does when an optimiser, a process, a disk or another build is in its way."""

from __future__ import annotations

import errno
import fcntl
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import h5py
import numpy as np
import pytest

import database
from ampi.dataset import (
    DIGEST,
    DatasetError,
    TrajectoryDataset,
    partial_folder,
    read_dataset,
    seal,
)
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.trajectory import Status
from ampi.workers.fingerprint import label_of, read_fingerprint
from ampi.workers.software import software
from ampi.workers.supervisor import Supervisor
from database.factory.jobs import SolveCase
from database.factory.stand_in import neighbour_moved
from database.plan.continuation import layers
from database.plan.grid import Grid
from database.records.campaign import BuildError, Campaign
from database.records.record_files import (
    FINGERPRINTS,
    count_records,
    fingerprints,
    record_path,
    recorded_cases,
)

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent


@pytest.fixture
def misbehaving(small_database: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.setenv("AMPI_TEST_DATABASE", str(small_database))
    import misbehaving

    return misbehaving


def fast_cases(dataset: TrajectoryDataset) -> np.ndarray:
    """Which cases have the greatest speed, (p…)."""
    fast = np.zeros(dataset.shape, dtype=bool)
    fast[-1] = True  # the small mission disperses the speed first
    return fast


def test_a_hanging_attempt_is_ended_and_another_path_taken(
    small_mission: Mission, misbehaving: ModuleType, tmp_path: Path
) -> None:
    path = tmp_path / "hung.h5"
    report = database.build(
        small_mission, path, solver=misbehaving.hangs_in_native_code, time_limit=1.0
    )
    assert (report.solved, report.failures) == (9, ())
    messages = [m.decode() for m in read_dataset(path).message.ravel()]
    assert any("in 4 step(s): Converged" in m for m in messages)


def test_a_case_that_always_hangs_is_a_record_with_its_log(
    small_mission: Mission, misbehaving: ModuleType, tmp_path: Path
) -> None:
    path = tmp_path / "hung.h5"
    one_axis = small_mission.toml.replace("flight_path_angle_deg = [-0.5, 0.0, 0.5]", "")
    mission = parse_mission(one_axis)
    database.build(mission, path, solver=misbehaving.always_hangs, time_limit=1.0)
    dataset = read_dataset(path)
    assert [int(s) for s in dataset.status.ravel()] == [0, 0, int(Status.ERROR)]
    log = dataset.message.ravel()[-1].decode().split("; ")
    assert log == [
        *(f"from case 1 in {n} step(s): Stopped at the time limit of 1 s." for n in (1, 4, 16)),
        "from a constant bank angle: Stopped at the time limit of 1 s.",
    ]


def test_a_case_that_always_kills_its_worker_is_a_record(
    small_mission: Mission, misbehaving: ModuleType, tmp_path: Path
) -> None:
    path = tmp_path / "crashed.h5"
    report = database.build(small_mission, path, solver=misbehaving.crashes)
    dataset = read_dataset(path)
    assert report.solved == 6
    np.testing.assert_array_equal(dataset.status[fast_cases(dataset)], int(Status.ERROR))
    for message in dataset.message[fast_cases(dataset)]:
        assert message.decode() == "Its worker process died 3 times, by SIGSEGV."


def test_workers_that_cannot_start_end_the_build(
    small_mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ampi.workers.supervisor._SERVE", "raise SystemExit(7)")
    with pytest.raises(BuildError, match=r"died 3 times before its first job, by exit status 7"):
        database.build(small_mission, tmp_path / "a.h5")


def test_a_solver_that_workers_do_not_have_is_named(
    small_mission: Mission, misbehaving: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver = misbehaving.slow
    monkeypatch.setattr("ampi.workers.supervisor.sys.path", [p for p in sys.path if p != str(HERE)])
    with pytest.raises(BuildError, match="a worker cannot read its job: is its solver in a module"):
        database.build(small_mission, tmp_path / "a.h5", solver=solver)


def test_an_idle_worker_that_dies_is_replaced(small_mission: Mission, tmp_path: Path) -> None:
    supervisor = Supervisor("database.factory.jobs")
    plan = [p for layer in layers(Grid.from_mission(small_mission)) for p in layer]
    campaign = Campaign(small_mission.toml, tmp_path, neighbour_moved)
    for planned in plan[:3]:
        supervisor.run(SolveCase(campaign, planned.case))
        (worker,) = supervisor._free
        worker.process.kill()
        worker.process.wait()
    supervisor.close()
    assert count_records(tmp_path) == 3


def turns(folder: Path, name: str) -> list[str]:
    """The processes that have computed a `Marking`."""
    return [path.name.split()[-1] for path in sorted(folder.glob(f"{name} *"))]


def supervised(folder: Path, *jobs: Any) -> None:
    """Each once the one before has been computed, on one worker."""
    supervisor, submitted = Supervisor("database.factory.jobs", most=1), []
    with ThreadPoolExecutor(len(jobs)) as pool:
        for job in jobs:
            submitted.append(pool.submit(supervisor.run, job))
            while not turns(folder, job.name) and not submitted[-1].done():
                time.sleep(0.01)
        for done in submitted:
            done.result()
    supervisor.close()


def test_a_worker_takes_the_next_job_while_it_flushes_the_last(
    misbehaving: ModuleType, tmp_path: Path
) -> None:
    """The first can only be kept once the second is computed."""
    first = misbehaving.Marking(tmp_path, "first", flush_waits_for="second")
    supervised(tmp_path, first, misbehaving.Marking(tmp_path, "second"))
    assert first.result.exists()
    assert turns(tmp_path, "first") == turns(tmp_path, "second")


def test_what_is_being_flushed_when_the_worker_dies_runs_again(
    misbehaving: ModuleType, tmp_path: Path
) -> None:
    first = misbehaving.Marking(tmp_path, "first", flush_waits_for="second")
    second = misbehaving.Marking(tmp_path, "second", deaths=1)
    supervised(tmp_path, first, second)
    for job in (first, second):
        assert job.result.read_text() == ""  # kept, not given up
        assert len(set(turns(tmp_path, job.name))) == 2


def test_a_flush_that_always_kills_its_worker_is_given_up(
    misbehaving: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ampi.workers.supervisor.MISFORTUNES", 2)
    job = misbehaving.Marking(tmp_path, "first", dies_flushing=True)
    supervised(tmp_path, job)
    assert job.result.read_text() == "Its worker process died 2 times, by SIGKILL."
    assert len(turns(tmp_path, "first")) == 2


def test_deaths_before_a_job_has_begun_are_no_verdict_on_it(
    misbehaving: ModuleType, tmp_path: Path
) -> None:
    """Five in a row: an operator, the kernel short of memory. The job has done nothing yet."""
    job = misbehaving.Marking(tmp_path, "first", deaths=5)
    supervised(tmp_path, job)
    assert job.result.read_text() == ""  # kept
    assert len(turns(tmp_path, "first")) == 6


def test_deaths_in_an_attempt_are(misbehaving: ModuleType, tmp_path: Path) -> None:
    job = misbehaving.Marking(tmp_path, "first", deaths=5, announces=True)
    supervised(tmp_path, job)
    assert job.result.read_text() == "Its worker process died 3 times, by SIGKILL."
    assert len(turns(tmp_path, "first")) == 3


def test_time_limits_hold_though_the_parent_ignores_and_blocks_alarms(
    small_mission: Mission, misbehaving: ModuleType, tmp_path: Path
) -> None:
    """Both are inherited by children: of a scheduler's shell, of a notebook's server."""
    path = tmp_path / "a.h5"
    before = signal.signal(signal.SIGALRM, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})
    try:
        database.build(small_mission, path, solver=misbehaving.dawdles, time_limit=1.0)
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
        signal.signal(signal.SIGALRM, before)
    messages = [m.decode() for m in read_dataset(path).message.ravel()]
    assert any("in 4 step(s): Converged" in m for m in messages)


def test_workers_import_nothing_from_the_present_folder(
    small_mission: Mission,
    undisturbed: bytes,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A user's folder may hold a numpy.py, or a json.py, of their own."""
    for name in ("numpy", "json"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('this is not the library')")
    monkeypatch.chdir(tmp_path)
    database.build(small_mission, "a.h5", n_jobs=1, solver=neighbour_moved)
    assert Path("a.h5").read_bytes() == undisturbed


def test_an_attempt_that_was_stopped_meanwhile_is_begun_once_more(
    small_mission: Mission,
    misbehaving: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The alarm's clock runs on while an operator or a queue has the processes stopped."""
    path, stop = tmp_path / "a.h5", tmp_path / "stop"
    stop.touch()
    monkeypatch.setenv("AMPI_TEST_GATE", str(tmp_path))
    options: dict[str, Any] = {"solver": misbehaving.stopped_once, "n_jobs": 1}
    assert database.build(small_mission, path, time_limit=1.0, **options).solved == 9
    assert not stop.exists()
    messages = [m.decode() for m in read_dataset(path).message.ravel()]
    assert not any("time limit" in m or "in 4 step(s)" in m for m in messages)


def test_what_an_optimiser_has_started_ends_with_it(
    small_mission: Mission,
    misbehaving: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A child keeps the worker's pipe open: nobody would notice that the worker has ended."""
    monkeypatch.setenv("AMPI_TEST_GATE", str(tmp_path))
    one_axis = small_mission.toml.replace("flight_path_angle_deg = [-0.5, 0.0, 0.5]", "")
    report = database.build(
        parse_mission(one_axis),
        tmp_path / "a.h5",
        solver=misbehaving.hangs_with_a_child,
        time_limit=0.5,
    )
    assert report.solved == 2
    assert not (tmp_path / "grown up").exists()


def test_two_lost_records_are_solved_before_what_starts_from_them(
    small_mission: Mission, undisturbed: bytes, tmp_path: Path
) -> None:
    """The nominal case and a corner, with all that lies between them kept."""
    path, folder = tmp_path / "a.h5", partial_folder(tmp_path / "a.h5")
    interrupted(small_mission, path, after=9)
    label = label_of(read_fingerprint(fingerprints(folder)) or {})
    with_corner = int(recorded_cases(folder, 9, label)[0][0])
    for first in (with_corner, 4):
        record = record_path(folder, first)
        *body, last = record.read_bytes()
        record.write_bytes(bytes([*body, last ^ 1]))  # a byte that differs, whatever it was
    report = database.build(small_mission, path, n_jobs=2, solver=neighbour_moved)
    assert (report.resumed, report.solved) == (4, 9)  # without the four corners, of one portion
    assert path.read_bytes() == undisturbed


def test_records_that_cannot_be_read_stop_the_build_and_stay(
    small_mission: Mission, undisturbed: bytes, tmp_path: Path
) -> None:
    path, folder = tmp_path / "a.h5", partial_folder(tmp_path / "a.h5")
    interrupted(small_mission, path, after=5)
    kept = record_path(folder, 4)
    kept.rename(tmp_path / "away")
    kept.symlink_to(kept)  # a loop: for root as for anybody
    with pytest.raises(
        BuildError, match=r"cases_000004\.rec: Too many levels.*finished cases are kept"
    ):
        database.build(small_mission, path, n_jobs=1, solver=neighbour_moved)
    kept.unlink()
    (tmp_path / "away").rename(kept)
    assert database.build(small_mission, path, n_jobs=1, solver=neighbour_moved).resumed >= 5
    assert path.read_bytes() == undisturbed


def at(place: int, then: Callable[[], object]) -> Callable[[int], None]:
    """Calls `then` once so many cases are finished."""
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        done += count
        if count and done >= place:
            then()

    return advance


def test_sources_that_change_during_a_build_are_found_out(
    small_mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers import them as they are now, and the file would name those of the beginning."""
    before = {**software(), "source_sha256": "as it was"}
    monkeypatch.setattr("ampi.workers.supervisor.software", lambda: before)
    with pytest.raises(BuildError, match=r"a new worker process has source_sha256 .* as it was"):
        database.build(small_mission, tmp_path / "a.h5")


@contextmanager
def small_disk(folder: Path, options: str) -> Iterator[Path]:
    """A file system of its own, where the system lets us mount one."""
    folder.mkdir()
    mounted = shutil.which("mount") and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True, check=False
    )
    if not mounted or mounted.returncode != 0:
        pytest.skip("no permission to mount a small file system")
    try:
        yield folder
    finally:
        subprocess.run(["umount", folder], check=True)


@pytest.fixture(scope="module")
def undisturbed(small_mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("undisturbed") / "a.h5"
    database.build(small_mission, path, n_jobs=1, solver=neighbour_moved)
    return path.read_bytes()


# kB at which the disk is full: with the records, with the file
@pytest.mark.parametrize("size", [40, 320])
def test_a_full_disk_is_one_sentence_and_loses_nothing(
    small_mission: Mission, undisturbed: bytes, tmp_path: Path, size: int
) -> None:
    with small_disk(tmp_path / "disk", f"size={size}k") as folder:
        path = folder / "a.h5"
        with pytest.raises(
            BuildError, match=r"No space left on device.*make room and run the same"
        ):
            database.build(small_mission, path, n_jobs=1, solver=neighbour_moved)
        kept = count_records(partial_folder(path))
        assert not path.exists()
        assert not list(folder.rglob("*.tmp"))
        subprocess.run(["mount", "-o", "remount,size=8m", folder], check=True)
        report = database.build(small_mission, path, n_jobs=1, solver=neighbour_moved)
        assert report.resumed == kept
        assert path.read_bytes() == undisturbed


def test_what_a_killed_process_did_not_finish_goes(
    small_mission: Mission, undisturbed: bytes, tmp_path: Path
) -> None:
    """Before a build, another driver's; after one that gives up, what its workers were writing."""
    path = tmp_path / "a.h5"
    folder = partial_folder(path)
    folder.mkdir()
    of_another, of_a_worker = folder / "cases_000001.rec.1.tmp", folder / "cases_000008.rec.2.tmp"
    of_another.touch()

    def fails(count: int) -> None:
        assert not of_another.exists()
        of_a_worker.touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(BuildError, match="make room and run the same build again"):
        database.build(small_mission, path, n_jobs=1, solver=neighbour_moved, advance=fails)
    assert folder.is_dir()
    assert not list(folder.glob("*.tmp"))
    database.build(small_mission, path, n_jobs=1, solver=neighbour_moved)
    assert path.read_bytes() == undisturbed


def test_the_file_too_large_for_its_disk_is_one_sentence(
    small_mission: Mission, undisturbed: bytes, tmp_path: Path
) -> None:
    """Without the permission to mount: a limit on the size of files, met by the file alone."""
    path = tmp_path / "a.h5"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (120_000, before[1]))
    try:
        with pytest.raises(BuildError, match=r"File too large; 9 finished cases are kept"):
            database.build(small_mission, path, n_jobs=1, solver=neighbour_moved)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.glob("*.tmp"))
    assert database.build(small_mission, path, n_jobs=1, solver=neighbour_moved).resumed == 9
    assert path.read_bytes() == undisturbed


def test_a_read_only_folder_is_one_sentence(small_mission: Mission, tmp_path: Path) -> None:
    words = r"(Read-only file system|Permission denied); choose a folder that can be written"
    if os.geteuid() != 0:  # permissions do not bind root
        tmp_path.chmod(0o555)
        with pytest.raises(BuildError, match=words):
            database.build(small_mission, tmp_path / "a.h5")
        tmp_path.chmod(0o755)
        return
    with (
        small_disk(tmp_path / "disk", "ro") as folder,
        pytest.raises(BuildError, match=words),
    ):
        database.build(small_mission, folder / "a.h5")


def test_a_second_build_of_the_same_file_names_the_first(
    small_mission: Mission, misbehaving: ModuleType, tmp_path: Path
) -> None:
    text, path = tmp_path / "small.toml", tmp_path / "a.h5"
    text.write_text(small_mission.toml)
    first = subprocess.Popen(
        [sys.executable, "-c", "from misbehaving import main; main()", text, path, "slow"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), *sys.path])},
    )
    while not (partial_folder(path) / "build.json").exists():
        time.sleep(0.01)
    with pytest.raises(BuildError, match=rf"being built by process {first.pid} on .*wait for it"):
        database.build(small_mission, path)
    assert first.wait() == 0
    assert read_dataset(path).solved.all()


def test_the_lock_of_a_dead_process_locks_nothing(small_mission: Mission, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    partial_folder(path).mkdir()
    (partial_folder(path) / "lock").write_text("process 1 on nowhere\n")
    assert database.build(small_mission, path, n_jobs=1, solver=neighbour_moved).solved == 9
    with pytest.raises(FileNotFoundError), (partial_folder(path) / "lock").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)


def test_a_file_system_without_locks_is_one_sentence(
    small_mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(file: object, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("ampi.workers.lock.fcntl.flock", no_locks)
    with pytest.raises(BuildError, match=r"its file system has no locks \(No locks.*choose a path"):
        database.build(small_mission, tmp_path / "a.h5", solver=neighbour_moved)


def test_a_relative_path_means_what_it_meant_when_it_was_given(
    small_mission: Mission,
    undisturbed: bytes,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever is called during the build may change the working folder."""
    other = tmp_path / "other"
    other.mkdir()
    monkeypatch.chdir(tmp_path)
    database.build(
        small_mission, "a.h5", n_jobs=1, solver=neighbour_moved, advance=lambda _: os.chdir(other)
    )
    assert (tmp_path / "a.h5").read_bytes() == undisturbed
    assert list(other.iterdir()) == []


def test_what_does_not_read_back_as_it_was_written_gets_no_name(
    small_mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that answers with something else than it was given."""

    def altered(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            file.attrs[DIGEST] = "0" * 64
        seal(path)

    monkeypatch.setattr("database.file.hdf5_file.seal", altered)
    with pytest.raises(DatasetError, match="does not read back as it was written"):
        database.build(small_mission, tmp_path / "a.h5", n_jobs=1, solver=neighbour_moved)
    assert not (tmp_path / "a.h5").exists()
    assert not list(tmp_path.glob("*.tmp"))


def interrupted(mission: Mission, path: Path, after: int = 1) -> None:
    """A build that ends after so many cases."""
    with pytest.raises(ZeroDivisionError):
        database.build(
            mission, path, n_jobs=1, solver=neighbour_moved, advance=at(after, lambda: 1 // 0)
        )


def test_a_fresh_start_forgets_what_was_kept(small_mission: Mission, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    interrupted(small_mission, path)
    with pytest.raises(BuildError, match=r"another build \(different solver \(database"):
        database.build(small_mission, path)
    report = database.build(small_mission, path, n_jobs=1, solver=neighbour_moved, resume=False)
    assert (report.resumed, report.solved) == (0, 9)


def test_one_damaged_label_costs_nothing_and_two_are_told(
    small_mission: Mission, tmp_path: Path
) -> None:
    path = tmp_path / "a.h5"
    interrupted(small_mission, path)
    nominal = record_path(partial_folder(path), 4).read_bytes()
    labels = [partial_folder(path) / name for name in FINGERPRINTS]
    whole = labels[0].read_text()
    labels[0].write_text(whole.replace("shefex3", "shefex4"))
    labels[1].write_text("")
    with pytest.raises(BuildError, match=r"neither build.json nor build.copy.json can be read"):
        database.build(small_mission, path, n_jobs=1, solver=neighbour_moved)
    assert record_path(partial_folder(path), 4).read_bytes() == nominal
    labels[1].write_text(whole)
    assert database.build(small_mission, path, n_jobs=1, solver=neighbour_moved).resumed == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_jobs": 0}, "n_jobs: expected at least 1 worker process, got 0"),
        ({"time_limit": 0.0}, r"time_limit: expected a positive number of seconds, got 0\.0"),
        ({"time_limit": float("nan")}, "time_limit: expected a positive number"),
        ({"solver": lambda mission, guess=None: None}, "solver: expected a function that workers"),
    ],
)
def test_misuse_is_named(
    small_mission: Mission, tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        database.build(small_mission, tmp_path / "a.h5", **options)
