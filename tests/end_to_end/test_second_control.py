"""From a mission that steers its angle of attack to flights: solved, stored, audited, flown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ampi
import database
from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.loading import guidance_of, guidance_table
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode, ReferenceGenerator
from database.audit.audit import audit
from tests.support.steered import CONTROL, steered_mission

LINE = "[grid]\nspeed_m_per_s = [-70.0, 0.0, 70.0]\n"


@pytest.fixture(scope="module")
def mission() -> Mission:
    return steered_mission(CONTROL, LINE)


@pytest.fixture(scope="module")
def dataset(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> TrajectoryDataset:
    path: Path = tmp_path_factory.mktemp("line") / "line.h5"
    report = database.build(mission, path, n_jobs=1, sensitivities=True)
    assert (report.solved, report.cases) == (3, 3)
    return read_dataset(path)


def test_optima_are_true_and_keep_every_limit(dataset: TrajectoryDataset) -> None:
    report = audit(dataset, probes=1, n_jobs=1)
    assert report.position_error.worst < 50.0
    assert max(report.limits.values()) <= 1.001
    assert report.unsolved_probes == 0
    assert report.interpolation["ampi"]["open_loop_miss_km"].worst < 5.0
    assert not report.branches.astray


def test_sensitivities_are_the_slopes_of_the_optima(dataset: TrajectoryDataset) -> None:
    """Central differences over 140 m/s, of the angle of attack at entry: within their curvature."""
    assert dataset.sensitivities is not None
    angle, axis = dataset.states[:, 7, 0], dataset.axes[0]
    slope = (angle[2] - angle[0]) / (axis[2] - axis[0])
    assert dataset.sensitivities[1, 0, -1, 0] == pytest.approx(slope, rel=0.05)


def test_the_angle_is_interpolated_as_the_states_are(
    mission: Mission, dataset: TrajectoryDataset
) -> None:
    point = np.array([mission.entry.speed + 30.0])
    truth = ampi.solve(mission.with_parameters(point), guess=dataset.trajectory(1))
    found = {}
    for mode in (Mode.AMPI, Mode.HERMITE):
        reference = ReferenceGenerator(guidance_table(dataset), mode).reference(point)
        assert reference.layout.angle_of_attack is not None
        error = reference.nodal[reference.layout.angle_of_attack] - truth.states[7]
        found[mode] = np.degrees(np.abs(error).max())
    assert found[Mode.HERMITE] < 0.2 * found[Mode.AMPI] < 0.01


def test_the_table_lands(mission: Mission, dataset: TrajectoryDataset) -> None:
    flights = ampi.fly(mission, guidance_of(dataset), "entry", 8, seed=3, n_jobs=1)
    assert flights.passed.all()
    assert np.all(flights.miss < 500.0)  # m
    commanded = np.degrees(flights.angle_of_attack[()])
    assert np.nanmin(commanded) > 10.0
    assert np.nanmax(commanded) < 42.0
