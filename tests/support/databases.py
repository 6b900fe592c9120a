"""The nine-case database that several rooms read, built once per run of the tests."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

import pytest

import database
from tests.support.missions import small_mission


def small_database(factory: pytest.TempPathFactory) -> Path:
    """Of `small_mission`. Whichever process of the run comes first builds it, the others wait."""
    run = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:  # there each process has a folder below the run's
        run = run.parent
    path = run / "small" / "small.h5"
    path.parent.mkdir(exist_ok=True)
    with (run / "small.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            report = database.build(small_mission(), path, n_jobs=2)
            assert (report.solved, report.cases, report.failures) == (9, 9, ())
    return path
