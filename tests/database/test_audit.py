"""The audit measures; it does not repeat what the file says."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from ampi.dataset import read_dataset
from database.audit import audit


def test_small_database_is_true_and_interpolates(small_database: Path) -> None:
    report = audit(read_dataset(small_database), probes=6, n_jobs=2)
    assert report.statuses == {"SOLVED": 9}
    assert report.position_error.worst < 10.0
    assert report.altitude_error.worst <= report.position_error.worst
    assert report.speed_error.worst < 0.5
    assert all(0.1 < value < 1.005 for value in report.limits.values())
    assert report.unsolved_probes == 0
    errors = {mode: c["altitude_m"].median for mode, c in report.interpolation.items()}
    assert errors["quadratic"] < errors["ampi"] < errors["mpi"]
    misses = {mode: c["open_loop_miss_km"].median for mode, c in report.interpolation.items()}
    assert misses["quadratic"] < misses["ampi"] < misses["mpi"]


def test_audit_finds_a_trajectory_that_does_not_fly(small_database: Path) -> None:
    dataset = read_dataset(small_database)
    states = dataset.states.copy()
    states[0, 0, 6] += np.radians(2.0)  # another bank angle than the one solved for
    report = audit(dataclasses.replace(dataset, states=states), probes=0)
    assert report.position_error.worst > 1e3
    assert report.position_error.median < 10.0


def test_probes_depend_on_the_seed_alone(small_database: Path) -> None:
    dataset = read_dataset(small_database)
    one = audit(dataset, probes=3, seed=7, n_jobs=1).interpolation
    two = audit(dataset, probes=3, seed=7, n_jobs=2).interpolation
    assert one == two


def test_negative_probes_are_refused(small_database: Path) -> None:
    with pytest.raises(ValueError, match="probes: expected a non-negative number, got -1"):
        audit(read_dataset(small_database), probes=-1)
