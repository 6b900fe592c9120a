"""The audit measures; it does not repeat what the file says."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ampi
from ampi.dataset import read_dataset
from ampi.loading import guidance_table
from ampi.onboard.reference import Mode
from ampi.trajectory import Status, Trajectory
from database.audit.audit import ErrorSummary, _errors, audit, nodal_reference
from database.audit.error_map import best_cell


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


def test_an_interpolated_flight_that_hits_the_ground_is_infinitely_far_off(
    small_database: Path,
) -> None:
    """The integrator finds no step there; the audit ended with it. Known, and the worst there is."""
    dataset = read_dataset(small_database)
    states = dataset.states.copy()
    states[..., 6, :] = np.pi  # lift downwards
    errors = _errors(dataset.mission, dataset.trajectory(4), states[1, 1], 900.0)
    assert errors[-1] == np.inf
    found = ErrorSummary.of(np.array([1.0, np.nan, 3.0, np.inf, np.inf]))
    assert (found.median, found.percentile_90, found.worst) == (np.inf, np.inf, np.inf)
    assert ErrorSummary.of(np.array([1.0, np.nan, 3.0])) == ErrorSummary(2.0, 2.8, 3.0)


def test_probes_depend_on_the_seed_alone(small_database: Path) -> None:
    dataset = read_dataset(small_database)
    one = audit(dataset, probes=3, seed=7, n_jobs=1).interpolation
    two = audit(dataset, probes=3, seed=7, n_jobs=2).interpolation
    assert one == two


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"probes": -1}, "probes: expected a non-negative number, got -1"),
        ({"probes": 2.5}, r"probes: expected a non-negative number, got 2\.5"),
        ({"seed": -1}, "seed: expected a whole number, 0 or greater, got -1"),
        ({"n_jobs": 0}, "n_jobs: expected at least 1 worker process, got 0"),
        ({"dataset": "small.h5"}, "dataset: expected a database, .* got 'small.h5'"),
    ],
)
def test_misuse_is_one_sentence(
    small_database: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        audit(**{"dataset": read_dataset(small_database), **options})


def test_failed_cases_leave_unknown_what_they_hide_and_nothing_else(small_database: Path) -> None:
    """The whole first layer of speed failed: of its cell nothing is known, of the others all is."""
    dataset = read_dataset(small_database)
    states, status = dataset.states.copy(), dataset.status.copy()
    states[0], status[0] = np.nan, int(Status.ERROR)
    final_time = np.where(status == int(Status.SOLVED), dataset.final_time, np.nan)
    report = audit(
        dataclasses.replace(dataset, states=states, status=status, final_time=final_time), probes=3
    )
    assert report.statuses == {"SOLVED": 6, "ERROR": 3}
    assert report.position_error.worst < 10.0
    known = {cell.parameter: np.isfinite(cell.gain) for cell in report.error_map}
    assert known == {"speed": False, "flight_path_angle": True}
    assert best_cell(report.error_map).parameter == "flight_path_angle"
    with pytest.raises(ValueError, match="no cell of these axes has a known error"):
        best_cell(report.error_map, "speed")


def test_probes_see_every_cell_that_has_all_its_cases(small_database: Path) -> None:
    """One corner failed: three cells of four are probed as if nothing had happened."""
    dataset = read_dataset(small_database)
    status = dataset.status.copy()
    arrays = {n: getattr(dataset, n).copy() for n in ("states", "bank_rate", "gains", "final_time")}
    status[0, 0] = int(Status.ERROR)
    for values in arrays.values():
        values[0, 0] = np.nan
    probes, seed = 8, 2016
    report = audit(
        dataclasses.replace(dataset, status=status, **arrays), probes=probes, seed=seed, n_jobs=1
    )
    low, high = (np.array([axis[end] for axis in dataset.axes]) for end in (0, -1))
    points = np.random.default_rng(seed).uniform(low, high, size=(probes, 2))
    hidden = np.all(points < dataset.mission.nominal_parameters, axis=1)
    assert 0 < hidden.sum() < probes
    assert (report.probes, report.hidden_probes) == (probes, hidden.sum())
    table = guidance_table(dataset)
    expected = []
    for point in points[~hidden]:
        states, rate, final_time = nodal_reference(table, Mode.AMPI, point)
        mesh = dataset.mission.pseudospectral_mesh
        guess = Trajectory(mesh, states, rate, final_time, np.nan, Status.SOLVED)
        truth = ampi.solve(dataset.mission.with_parameters(point), guess=guess)
        expected.append(np.abs(states - truth.states)[0].max())
    found = report.interpolation["ampi"]["altitude_m"]
    assert found.worst == pytest.approx(max(expected), rel=1e-3)
    assert found.median == pytest.approx(np.median(expected), rel=1e-3)
    for mode in ("mpi", "quadratic"):  # three points an axis: every reference has the corner in it
        assert np.isnan(report.interpolation[mode]["altitude_m"].worst)
