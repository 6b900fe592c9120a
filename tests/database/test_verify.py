"""A flipped bit anywhere is found: by the loader, and by `verify`, which says where it is."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from ampi.dataset import (
    DIGEST,
    FIELDS,
    DatasetError,
    content_digest,
    read_dataset,
    seal,
)
from ampi.hdf5.seal import SEAL_BYTES
from ampi.loading import load_guidance
from ampi.trajectory import Status
from database.audit.verify import Findings, examine, verify

SCALES = ("state", "target", "limit", "affine", "node", "high_density")
AXES = ("speed", "flight_path_angle")
DATASETS = (*FIELDS, *SCALES, *(f"axis_{name}" for name in AXES))


def flipped(source: Path, target: Path, place: int, bit: int = 0) -> Path:
    raw = bytearray(source.read_bytes())
    raw[place] ^= 1 << bit
    target.write_bytes(raw)
    return target


def chunks(path: Path, name: str) -> Iterator[tuple[int, int]]:
    """Place and size of each chunk of a dataset in the file."""
    with h5py.File(path) as file:
        stored = file[name].id
        for k in range(stored.get_num_chunks()):
            info = stored.get_chunk_info(k)
            yield info.byte_offset, info.size


def test_an_undamaged_file_is_whole(small_database: Path) -> None:
    found = verify(small_database)
    assert found.whole, found.faults
    assert (found.cases, found.solved) == (9, 9)
    assert found.datasets == len(DATASETS)
    with h5py.File(small_database) as file:
        assert set(file) == set(DATASETS)


@pytest.mark.parametrize("name", DATASETS)
def test_a_flipped_bit_in_any_dataset_is_found_and_named(
    small_database: Path, tmp_path: Path, name: str
) -> None:
    rng = np.random.default_rng(DATASETS.index(name))
    for place, size in chunks(small_database, name):
        for at in {0, size // 2, size - 1, int(rng.integers(size))}:
            bad = flipped(small_database, tmp_path / "bad.h5", place + at, int(rng.integers(8)))
            with pytest.raises(DatasetError, match="does not match its checksum"):
                load_guidance(bad)
    found = Findings()
    examine(bad, found)  # in this process: a damage inside a chunk is one that HDF5 checks for
    assert any(f.startswith(f"{name}: 1 of ") and "chunks damaged" in f for f in found.faults)


def test_verify_names_the_damaged_dataset(small_database: Path, tmp_path: Path) -> None:
    place, size = next(chunks(small_database, "gains"))
    faults = verify(flipped(small_database, tmp_path / "bad.h5", place + size // 2)).faults
    assert faults[0] == "seal: the bytes of the file are not those written"
    assert faults[1].startswith("gains: 1 of 1 chunks damaged, the first at index (0, 0, 0, 0")


def test_a_flipped_bit_between_the_datasets_is_found(small_database: Path, tmp_path: Path) -> None:
    """Header, attributes, indices: every byte that belongs to no chunk is drawn with equal chance."""
    raw = small_database.read_bytes()
    between = np.ones(len(raw), dtype=bool)
    for name in DATASETS:
        for place, size in chunks(small_database, name):
            between[place : place + size] = False
    rng = np.random.default_rng(3)
    header = [0, SEAL_BYTES - 1, SEAL_BYTES, SEAL_BYTES + 8]
    attribute = raw.index(b"mass_kg = 500.0")
    drawn = rng.choice(np.flatnonzero(between), 150, replace=False)
    for place in [*header, attribute, *drawn.tolist()]:
        bad = flipped(small_database, tmp_path / "bad.h5", place, int(rng.integers(8)))
        with pytest.raises(DatasetError, match="damaged"):
            read_dataset(bad)
    for place in [*header, attribute, *drawn[:4].tolist()]:
        bad = flipped(small_database, tmp_path / "bad.h5", place, int(rng.integers(8)))
        assert verify(bad).faults[0].startswith("seal: ")


def test_a_library_that_crashes_on_the_file_is_a_fault(
    small_database: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    bad = flipped(small_database, tmp_path / "bad.h5", SEAL_BYTES + 8)
    monkeypatch.setattr("database.audit.verify._EXAMINE", "import os; os.abort()")
    assert verify(bad).faults[1] == "HDF5: its library crashes on the file (signal 6)"


def forged(source: Path, target: Path) -> Path:
    """A copy whose digest and seal are made to fit again after a change."""
    shutil.copy(source, target)
    return target


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("final_time", np.nan, "final_time: 1 cases are not finite though solved"),
        ("states", np.inf, "states: 1 cases are not finite though solved"),
        ("status", int(Status.STALLED), "states: 1 cases are not finite though solved, or finite"),
        ("axis_speed", 1e9, "axis_speed: expected [4642.26 4712.26 4782.26] of the mission's grid"),
        (
            "axis_speed",
            4700.0,
            "axis_speed: expected [4642.26 4712.26 4782.26] of the mission's grid",
        ),
        ("ld_to_hd", np.nan, "ld_to_hd: expected finite values"),
    ],
)
def test_values_are_checked_behind_a_good_seal(
    small_database: Path, tmp_path: Path, name: str, value: float, fault: str
) -> None:
    path = forged(small_database, tmp_path / "forged.h5")
    with h5py.File(path, "r+") as file:
        file[name][(0,) * file[name].ndim] = value
        file.attrs[DIGEST] = content_digest(file)
    seal(path)
    faults = verify(path).faults
    assert any(f.startswith(fault) for f in faults), faults


def test_an_axis_moved_behind_a_good_seal_does_not_fly(
    small_database: Path, tmp_path: Path
) -> None:
    path = forged(small_database, tmp_path / "forged.h5")
    with h5py.File(path, "r+") as file:
        file["axis_speed"][0] -= 10.0
        file.attrs[DIGEST] = content_digest(file)
    seal(path)
    with pytest.raises(DatasetError, match=r"axis_speed: expected .* of the mission's grid, got"):
        load_guidance(path)


def test_parameters_renamed_behind_a_good_seal_are_found(
    small_database: Path, tmp_path: Path
) -> None:
    path = forged(small_database, tmp_path / "forged.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["parameters"] = file.attrs["parameters"][::-1]
        file.attrs[DIGEST] = content_digest(file)
    seal(path)
    fault = (
        "parameters: expected speed, flight_path_angle of the mission's grid, got flight_path_angle"
    )
    assert any(f.startswith(fault) for f in verify(path).faults)
    with pytest.raises(DatasetError, match=fault):
        load_guidance(path)


def test_a_mission_that_is_none_is_named(small_database: Path, tmp_path: Path) -> None:
    path = forged(small_database, tmp_path / "forged.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["mission_toml"] = "mission = 3"
        file.attrs[DIGEST] = content_digest(file)
    seal(path)
    assert any(f.startswith("mission_toml: ") for f in verify(path).faults)


def test_schema_is_checked_behind_a_good_seal(small_database: Path, tmp_path: Path) -> None:
    path = forged(small_database, tmp_path / "forged.h5")
    with h5py.File(path, "r+") as file:
        file["cost"].attrs["units"] = "furlong"
        del file["peak"]
        file["peak"] = np.zeros(3)
    seal(path)
    faults = verify(path).faults
    assert any(f.startswith("peak: expected shape (3, 3, 5)") for f in faults), faults
    assert "cost: expected units '1', got 'furlong'" in faults
    assert any(f.startswith("content: ") for f in faults)


def test_nothing_to_verify_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such file, there is nothing to verify"):
        verify(tmp_path / "absent.h5")
