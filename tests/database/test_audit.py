"""The audit measures; it does not repeat what the file says."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from ampi.dataset import read_dataset
from ampi.trajectory import Status
from database.audit import audit
from database.error_map import best_cell


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


def test_failed_cases_leave_unknown_what_they_hide_and_nothing_else(small_database: Path) -> None:
    """The whole first layer of speed failed: of its cell nothing is known, of the others all is."""
    dataset = read_dataset(small_database)
    states, status = dataset.states.copy(), dataset.status.copy()
    states[0], status[0] = np.nan, int(Status.ERROR)
    final_time = np.where(status == int(Status.SOLVED), dataset.final_time, np.nan)
    report = audit(
        dataclasses.replace(dataset, states=states, status=status, final_time=final_time), probes=3
    )
    assert (report.probes, report.statuses) == (0, {"SOLVED": 6, "ERROR": 3})
    assert report.position_error.worst < 10.0
    known = {cell.parameter: np.isfinite(cell.gain) for cell in report.error_map}
    assert known == {"speed": False, "flight_path_angle": True}
    assert best_cell(report.error_map).parameter == "flight_path_angle"
    with pytest.raises(ValueError, match="no cell of these axes has a known error"):
        best_cell(report.error_map, "speed")
