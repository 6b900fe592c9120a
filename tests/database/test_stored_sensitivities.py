"""Sensitivities in the file: what they are, that all else stays, and that they go where it goes."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import database
from ampi.cli import app
from ampi.dataset import SENSITIVITY_FIELDS, TrajectoryDataset, partial_folder, read_dataset
from ampi.loading import guidance_table
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import RowKind
from ampi.scp.sensitivities import sensitivities
from ampi.scp.solve import solve, solve_family
from ampi.tracker_design.drag_rows import drag_rows
from ampi.tracker_design.riccati_gains import GainSettings, vertex_gains
from database.audit.verify import verify
from database.crop import crop
from database.estimate import estimate
from database.factory.stand_in import neighbour_moved
from database.records.campaign import BuildError, as_built

SHARE = 1e-3  # of an axis, to either side


@pytest.fixture(scope="module")
def stored(small_mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The nine cases with sensitivities, built in two runs: the first ends before the file."""
    path = tmp_path_factory.mktemp("stored") / "stored.h5"

    def interrupt(count: int) -> None:
        if count:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        database.build(small_mission, path, n_jobs=1, sensitivities=True, advance=interrupt)
    with pytest.raises(BuildError, match=r"another build \(different sensitivities"):
        database.build(small_mission, path, n_jobs=1)
    report = database.build(small_mission, path, n_jobs=1, sensitivities=True)
    assert report.solved == 9
    assert report.resumed > 0
    return path


@pytest.fixture(scope="module")
def dataset(stored: Path) -> TrajectoryDataset:
    return read_dataset(stored)


def digests(path: Path) -> dict[str, str]:
    with h5py.File(path) as file:
        return {name: hashlib.sha256(file[name][()].tobytes()).hexdigest() for name in file}


def test_all_else_in_the_file_is_what_it_is_without(stored: Path, small_database: Path) -> None:
    with_, without = digests(stored), digests(small_database)
    assert set(with_) - set(without) == {*SENSITIVITY_FIELDS, "parameter", "row"}
    assert {name: with_[name] for name in without} == without
    with h5py.File(stored) as one, h5py.File(small_database) as other:
        assert set(one.attrs) - set(other.attrs) == {"sensitivities"}
        assert one.attrs["schema_version"] == other.attrs["schema_version"]
    assert read_dataset(small_database).sensitivities is None
    assert guidance_table(read_dataset(small_database)).sensitivities is None


def test_the_file_explains_them(stored: Path) -> None:
    with h5py.File(stored) as file:
        rows = file["sensitivities"]
        assert rows.shape == (3, 3, 2, 15, 64)
        assert rows.dims[2][0][()].tolist() == [b"speed", b"flight_path_angle"]
        assert rows.dims[3][0][7] == b"bank_rate"
        assert rows.attrs["units"].startswith("m rad rad m/s rad rad rad rad/s, rad/s per unit of")
        assert (rows.compression, rows.shuffle, rows.fletcher32) == ("gzip", True, True)
        assert file["final_time_sensitivity"].shape == (3, 3, 2)
    assert verify(stored).whole
    with h5py.File(stored) as file:
        size = sum(file[name].id.get_storage_size() for name in SENSITIVITY_FIELDS)
    mission = read_dataset(stored).mission
    more, less = (
        estimate(mission, stored, workers=1, sensitivities=asked) for asked in (True, False)
    )
    assert more.seconds > less.seconds
    assert more.file_bytes - less.file_bytes == pytest.approx(size, rel=0.15)


def test_they_are_those_of_the_optima(dataset: TrajectoryDataset) -> None:
    points = np.stack(np.meshgrid(*dataset.axes, indexing="ij"), axis=-1).reshape(9, 2)
    found = sensitivities(dataset.mission, points, [dataset.trajectory(k) for k in range(9)])
    assert dataset.sensitivities is not None
    rows = dataset.sensitivities.reshape(9, 2, 15, -1)
    assert np.array_equal(rows[:, :, :7], found.states)
    assert np.array_equal(rows[:, :, 7], found.bank_rate)
    assert np.array_equal(dataset.final_time_sensitivity, found.final_time.reshape(3, 3, 2))


