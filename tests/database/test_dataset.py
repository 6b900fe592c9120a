"""The file: readable without our code, checked by ours."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import re
import shutil
import subprocess
import sys
import typing
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray

from ampi.dataset import FIELDS, DatasetError, read_dataset, seal, stored_mission
from ampi.loading import guidance_table, load_guidance
from ampi.missions.family import MissionFamily
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.physics.state import STATES
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.solve import solve_family
from ampi.tracker_design.riccati_gains import GainSettings, vertex_gains
from ampi.trajectory import Status, Trajectory
from database.audit.verify import verify
from database.plan.grid import Grid
from database.plan.prediction import predicted


def test_xarray_opens_it_with_named_dimensions(small_database: Path) -> None:
    with xarray.open_dataset(small_database, engine="h5netcdf") as data:
        assert data["states"].dims[-2:] == ("state", "node")
        assert data["states"].dims[0] == "axis_speed"
        assert data["final_time"].attrs["units"] == "s"
        assert [s.decode() for s in data["state"].values] == list(STATES)
        assert float(data["final_time"].min()) > 500.0


def test_xarray_selects_by_parameter(small_database: Path, small_mission: Mission) -> None:
    """From file to one number by names alone."""
    with xarray.open_dataset(small_database, engine="h5netcdf") as data:
        at = {"axis_speed": small_mission.entry.speed + 70.0}
        fast = data["states"].sel(at, method="nearest").isel(axis_flight_path_angle=1, node=0)
        speed = float(fast.sel(state=b"speed"))
    assert speed == pytest.approx(small_mission.entry.speed + 70.0)


def test_the_pages_lines_of_numpy_read_it(
    small_database: Path, small_mission: Mission, tmp_path: Path
) -> None:
    """Run as printed, by an interpreter that cannot import this package."""
    page = (Path(__file__).parents[2] / "docs" / "file_format.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(import h5py\n.*?)```", page, re.DOTALL)
    assert len([line for line in block.splitlines() if line.strip()]) <= 10
    shutil.copy(small_database, tmp_path / "shefex3.h5")
    (tmp_path / "ampi.py").write_text("raise ImportError", encoding="utf-8")
    (tmp_path / "lines.py").write_text(block, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "lines.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    title, *numbers = done.stdout.split("\n", 1)
    assert title.endswith("over speed, flight_path_angle")
    altitudes, times = (
        [float(word) for word in part.split()] for part in re.findall(r"\[([^]]*)\]", numbers[0])
    )
    assert altitudes[0] == pytest.approx(1e-3 * small_mission.entry.altitude, abs=1e-2)
    assert altitudes[-1] == pytest.approx(1e-3 * small_mission.target.altitude, abs=1e-2)
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(read_dataset(small_database).final_time[1, 1], abs=0.01)


@pytest.mark.skipif(shutil.which("h5dump") is None, reason="h5dump (hdf5-tools) is not installed")
def test_h5dump_explains_it(small_database: Path) -> None:
    def dump(*options: str) -> str:
        command = ["h5dump", *options, str(small_database)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    header = dump("-H")
    for name in ("axis_speed", "axis_flight_path_angle", "states", "gains", "message", *FIELDS):
        assert f'DATASET "{name}"' in header
    assert "( 3, 3, 7, 64 )" in header
    assert 'ATTRIBUTE "mission_toml"' in header
    assert '"m rad rad m/s rad rad rad"' in dump("-a", "/states/units")
    assert '"optimal final time"' in dump("-a", "/final_time/long_name")
    assert "SOLVED" in dump("-a", "/status/meanings")
    values = dump("-y", "-m", "%.17g", "-d", "/final_time").split("DATA {")[1].split("}")[0]
    found = np.array([float(word) for word in values.replace(",", " ").split()])
    assert np.array_equal(found, read_dataset(small_database).final_time.ravel())


def restored(kind: type, values: dict[str, Any]) -> Any:
    """A settings object of nested dataclasses from its JSON."""
    hints = typing.get_type_hints(kind)
    return kind(
        **{
            key: restored(hints[key], value)
            if dataclasses.is_dataclass(hints[key])
            else tuple(value)
            if isinstance(value, list)
            else value
            for key, value in values.items()
        }
    )


def test_the_file_alone_solves_a_case_again_to_the_same_numbers(small_database: Path) -> None:
    """Mission, grid, settings, starting neighbour: nothing but what h5py reads."""
    with h5py.File(small_database) as file:
        attributes = dict(file.attrs)
        content = {name: dataset[()] for name, dataset in file.items()}
    mission = parse_mission(attributes["mission_toml"])
    grid = Grid.from_mission(mission)
    assert tuple(attributes["parameters"]) == grid.names
    for name, axis in zip(grid.names, grid.axes, strict=True):
        assert np.array_equal(content[f"axis_{name}"], axis)
    settings = restored(SolverSettings, json.loads(attributes["settings"]))
    phases = tuple(restored(Phase, phase) for phase in json.loads(attributes["mesh"]))
    assert phases == mission.pseudospectral_mesh.phases
    case = (2, 0)
    assert content["message"][case].startswith(b"from the continuation of its neighbours")

    def solved(number: int) -> Trajectory:
        at = np.unravel_index(number, grid.shape)
        return Trajectory(
            Mesh(phases),
            content["states"][at],
            content["bank_rate"][at],
            float(content["final_time"][at]),
            float(content["cost"][at]),
            Status.SOLVED,
            target_multipliers=content["target_multipliers"][at],
        )

    neighbour = predicted(grid, int(np.ravel_multi_index(case, grid.shape)), solved)
    here = mission.with_parameters([axis[i] for axis, i in zip(grid.axes, case, strict=True)])
    assert neighbour is not None
    (again,) = solve_family(MissionFamily.of([here]), [neighbour], settings)
    assert again is not None
    assert np.array_equal(again.states, content["states"][case])
    assert np.array_equal(again.bank_rate, content["bank_rate"][case])
    assert (again.final_time, again.cost, again.statistics.iterations) == (
        content["final_time"][case],
        content["cost"][case],
        content["iterations"][case],
    )
    gains = vertex_gains(
        MissionFamily.of([here]),
        again.mesh,
        again.states[None],
        np.array([again.final_time]),
        restored(GainSettings, json.loads(attributes["gain_settings"])),
    )
    assert gains[0] == pytest.approx(content["gains"][case], rel=1e-9, abs=1e-15)


def test_plain_h5py_and_numpy_are_enough(small_database: Path, small_mission: Mission) -> None:
    with h5py.File(small_database) as file:
        states = file["states"][1, 1]
        dense = states @ file["ld_to_hd"][()]
        assert file["states"].attrs["long_name"] == "optimal states at the Radau nodes"
        assert file.attrs["bank_rate_effort"] == small_mission.objective.bank_rate_effort
        assert file.attrs["mission_toml"] == small_mission.toml
    np.testing.assert_allclose(dense[0, 0], small_mission.entry.altitude)
    np.testing.assert_allclose(dense[0, -1], small_mission.target.altitude, atol=10.0)


def test_every_dataset_is_described_compressed_and_checksummed(small_database: Path) -> None:
    with h5py.File(small_database) as file:
        for name, dataset in file.items():
            assert dataset.fletcher32, name
            assert dataset.attrs["units"], name
            assert dataset.attrs["long_name"], name
            if not dataset.is_scale:
                assert dataset.shuffle, name
                assert dataset.compression == "gzip", name
                for dimension in dataset.dims:
                    assert len(dimension) == 1, name


def test_the_file_alone_rebuilds_its_mission(small_database: Path, small_mission: Mission) -> None:
    dataset = read_dataset(small_database)
    assert parse_mission(dataset.attributes["mission_toml"]) == small_mission
    trajectory = dataset.trajectory(4)
    assert trajectory.status.ok
    np.testing.assert_array_equal(trajectory.states[:6, 0], small_mission.entry_state)


def test_the_table_holds_the_database(small_database: Path) -> None:
    dataset = read_dataset(small_database)
    table = guidance_table(dataset)
    np.testing.assert_array_equal(table.values[..., :7, :], dataset.states)
    np.testing.assert_array_equal(table.values[..., 7, :], dataset.bank_rate)
    np.testing.assert_array_equal(table.values[..., 8:, :], dataset.gains)


def test_a_missing_file_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such file; make one with: ampi build"):
        load_guidance(tmp_path / "none.h5")


def test_a_text_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "text.h5"
    path.write_text("not HDF5")
    with pytest.raises(DatasetError, match="not a readable trajectory database, or damaged"):
        load_guidance(path)


def test_a_foreign_hdf5_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "foreign.h5"
    with h5py.File(path, "w") as file:
        file["x"] = [1.0]
    with pytest.raises(DatasetError, match="but not a trajectory database"):
        load_guidance(path)


def test_another_schema_version_is_refused(small_database: Path, tmp_path: Path) -> None:
    path = tmp_path / "future.h5"
    shutil.copy(small_database, path)
    with h5py.File(path, "r+") as file:
        file.attrs["schema_version"] = 99
    seal(path)
    with pytest.raises(
        DatasetError, match="schema version 99, this ampi reads version 6; read it with"
    ):
        load_guidance(path)


@pytest.mark.parametrize("name", ["states", "gains", "final_time", "axis_speed", "ld_to_hd"])
def test_a_changed_value_is_found(small_database: Path, tmp_path: Path, name: str) -> None:
    path = tmp_path / "changed.h5"
    shutil.copy(small_database, path)
    with h5py.File(path, "r+") as file:
        value = file[name][()]
        value.ravel()[0] += 1e-9
        file[name][...] = value
    with pytest.raises(DatasetError, match="does not match its checksum"):
        load_guidance(path)
    seal(path)  # a forged seal does not help
    with pytest.raises(DatasetError, match="does not match its checksum"):
        load_guidance(path)


def test_a_changed_attribute_is_found(small_database: Path, tmp_path: Path) -> None:
    path = tmp_path / "attribute.h5"
    shutil.copy(small_database, path)
    with h5py.File(path, "r+") as file:
        file.attrs["mission_toml"] = file.attrs["mission_toml"].replace("500.0", "501.0")
    with pytest.raises(DatasetError, match="does not match its checksum"):
        load_guidance(path)


def test_a_flipped_bit_on_disk_is_found(small_database: Path, tmp_path: Path) -> None:
    path = tmp_path / "flipped.h5"
    with h5py.File(small_database) as file:
        chunk = file["states"].id.get_chunk_info(0)
        at = chunk.byte_offset + chunk.size // 2
    raw = bytearray(small_database.read_bytes())
    raw[at] ^= 0x10
    path.write_bytes(raw)
    with pytest.raises(DatasetError, match="damaged"):
        load_guidance(path)


def test_a_flipped_bit_anywhere_is_found(small_database: Path, tmp_path: Path) -> None:
    raw = small_database.read_bytes()
    rng = np.random.default_rng(0)
    path = tmp_path / "flipped.h5"
    places = [0, 100, 511, 512, len(raw) - 1, *rng.integers(0, len(raw), 60).tolist()]
    for place in places:
        flipped = bytearray(raw)
        flipped[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
        with pytest.raises(DatasetError):
            read_dataset(path)


def test_reading_needs_no_lock(small_database: Path, tmp_path: Path) -> None:
    """HDF5 holds this lock while it writes, and on some file systems none can be had."""
    path = tmp_path / "open.h5"
    shutil.copy(small_database, path)
    with path.open("rb+") as elsewhere:
        fcntl.flock(elsewhere, fcntl.LOCK_EX)
        assert read_dataset(path).solved.all()
        assert verify(path).whole
        assert stored_mission(path) is not None


@pytest.mark.parametrize("reader", [read_dataset, verify])
def test_a_file_that_is_being_written_is_not_called_damaged(
    small_database: Path, tmp_path: Path, reader: Any
) -> None:
    path = tmp_path / "open.h5"
    shutil.copy(small_database, path)
    with path.open("rb+") as elsewhere:
        fcntl.flock(elsewhere, fcntl.LOCK_EX)
        elsewhere.truncate(path.stat().st_size - 1)
        with pytest.raises(DatasetError, match="another program has the file open for writing"):
            reader(path)
    with pytest.raises(DatasetError, match="it is damaged; rebuild it"):
        read_dataset(path)
