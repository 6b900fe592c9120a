"""Workers of campaigns and audits: those that die cost nothing, and none outlives its driver."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from ampi.missions.loading import load_mission
from ampi.workers.engines import AHEAD
from ampi.workers.in_order import in_workers
from ampi.workers.job import JobError, finished
from tests.support.missions import text_on_grid

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
needs_proc = pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(), reason="finds the workers in /proc"
)


@dataclass(frozen=True)
class Counted:
    """Leaves a mark for every time that it begins; dies the first times, or raises, or takes long."""

    number: int
    folder: Path
    deaths: int = 0
    of_its_parent: bool = False  # are these deaths, and of itself with it
    fails: type[Exception] | None = None
    seconds: float = 0.0

    def compute(self, announce: Callable[[int], None]) -> Future[tuple[int, int]]:
        announce(0)
        begun = len(list(self.folder.glob(f"{self.number} *")))
        (self.folder / f"{self.number} {begun} by {os.getpid()}").touch()
        time.sleep(self.seconds)
        if begun < self.deaths:
            os.kill(os.getppid() if self.of_its_parent else os.getpid(), signal.SIGKILL)
            time.sleep(60.0 if self.of_its_parent else 0.0)
        if self.fails is not None:
            raise self.fails("no room")
        return finished((self.number, os.getpid()))

    def without(self, attempt: int) -> Counted:
        return self

    def give_up(self, reason: str) -> tuple[int, int]:
        raise JobError(f"number {self.number}: {reason}")


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> type[Counted]:
    """As a module that workers can import."""
    monkeypatch.syspath_prepend(HERE)
    import test_supervisor

    return test_supervisor.Counted


def results(jobs: list[Counted], n_jobs: int) -> list[tuple[int, int]]:
    return list(in_workers("test_supervisor", jobs, n_jobs))


def test_results_come_in_order_whoever_dies(counted: type[Counted], tmp_path: Path) -> None:
    """One job kills its worker twice, the first takes longest."""
    jobs = [
        counted(0, tmp_path, seconds=0.5),
        counted(1, tmp_path, deaths=2),
        *(counted(k, tmp_path) for k in range(2, 6)),
    ]
    found = results(jobs, 2)
    assert [number for number, _ in found] == list(range(6))
    assert os.getpid() not in {process for _, process in found}
    assert len(list(tmp_path.glob("1 *"))) == 3


def test_what_takes_the_results_decides_the_pace(counted: type[Counted], tmp_path: Path) -> None:
    """Jobs are asked for as results are taken: neither they nor results pile up."""
    asked: list[int] = []

    def coming() -> Iterator[Counted]:
        for k in range(40):
            asked.append(k)
            yield counted(k, tmp_path)

    with closing(in_workers("test_supervisor", coming(), 2)) as found:
        for taken, (number, _) in enumerate(found):
            assert number == taken
            assert len(asked) <= taken + 2 * AHEAD
            time.sleep(0.01)  # they could be finished by now
    assert asked == list(range(40))


def test_a_job_that_always_kills_its_worker_is_one_sentence(
    counted: type[Counted], tmp_path: Path
) -> None:
    jobs = [counted(0, tmp_path, deaths=99), counted(1, tmp_path)]
    with pytest.raises(JobError, match=r"number 0: Its worker process died 3 times, by SIGKILL\."):
        results(jobs, 2)


@dataclass(frozen=True)
class Kin(Counted):
    """Tells of itself: process, parent, leader of its group, interrupts ignored."""

    def compute(self, announce: Callable[[int], None]) -> Future[tuple[int, int, int, bool]]:  # type: ignore[override]
        time.sleep(0.2)  # for each worker has one
        ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        return finished((os.getpid(), os.getppid(), os.getpgrp(), ignored))


@pytest.mark.parametrize("forked", [True, False])
def test_workers_are_forked_from_one_process_where_that_can_be(
    counted: type[Counted], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forked: bool
) -> None:
    import test_supervisor

    monkeypatch.setattr("ampi.workers.fork_server.SUPPORTED", forked and sys.platform == "linux")
    jobs = [test_supervisor.Kin(k, tmp_path) for k in range(4)]
    found = list(in_workers("test_supervisor", jobs, 2))
    assert len({pid for pid, *_ in found}) == 2
    (parent,) = {parent for _, parent, *_ in found}
    assert (parent != os.getpid()) == (forked and sys.platform == "linux")
    assert all(group == pid and ignored for pid, _, group, ignored in found)


@needs_proc
def test_the_end_of_what_they_are_forked_from_is_no_verdict_on_a_job(
    counted: type[Counted], tmp_path: Path
) -> None:
    """Four in a row; each time both workers end, and what they were at runs again."""
    jobs = [
        counted(0, tmp_path, deaths=4, of_its_parent=True),
        *(counted(k, tmp_path) for k in range(1, 4)),
    ]
    assert [number for number, _ in results(jobs, 2)] == list(range(4))
    assert len(list(tmp_path.glob("0 *"))) == 5
    assert not list(left([int(p.name.split()[-1]) for p in tmp_path.iterdir()]))


@pytest.mark.parametrize(
    ("kind", "raised", "message"),
    [
        (OSError, OSError, "no room"),
        (MemoryError, JobError, "a worker is out of memory: no room; try fewer worker processes"),
    ],
)
def test_what_befalls_a_job_is_told_here(
    counted: type[Counted],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    kind: type[Exception],
    raised: type[Exception],
    message: str,
) -> None:
    with pytest.raises(raised, match=message):
        results([counted(0, tmp_path, fails=kind), counted(1, tmp_path)], 2)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize(("count", "n_jobs"), [(3, 1), (1, 4), (0, 2)])
def test_no_process_is_started_for_what_this_one_can_do(
    counted: type[Counted], tmp_path: Path, count: int, n_jobs: int
) -> None:
    found = results([counted(k, tmp_path) for k in range(count)], n_jobs)
    assert found == [(k, os.getpid()) for k in range(count)]


@pytest.mark.parametrize("n_jobs", [0, -1, 1.5, True, "two", None])
def test_what_is_no_number_of_workers_is_refused(n_jobs: int) -> None:
    with pytest.raises(ValueError, match="n_jobs: expected at least 1 worker process, got"):
        next(in_workers("test_supervisor", [], n_jobs))


# --- drivers that are stopped ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database of three cases, and a mission of many."""
    where = tmp_path_factory.mktemp("stopped")
    (where / "large.toml").write_text(load_mission("shefex3").toml)
    small = text_on_grid("[grid]\nspeed_m_per_s = [-70.0, 0.0, 70.0]\n")
    (where / "small.toml").write_text(small)
    finished_well(ampi(where, "build", "small.toml", "small.h5", "-j", "1"))
    return where


