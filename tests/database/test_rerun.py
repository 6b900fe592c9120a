"""One case again: as the build solves it, from a file or from the records of a build."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import database
from ampi.dataset import DatasetError, partial_folder, read_dataset
from ampi.missions.mission import Mission
from database.rerun import AttemptResult, rerun
from tests.support.command_line import run


def test_a_case_of_a_file_is_solved_as_in_the_build(small_database: Path) -> None:
    watched: list[AttemptResult] = []
    found = rerun(small_database, 0, watch=watched.append)
    stored = read_dataset(small_database).trajectory(0)
    np.testing.assert_array_equal(found.trajectory.states, stored.states)
    assert found.trajectory.final_time == stored.final_time
    assert [a.attempt for a in watched] == ["from the continuation of its neighbours"]
    assert found.stored == f"{watched[0].attempt}: {found.trajectory.status.sentence}"
    assert len(found.trajectory.statistics.log) == found.trajectory.statistics.iterations


@pytest.mark.parametrize("suffix", ["", ".partial"])
def test_a_case_of_an_unfinished_build(small_mission: Mission, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / "a.h5"
    with pytest.raises(ZeroDivisionError):
        database.build(small_mission, path, n_jobs=1, advance=lambda n: 1 // 0 if n else None)
    for late in partial_folder(path).glob("cases_00000[0-35-9].rec"):
        late.unlink()
    found = rerun(f"{path}{suffix}", 5)
    assert found.stored == "nothing yet"
    assert found.trajectory.status.ok
    assert [a.attempt for a in found.attempts] == ["from case 4 in 1 step(s)"]
    assert not (partial_folder(path) / "cases_000005.rec").exists()


def test_misuse_is_named(small_database: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="case: expected a number from 0 to 8, got 9"):
        rerun(small_database, 9)
    with pytest.raises(DatasetError, match="no such file"):
        rerun(tmp_path / "absent.h5", 0)
    with pytest.raises(DatasetError, match=r"expected the records of a build, got a folder"):
        rerun(tmp_path, 0)


def test_on_the_command_line(small_database: Path, tmp_path: Path) -> None:
    figure = tmp_path / "case.png"
    told = run("rerun", small_database, "8", "--output", figure).stdout
    assert "from the continuation of its neighbours (1 solve): Converged" in told
    assert "case 8 at grid index (2, 2); stored: from the continuation of its neighbours" in told
    assert figure.read_bytes().startswith(b"\x89PNG")
    numbers = json.loads(run("rerun", small_database, "8", "--json").stdout)
    assert numbers["status"] == "SOLVED"
    assert len(numbers["attempts"][0]["log"]) == numbers["iterations"]
    told = run("rerun", small_database, "99", code=2).stderr
    assert told == "error: case: expected a number from 0 to 8, got 99\n"


def test_verify_on_the_command_line(small_database: Path, tmp_path: Path) -> None:
    assert "whole; 24 datasets, 9 of 9 cases" in run("verify", small_database).stdout
    bad = tmp_path / "bad.h5"
    shutil.copy(small_database, bad)
    raw = bytearray(bad.read_bytes())
    raw[-1] ^= 1
    bad.write_bytes(raw)
    assert run("verify", bad, code=2).stderr.startswith(f"error: {bad}: seal: ")
    numbers = json.loads(run("verify", bad, "--json", code=2).stdout)
    assert (numbers["whole"], numbers["bytes"]) == (False, len(raw))
