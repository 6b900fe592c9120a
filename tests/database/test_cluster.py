"""The same build on dask.distributed: the same bytes, also when a worker is killed midway."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import database
from ampi.dataset import partial_folder
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.trajectory import Status
from ampi.workers.engines import ClusterEngine
from ampi.workers.job import JobError
from ampi.workers.software import software
from database.factory.jobs import MODULE, Job, Kept, SolveCase
from database.plan.continuation import layers
from database.plan.grid import Grid
from database.records.campaign import BuildError, Campaign
from database.records.reader import RecordReader
from database.records.record_files import count_records, record_path

pytestmark = pytest.mark.slow

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def gate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `misbehaving.gated` waits for stands there."""
    return tmp_path_factory.mktemp("gate")


@pytest.fixture(scope="module")
def client(gate: Path) -> Iterator[Any]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("AMPI_TEST_GATE", str(gate))
        patched.syspath_prepend(Path(__file__).parent)
        with (
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=2, processes=True, dashboard_address=None
            ) as cluster,
            distributed.Client(cluster) as connected,
        ):
            yield connected


def test_a_worker_killed_midway_leaves_no_trace(
    small_mission: Mission, small_database: Path, tmp_path: Path, client: Any
) -> None:
    path = tmp_path / "cluster.h5"
    killed: list[int] = []

    def kill_one(count: int) -> None:
        done = count_records(partial_folder(path))
        if not killed and 3 <= done < 9:
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    report = database.build(small_mission, path, client=client, advance=kill_one)
    assert killed
    assert (report.solved, report.failures) == (9, ())
    assert path.read_bytes() == small_database.read_bytes()


def test_the_command_line_finds_a_scheduler(
    small_mission: Mission, small_database: Path, tmp_path: Path, client: Any
) -> None:
    (tmp_path / "small.toml").write_text(small_mission.toml)
    address = client.scheduler.address
    command = [sys.executable, "-m", "ampi.cli", "build", "small.toml", "small.h5"]
    subprocess.run([*command, "--scheduler", address], cwd=tmp_path, check=True)
    assert (tmp_path / "small.h5").read_bytes() == small_database.read_bytes()


def test_workers_without_the_folder_are_found_out(
    small_mission: Mission, tmp_path: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def elsewhere(module: str, job: Job, expected: object) -> Kept:
        """A worker whose folder of this name is another one."""
        return (job.cases,)

    monkeypatch.setattr("ampi.workers.engines.run_supervised", elsewhere)
    with pytest.raises(BuildError, match=r"case 4: its result is not in .*on a shared file system"):
        database.build(small_mission, tmp_path / "a.h5", client=client)


def test_a_worker_with_other_software_is_named(
    small_mission: Mission, tmp_path: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file names one version of each package, and every number in it is of that one."""
    versions = {**software(), "casadi_version": "2.0"}
    monkeypatch.setattr("ampi.workers.engines.software", lambda: versions)
    with pytest.raises(
        BuildError, match=r"a worker of the cluster has casadi_version .*process 2\.0"
    ):
        database.build(small_mission, tmp_path / "a.h5", client=client)


def test_a_case_that_costs_every_worker_is_a_record(
    small_mission: Mission, tmp_path: Path, client: Any
) -> None:
    case = layers(Grid.from_mission(small_mission))[1][0].case
    job = SolveCase(Campaign(small_mission.toml, tmp_path), case)
    engine = ClusterEngine(MODULE, client)
    lost = distributed.scheduler.KilledWorker("case", "tcp://here", 3)
    assert engine.outcome(job, lost) == ((case,),)
    record = RecordReader(job.campaign, {}).record(case)
    assert record.trajectory.status is Status.ERROR
    assert record.message == "The cluster lost every worker that tried it."
    full = OSError("no room")
    assert engine.outcome(job, full) is full
    other = engine.outcome(job, ValueError("boom\nbang"))
    assert isinstance(other, JobError)
    assert str(other) == "a worker of the cluster: ValueError: boom bang"


def test_a_cluster_without_workers_does_not_keep_a_build_waiting(
    small_mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ampi.workers.engines.LONELY", 0.2)
    monkeypatch.setattr("ampi.workers.engines.LOOK", 0.1)
    nobody = distributed.LocalCluster(n_workers=0, processes=True, dashboard_address=":0")
    with (
        nobody as cluster,
        distributed.Client(cluster) as client,
        pytest.raises(BuildError, match=r"no workers for 0\.2 s; start some, .*run the same build"),
    ):
        database.build(small_mission, tmp_path / "a.h5", client=client)


def test_a_worker_that_cannot_import_the_package_is_named(
    small_mission: Mission, tmp_path: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = (
        "__import__('importlib.util').util.find_spec({package!r} + '_elsewhere') is not None"
    )
    monkeypatch.setattr("ampi.workers.engines.IMPORTABLE", elsewhere)
    with pytest.raises(BuildError, match=r"the worker tcp.* cannot import ampi; install it there"):
        database.build(small_mission, tmp_path / "a.h5", client=client)


def test_a_job_of_a_build_given_up_cannot_mix_its_result_into_the_next(
    small_mission: Mission, tmp_path: Path, client: Any, gate: Path
) -> None:
    """A cluster goes on with what it has begun, and both builds keep their records in one folder."""
    from misbehaving import gated

    path, undisturbed = tmp_path / "a.h5", tmp_path / "undisturbed.h5"
    options: dict[str, Any] = {"client": client, "solver": gated}
    database.build(small_mission, undisturbed, **options)
    lighter = parse_mission(small_mission.toml.replace("mass_kg = 500.0", "mass_kg = 490.0"))
    record = record_path(partial_folder(path), 1)  # of all four beside the centre, one of them fast

    def give_up(count: int) -> None:
        if count:
            await_that((gate / "waiting").exists)
            raise ZeroDivisionError

    def let_the_other_go_on(count: int) -> None:
        if record.exists() and not (gate / "go").exists():
            ours = written(record)
            (gate / "go").touch()
            await_that(lambda: written(record) != ours)

    with pytest.raises(ZeroDivisionError):
        database.build(lighter, path, advance=at(2, give_up), **options)
    try:
        database.build(small_mission, path, resume=False, advance=let_the_other_go_on, **options)
    except BuildError as error:  # unless the scheduler has had the same case solved twice
        assert "cases_000001.rec has disappeared or changed during the build" in str(error)
        database.build(small_mission, path, **options)
    assert path.read_bytes() == undisturbed.read_bytes()


def at(place: int, then: Callable[[int], None]) -> Callable[[int], None]:
    """Calls `then` once so many cases are finished."""
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        done += count
        if done >= place:
            then(count)

    return advance


def await_that(condition: Callable[[], bool]) -> None:
    while not condition():
        time.sleep(0.01)


def written(file: Path) -> tuple[int, int]:
    """Another pair for every time a file is put in place."""
    found = file.stat()
    return found.st_ino, found.st_mtime_ns


def test_no_scheduler_at_the_address_is_one_sentence(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ampi.cli", "build", "shefex3", "a.h5"]
    done = subprocess.run(
        [*command, "--scheduler", "nonsense://here"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "--scheduler: expected the address of a running scheduler" in done.stderr
    assert "Traceback" not in done.stderr
