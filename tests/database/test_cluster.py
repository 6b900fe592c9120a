"""The same build on dask.distributed: the same bytes, also when a worker is killed midway."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import database
from ampi.dataset import partial_folder
from ampi.missions.mission import Mission
from ampi.trajectory import Status
from database.build import BuildError
from database.campaign import Campaign
from database.continuation import layers
from database.engines import ClusterEngine
from database.grid import Grid
from database.jobs import SolveCase
from database.provenance import software
from database.records import load_record

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
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
        done = len(list(partial_folder(path).glob("case_*.rec")))
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
    def elsewhere(job: object, expected: object) -> None:
        """A worker whose folder of this name is another one."""

    monkeypatch.setattr("database.engines.run_supervised", elsewhere)
    with pytest.raises(BuildError, match=r"case 4: its result is not in .*on a shared file system"):
        database.build(small_mission, tmp_path / "a.h5", client=client)


def test_a_worker_with_other_software_is_named(
    small_mission: Mission, tmp_path: Path, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file names one version of each package, and every number in it is of that one."""
    versions = {**software(), "casadi_version": "2.0"}
    monkeypatch.setattr("database.engines.software", lambda: versions)
    with pytest.raises(
        BuildError, match=r"a worker of the cluster has casadi_version .*build 2\.0"
    ):
        database.build(small_mission, tmp_path / "a.h5", client=client)


def test_a_case_that_costs_every_worker_is_a_record(
    small_mission: Mission, tmp_path: Path, client: Any
) -> None:
    planned = layers(Grid.from_mission(small_mission))[1][0]
    job = SolveCase(Campaign(small_mission.toml, tmp_path), planned)
    engine = ClusterEngine(client)
    lost = distributed.scheduler.KilledWorker("case", "tcp://here", 3)
    assert engine.outcome(job, lost) is None
    record = load_record(tmp_path, planned.case, small_mission)
    assert record is not None
    assert record.trajectory.status is Status.ERROR
    assert record.message == "The cluster lost every worker that tried it."
    other = ValueError("boom")
    assert engine.outcome(job, other) is other


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
