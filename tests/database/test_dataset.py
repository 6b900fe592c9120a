"""The file: readable without our code, checked by ours."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray

from ampi.dataset import DatasetError, read_dataset
from ampi.loading import guidance_table, load_guidance
from ampi.missions.mission import Mission, parse_mission
from ampi.physics.equations_of_motion import STATES


def test_xarray_opens_it_with_named_dimensions(small_database: Path) -> None:
    with xarray.open_dataset(small_database, engine="h5netcdf") as data:
        assert data["states"].dims[-2:] == ("state", "node")
        assert data["states"].dims[0] == "axis_speed"
        assert data["final_time"].attrs["units"] == "s"
        assert [s.decode() for s in data["state"].values] == list(STATES)
        assert float(data["final_time"].min()) > 500.0


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
    with pytest.raises(
        DatasetError, match="schema version 99, this ampi reads version 2; read it with"
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
