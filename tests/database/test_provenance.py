"""What a file says of its making: true wherever the package lies, and one software for one file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import h5py
import pytest

import database
from ampi.missions.mission import Mission
from database.file import provenance
from database.records.campaign import BuildError

ROOT = Path(database.__file__).parents[1]
ASK = "from database.file.provenance import git_revision; print(git_revision())"


def git(folder: Path, *arguments: str) -> str:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    names = ("-c", "user.name=tester", "-c", "user.email=tester@example.org")
    return subprocess.run(
        ["git", *names, *arguments],
        cwd=folder,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.strip()


def repository(folder: Path) -> str:
    """Make one with a commit; its revision."""
    git(folder, "init", "--quiet")
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--allow-empty", "--message", "first")
    return git(folder, "rev-parse", "HEAD")


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """The sources of both packages in a folder of their own."""
    where = tmp_path / "copy"
    for package in ("ampi", "database"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, where / package, ignore=ignored)
    return where


def asked(folder: Path, **environment: str) -> str:
    """`git_revision` of the package in a folder."""
    done = subprocess.run(
        [sys.executable, "-B", "-c", ASK],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), **environment},
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip()


def test_the_revision_is_that_of_the_checkout(copied: Path) -> None:
    revision = repository(copied)
    assert asked(copied) == revision
    (copied / "notes.txt").write_text("beside the sources\n")
    repository(copied)  # a commit that no number depends on
    assert git(copied, "rev-parse", "HEAD") != revision
    assert asked(copied) == revision
    with (copied / "ampi" / "trajectory.py").open("a") as source:
        source.write("# changed\n")
    assert asked(copied) == f"{revision}-dirty"


def test_another_repository_around_an_installed_package_is_not_taken_for_it(copied: Path) -> None:
    (copied.parent / ".gitignore").write_text("copy/\n")
    repository(copied.parent)
    assert asked(copied) == "unknown"


def test_a_repository_that_the_environment_names_is_not_taken_for_it(
    copied: Path, tmp_path: Path
) -> None:
    """As in a hook of git."""
    other = tmp_path / "other"
    other.mkdir()
    repository(other)
    revision = repository(copied)
    assert asked(copied, GIT_DIR=str(other / ".git"), GIT_WORK_TREE=str(other)) == revision


def test_a_file_names_the_software_that_made_it(small_database: Path) -> None:
    with h5py.File(small_database) as file:
        for package in ("ampi", "numpy", "scipy", "casadi", "clarabel", "h5py"):
            assert file.attrs[f"{package}_version"] == version(package)


def test_an_interrupted_build_is_not_continued_by_other_software(
    small_mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.h5"
    with pytest.raises(ZeroDivisionError):
        database.build(
            small_mission, path, n_jobs=1, advance=lambda count: 1 // 0 if count else None
        )
    versions = {**provenance.software(), "numpy_version": "1.0"}
    monkeypatch.setattr("database.file.provenance.software", lambda: versions)
    with pytest.raises(BuildError, match=r"different numpy_version \(.* there, 1\.0 here\)"):
        database.build(small_mission, path)
