"""What a build will take is known before its first job, and a huge one is refused at once."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import database
from ampi.cli import app
from ampi.dataset import FIELDS
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from database.estimate import estimate
from database.records.campaign import BuildError

# the kernel's own account: `getrusage` begins with what the process that forked it held
MEMORY = """
import re, sys
from ampi.cli import app
try:
    app(["build", *sys.argv[1:]])
finally:
    print(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1])
"""
KEYS = ("speed_m_per_s", "flight_path_angle_deg", "azimuth_deg", "altitude_m", "longitude_deg")
MORE = ("latitude_deg", "density_factor", "lift_factor", "drag_factor", "vehicle.mass_kg")


@pytest.fixture
def huge(small_mission: Mission) -> str:
    """31 points on each of ten axes: 8e14 cases."""
    axis = np.linspace(-0.1, 0.1, 31).round(6).tolist()
    text = small_mission.toml[: small_mission.toml.index("[grid]")]
    return f"{text}[grid]\n" + "".join(f"{key} = {axis}\n" for key in KEYS + MORE)


def test_an_estimate_is_of_the_grid_and_the_workers(small_mission: Mission, tmp_path: Path) -> None:
    one, two = (estimate(small_mission, tmp_path / "a.h5", workers=n) for n in (1, 2))
    assert one.cases == 9
    assert one.seconds == 2.0 * two.seconds > 0.0
    assert one.file_bytes < one.disk_bytes < one.free_bytes
    assert two.memory_bytes > one.memory_bytes
    assert not one.large
    assert str(one).startswith("9 cases: about 1 s with 1 worker, a file of 0.066 MB, ")


def test_an_estimate_is_near_the_file(small_mission: Mission, small_database: Path) -> None:
    """Of what the file holds of its cases; axes and the high-density matrix are the same in all."""
    with h5py.File(small_database) as file:
        stored = sum(
            file[name].id.get_storage_size() for name, field in FIELDS.items() if field.per_case
        )
    found = estimate(small_mission, small_database, workers=1).file_bytes
    assert found == pytest.approx(stored, rel=0.1)


def test_a_huge_grid_is_refused_at_once_and_in_little_memory(huge: str, tmp_path: Path) -> None:
    mission, path = tmp_path / "huge.toml", tmp_path / "huge.h5"
    mission.write_text(huge, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", MEMORY, str(mission), str(path), "--yes"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("error: 819,628,286,980,801 cases: about ")
    assert done.stderr.endswith("expected at most 10,000,000 cases: give the axes fewer points\n")
    assert int(done.stdout) < 300 * 1024  # KiB
    assert [f.name for f in tmp_path.iterdir()] == ["huge.toml"]


@pytest.fixture
def large(small_mission: Mission, tmp_path: Path) -> Path:
    """11 points on each of five axes: 161,051 cases, too many to begin without a word."""
    axis = np.linspace(-0.1, 0.1, 11).round(6).tolist()
    text = small_mission.toml[: small_mission.toml.index("[grid]")]
    path = tmp_path / "large.toml"
    path.write_text(f"{text}[grid]\n" + "".join(f"{key} = {axis}\n" for key in KEYS))
    return path


def test_a_large_grid_needs_a_yes_where_nobody_can_be_asked(large: Path) -> None:
    done = CliRunner().invoke(app, ["build", str(large), str(large.with_suffix(".h5"))])
    assert done.exit_code == 2
    assert "161,051 cases: about " in done.stderr
    assert done.stderr.endswith("; to build that much, add --yes\n")
    assert len(done.stderr.splitlines()) == 1


def test_on_a_terminal_a_large_grid_is_a_question(large: Path) -> None:
    here, there = pty.openpty()
    command = [sys.executable, "-m", "ampi.cli", "build", str(large), "large.h5"]
    with subprocess.Popen(
        command, cwd=large.parent, stdin=there, stderr=there, stdout=subprocess.DEVNULL
    ) as process:
        os.write(here, b"n\n")
        assert process.wait() == 2
    assert b"161,051 cases: about " in os.read(here, 4096)
    os.close(here)
    os.close(there)
    assert [f.name for f in large.parent.iterdir()] == ["large.toml"]


def test_a_grid_too_large_for_any_build_is_no_question(huge: str, tmp_path: Path) -> None:
    with pytest.raises(
        BuildError, match=r"at most 10,000,000 cases, got 819,628,286,980,801; give"
    ):
        database.build(parse_mission(huge), tmp_path / "huge.h5")
    assert list(tmp_path.iterdir()) == []
