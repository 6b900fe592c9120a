"""The file of optima with two controls: what it holds more, what makes it, what reads it."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

import database
from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.loading import LAWS, guidance_table, law_of
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import STEERED_TRACKING, RowKind
from ampi.physics.state import ANGLE_OF_ATTACK, STATES, STEERED_STATES
from ampi.tracker_design.riccati_gains import SteeringSettings, steering_gains
from ampi.trajectory import Status, Trajectory
from database.audit.branches import halfway
from database.audit.coherence import coherence
from database.audit.verify import verify
from database.difference import difference
from database.factory.attempts import no_trajectory
from database.plan.grid import Grid
from database.plan.prediction import predicted
from database.records.case_record import CaseRecord
from tests.support.steered import steered_flight, steered_mission

FAILED = (2, 0)  # by its place in the grid


def most_of_them(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """A stand-in for the optimiser that fails in one case."""
    failed = mission.entry.speed > 4740.0 and mission.entry.flight_path_angle < np.radians(-10.5)
    if failed:
        mesh = mission.pseudospectral_mesh
        return Trajectory.none(mesh, Status.STALLED, mission.n_states)
    return steered_flight(mission)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return steered_mission()


@pytest.fixture(scope="module")
def path(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("steered") / "steered.h5"
    report = database.build(mission, path, n_jobs=1, solver=most_of_them)
    assert (report.solved, report.cases) == (8, 9)
    return path


@pytest.fixture(scope="module")
def dataset(path: Path) -> TrajectoryDataset:
    return read_dataset(path)


def test_the_file_names_its_states_and_controls(path: Path) -> None:
    assert verify(path).whole
    with h5py.File(path) as file:
        assert file.attrs["controls"] == "bank_rate angle_of_attack_rate"
        assert [name.decode() for name in file["state"]] == list(STEERED_STATES)
        assert [name.decode() for name in file["tracked"]] == list(STATES)
        assert file["states"].shape == (3, 3, 8, 64)
        assert file["states"].attrs["units"].split()[ANGLE_OF_ATTACK] == "rad"
        assert file["gains"].dims[2].label == "tracked"
        rate = file["angle_of_attack_rate"]
        assert (rate.shape, rate.attrs["units"], rate.fletcher32) == ((3, 3, 64), "rad/s", True)
        assert b"angle_of_attack_rate" in file["limit"][()].tolist()


def test_a_file_of_one_control_says_nothing_of_a_second(small_database: Path) -> None:
    with h5py.File(small_database) as file:
        assert "controls" not in file.attrs
        assert not {"tracked", "angle_of_attack_rate"} & set(file)
    assert read_dataset(small_database).angle_of_attack_rate is None


def test_it_gives_back_what_was_solved(mission: Mission, dataset: TrajectoryDataset) -> None:
    flight = steered_flight(mission)
    stored = dataset.trajectory(4)
    assert np.array_equal(stored.states, flight.states)
    assert np.array_equal(stored.controls, flight.controls)
    assert np.isnan(dataset.trajectory(6).controls).all()
    assert np.isnan(dataset.states[FAILED]).all()
    assert np.isfinite(dataset.gains[dataset.solved]).all()
    assert np.all(dataset.peak[dataset.solved][:, -2:] > 0.0)


def test_a_record_holds_both_controls(mission: Mission) -> None:
    for trajectory in (steered_flight(mission), no_trajectory(mission)):
        record = CaseRecord(3, trajectory, "made", 1, 0.1)
        read = CaseRecord.unpacked(3, record.packed("label"), mission, "label").trajectory
        assert np.array_equal(read.states, trajectory.states, equal_nan=True)
        assert np.array_equal(read.controls, trajectory.controls, equal_nan=True)


def test_neighbours_continue_and_halve_both_controls(
    mission: Mission, dataset: TrajectoryDataset
) -> None:
    one, other = dataset.trajectory(3), dataset.trajectory(5)
    assert halfway(one, other).controls == pytest.approx(0.5 * (one.controls + other.controls))
    grid = Grid.from_mission(mission)
    found = predicted(grid, 8, dataset.trajectory)
    assert found is not None
    terms = [dataset.trajectory(k).controls for k in (7, 5, 4)]
    assert found.controls == pytest.approx(terms[0] + terms[1] - terms[2], abs=1e-12)


def test_it_is_compared_and_judged_in_all_its_rows(dataset: TrajectoryDataset) -> None:
    rows = [row.row for row in difference(dataset, dataset).rows]
    assert rows[7:10] == ["angle_of_attack", "bank_rate", "angle_of_attack_rate"]
    smooth = coherence(dataset)
    assert smooth.rows == (*STEERED_STATES, "final_time")
    assert len(smooth.scale) == len(smooth.worst) == len(smooth.rows)


@pytest.mark.parametrize("law", list(LAWS))
def test_a_table_carries_the_angle_behind_all_other_rows(
    dataset: TrajectoryDataset, law: str
) -> None:
    table = guidance_table(dataset, "fly", law)
    layout = law_of(law, dataset.mission).layout
    assert table.layout == layout.with_angle_of_attack
    assert table.layout.angle_of_attack == len(layout)
    solved = dataset.solved
    assert np.array_equal(table.values[solved][:, -1], dataset.states[solved][:, ANGLE_OF_ATTACK])
    assert np.array_equal(table.values[FAILED], table.values[1, 0])
    assert np.isfinite(table.values).all()


def test_a_law_that_modulates_flies_by_gains_of_both(
    mission: Mission, dataset: TrajectoryDataset
) -> None:
    table = guidance_table(dataset, "fly", law_of("linear_quadratic", mission, modulate=True))
    assert table.layout == STEERED_TRACKING.with_angle_of_attack
    flight = dataset.trajectory(4)
    family, final_time = MissionFamily.of([mission]), np.array([flight.final_time])
    gains = steering_gains(
        family, flight.mesh, flight.states[None], final_time, SteeringSettings()
    )[0]
    both = [
        table.values[1, 1, table.layout.of(kind)] for kind in (RowKind.GAIN, RowKind.ANGLE_GAIN)
    ]
    assert np.concatenate(both) == pytest.approx(gains, rel=1e-9, abs=1e-12 * np.abs(gains).max())
