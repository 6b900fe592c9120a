"""Fifty kills at random moments leave the same bytes as a build that nobody disturbs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import database
from ampi.dataset import partial_folder
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
THIRD_AXIS = "azimuth_deg = [-0.5, 0.0, 0.5]\n"


class Driver:
    """A process that builds, and its workers."""

    def __init__(self, mission: Path, path: Path, solver: tuple[str, ...]) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from misbehaving import main; main()", mission, path, *solver],
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), *sys.path])},
            stderr=subprocess.PIPE,
        )

    def workers(self) -> list[int]:
        """They, and the process that they are forked from."""
        servers = [pid for pid in children(self.process.pid) if works(pid)]
        return [*servers, *(pid for server in servers for pid in children(server))]

    def end(self) -> int:
        _, told = self.process.communicate()
        if self.process.returncode not in (0, -signal.SIGKILL):
            assert b"run the same build again" in told, told.decode()
        return self.process.returncode


def children(pid: int) -> list[int]:
    found = list[int]()
    for told in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            found += map(int, told.read_text().split())
    return found


def works(pid: int) -> bool:
    """Whether this is none of git's: who kills that has a file of an unknown revision."""
    try:
        return b"ampi.workers" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def kill_at_random(
    mission: Path, path: Path, solver: tuple[str, ...], kills: list[str], seed: int, expected: bytes
) -> None:
    """Kill a worker or the driver for each of `kills`, in an order and at moments drawn at random.

    Every file that is finished meanwhile is `expected`.
    """
    rng = np.random.default_rng(seed)
    left = rng.permutation(kills).tolist()
    while left:
        driver = Driver(mission, path, solver)
        while driver.process.poll() is None and left:
            time.sleep(rng.uniform(0.0, 0.4))
            if driver.process.poll() is not None:
                break
            workers = driver.workers()
            if left[-1] == "worker" and workers:
                try:
                    os.kill(int(rng.choice(workers)), signal.SIGKILL)
                except ProcessLookupError:
                    continue
                left.pop()
            elif left[-1] == "driver" and (workers or rng.random() < 0.2):  # seldom before it works
                driver.process.kill()
                left.pop()
        driver.end()
        if path.exists():
            assert path.read_bytes() == expected
            path.unlink()
    while Driver(mission, path, solver).end() != 0:
        continue


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds the workers in /proc")
def test_kills_leave_no_trace_with_a_stand_in_for_the_optimiser(
    small_mission: Mission,
    small_database: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.setenv("AMPI_TEST_DATABASE", str(small_database))
    import misbehaving

    text = tmp_path / "larger.toml"
    text.write_text(small_mission.toml + THIRD_AXIS)
    undisturbed, path = tmp_path / "undisturbed.h5", tmp_path / "killed.h5"
    database.build(parse_mission(text.read_text()), undisturbed, solver=misbehaving.slow)
    kills = ["worker"] * 30 + ["driver"] * 14
    kill_at_random(text, path, ("slow",), kills, 1, undisturbed.read_bytes())
    assert path.read_bytes() == undisturbed.read_bytes()
    assert not partial_folder(path).exists()
    assert sorted(f.name for f in tmp_path.glob("killed*")) == ["killed.h5"]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds the workers in /proc")
def test_kills_leave_no_trace_with_the_optimiser(
    small_mission: Mission, small_database: Path, tmp_path: Path
) -> None:
    text = tmp_path / "small.toml"
    text.write_text(small_mission.toml)
    path = tmp_path / "killed.h5"
    kills = ["worker"] * 4 + ["driver"] * 2
    kill_at_random(text, path, (), kills, 2, small_database.read_bytes())
    assert path.read_bytes() == small_database.read_bytes()
    assert not partial_folder(path).exists()