def ampi(folder: Path, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "ampi.cli", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=_hear,
    )


def _hear() -> None:
    """A shell's background jobs ignore the interrupt, those of nohup the end of a terminal, and so do
    their children."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def finished_well(process: subprocess.Popen[str]) -> None:
    _, told = process.communicate()
    assert (process.returncode, told) == (0, "")


def workers(process: subprocess.Popen[str]) -> list[int]:
    """Its workers: all that a child of it has forked."""
    return [pid for server in children(process.pid) for pid in children(server)]


def children(pid: int) -> list[int]:
    found = list[int]()
    for told in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            found += map(int, told.read_text().split())
    return found


def two_workers(process: subprocess.Popen[str]) -> list[int]:
    while len(found := workers(process)) < 2:
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.02)
    return found


def left(pids: list[int]) -> Iterator[int]:
    """Those of the processes that have not ended."""
    for pid in pids:
        with suppress(OSError):
            stat = Path(f"/proc/{pid}/stat").read_text()
            if stat.rsplit(")", 1)[1].split()[0] != "Z":
                yield pid


FLY = ("fly", "small.h5", "-n", "100000", "--modes", "nominal,ampi", "-j", "2")
AUDIT = ("audit", "small.h5", "--probes", "4000", "-j", "2")
BUILD = ("build", "large.toml", "large.h5", "-j", "2")


@needs_proc
@pytest.mark.parametrize(
    ("words", "number"),
    [
        (FLY, signal.SIGINT),
        (FLY, signal.SIGKILL),
        (AUDIT, signal.SIGTERM),
        (BUILD, signal.SIGHUP),
    ],
)
def test_workers_end_with_their_driver(
    folder: Path, words: tuple[str, ...], number: signal.Signals
) -> None:
    process = ampi(folder, *words)
    found = two_workers(process)
    process.send_signal(number)
    _, told = process.communicate()
    if number is signal.SIGKILL:
        assert process.returncode == -number
        until = time.monotonic() + 30.0
        while list(left(found)) and time.monotonic() < until:
            time.sleep(0.05)
    else:
        assert process.returncode == 128 + number, told
        assert told.startswith("Interrupted"), told
        assert len(told.splitlines()) == 1
    assert not list(left(found))


@needs_proc
def test_a_campaign_whose_workers_are_killed_is_the_same(folder: Path) -> None:
    """A kill in the middle of it; then a file, to the last bit that of a quiet campaign."""
    from ampi.simulation.flights_file import load_campaigns

    words = ("fly", "small.h5", "-n", "210", "--modes", "ampi", "-j")
    finished_well(ampi(folder, *words, "1", "--output", "quiet.h5"))
    process = ampi(folder, *words, "2", "--output", "killed.h5")
    os.kill(
        two_workers(process)[0], signal.SIGKILL
    )  # at once: a batch is flown in less than a second
    finished_well(process)
    quiet, killed = (load_campaigns(folder / f"{n}.h5")["ampi"] for n in ("quiet", "killed"))
    for name, value in vars(quiet).items():
        np.testing.assert_array_equal(vars(killed)[name], value, err_msg=name)


@needs_proc
def test_a_campaign_whose_workers_die_time_and_again_is_one_sentence(folder: Path) -> None:
    process = ampi(folder, *FLY)
    while process.poll() is None:
        for pid in workers(process):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.05)
    _, told = process.communicate()
    assert process.returncode == 2
    assert told.startswith("error: ")
    assert "died" in told
    assert len(told.splitlines()) == 1


def test_nothing_beside_the_users_data_is_run(folder: Path, tmp_path: Path) -> None:
    """`ampi` itself, as a command, does not look there; nor may its workers."""
    for name in ("random", "signal", "queue"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a script of the user was run')")
    call = "from ampi.cli import main; main()"
    for words in (
        ("fly", str(folder / "small.h5"), "-n", "101", "--modes", "ampi", "-j", "2"),
        ("audit", str(folder / "small.h5"), "--probes", "5", "-j", "2"),
    ):
        done = subprocess.run(
            [sys.executable, "-P", "-c", call, *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system pins no process")
def test_there_are_as_many_workers_as_processors_that_may_be_used() -> None:
    """A container, or a batch system, gives a process fewer than the machine has."""
    one = {min(os.sched_getaffinity(0))}
    done = subprocess.run(
        [sys.executable, "-m", "ampi.cli", "fly", "--help"],
        preexec_fn=lambda: os.sched_setaffinity(0, one),
        capture_output=True,
        text=True,
        check=True,
    )
    assert re.search(r"Worker processes\. \[default: 1\]", done.stdout)