def test_gains_and_loads_move_with_the_optima_solved_again(dataset: TrajectoryDataset) -> None:
    """At one corner, against central differences of the rows of optima beside it."""
    mission, index = dataset.mission, (2, 0)
    mesh, start = mission.pseudospectral_mesh, dataset.trajectory(6)
    p = np.array([axis[i] for axis, i in zip(dataset.axes, index, strict=True)])
    for i, axis in enumerate(dataset.axes):
        step = SHARE * np.ptp(axis)
        family = mission.family(p + step * np.array([[1.0], [-1.0]]) * np.eye(2)[i])
        optima = [start, start]
        for _ in range(2):
            optima = [one for one in solve_family(family, optima) if one is not None]
        states = np.stack([one.states for one in optima])
        times = np.array([one.final_time for one in optima])
        gains = vertex_gains(family, mesh, states, times, GainSettings())
        loads = drag_rows(family, states, np.stack([one.times for one in optima]))
        for law, kind, rows in (
            ("linear_quadratic", RowKind.GAIN, gains),
            ("drag_shuttle", RowKind.LOAD, loads),
        ):
            table = guidance_table(dataset, law=law)
            assert table.sensitivities is not None
            found = table.sensitivities[index][i][:-1].reshape(len(table.layout), -1)
            expected = (rows[0] - rows[1]) / (2.0 * step)
            size = np.abs(expected).max(axis=1, keepdims=True)
            size += 1e-3 * np.abs(rows[0]).max(axis=1, keepdims=True) / np.ptp(axis)
            assert np.all(np.abs(found[table.layout.of(kind)] - expected) < 1e-4 * size)


def test_a_table_holds_them_by_column(dataset: TrajectoryDataset) -> None:
    table = guidance_table(dataset)
    assert table.sensitivities is not None
    assert dataset.sensitivities is not None
    assert dataset.final_time_sensitivity is not None
    assert table.sensitivities.shape == (3, 3, 2, 15 * 64 + 1)
    assert table.sensitivities[1, 2, 0, 3 * 64 + 5] == dataset.sensitivities[1, 2, 0, 3, 5]
    assert np.array_equal(table.sensitivities[..., -1], dataset.final_time_sensitivity)
    with pytest.raises(ValueError, match="read-only"):
        table.sensitivities[0, 0, 0, 0] = 0.0


def test_a_case_without_any_takes_the_divided_differences(dataset: TrajectoryDataset) -> None:
    stored, by_time = dataset.sensitivities, dataset.final_time_sensitivity
    assert stored is not None
    assert by_time is not None
    stored, by_time = stored.copy(), by_time.copy()
    stored[1, 1], by_time[1, 1] = np.nan, np.nan
    table = guidance_table(replace(dataset, sensitivities=stored, final_time_sensitivity=by_time))
    assert table.sensitivities is not None
    times, axis = table.final_time[:, 1], table.axes[0]
    between = (times[2] - times[0]) / (axis[2] - axis[0])  # the axis is even
    assert table.sensitivities[1, 1, 0, -1] == pytest.approx(between)
    assert table.sensitivities[0, 1, 0, -1] == by_time[0, 1, 0]


def test_a_cropped_database_has_them(
    dataset: TrajectoryDataset, stored: Path, tmp_path: Path
) -> None:
    """An axis that is left out is no parameter any more."""
    assert as_built(dataset, solve)["sensitivities"] is True
    drop = [("flight_path_angle_deg", np.degrees(dataset.axes[1][k])) for k in (0, 2)]
    crop(stored, tmp_path / "cropped.h5", drop=drop, n_jobs=1)
    cropped = read_dataset(tmp_path / "cropped.h5")
    assert cropped.sensitivities is not None
    assert dataset.sensitivities is not None
    expected = dataset.sensitivities[:, 1, :1]
    size = np.abs(expected).max(axis=-1, keepdims=True)
    assert cropped.sensitivities.shape == expected.shape
    assert np.all(np.abs(cropped.sensitivities - expected) <= 1e-5 * size)


def test_the_command_builds_them_and_knows_a_file_of_the_other_kind(
    small_mission: Mission, small_database: Path, stored: Path, tmp_path: Path
) -> None:
    mission = tmp_path / "small.toml"
    mission.write_text(small_mission.toml, encoding="utf-8")
    run = CliRunner().invoke
    again = run(app, ["build", str(mission), str(stored), "--sensitivities"])
    assert again.exit_code == 0
    assert "already whole" in again.output.replace("\n", " ")
    for path, options in ((small_database, ["--sensitivities"]), (stored, [])):
        refused = run(app, ["build", str(mission), str(path), *options])
        assert refused.exit_code == 2
        assert "made otherwise (different sensitivities" in refused.output.replace("\n", " ")


def test_what_has_none_is_refused_before_any_work(small_mission: Mission, tmp_path: Path) -> None:
    objective = small_mission.objective.model_copy(update={"bank_rate_variation": 1.0})
    kinked = small_mission.model_copy(update={"objective": objective})
    with pytest.raises(BuildError, match=r"without absolute values.*bank_rate_variation"):
        database.build(kinked, tmp_path / "a.h5", sensitivities=True)
    with pytest.raises(BuildError, match=r"another optimiser than ampi\.solve"):
        database.build(small_mission, tmp_path / "a.h5", sensitivities=True, solver=neighbour_moved)
    assert not partial_folder(tmp_path / "a.h5").exists()
