"""Results on their way to the disk: whole or absent, whatever the disk does."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from ampi.missions.mission import Mission
from ampi.workers.fingerprint import read_fingerprint, write_fingerprint
from ampi.workers.keeping import keeping
from ampi.workers.lock import exclusive
from database.factory.attempts import no_trajectory
from database.records.case_record import CaseRecord
from database.records.record_files import (
    FINGERPRINTS,
    NOT_KEPT,
    count_records,
    fingerprints,
    keeping_block,
    keeping_records,
    load_block,
    load_record,
    load_records,
    record_path,
    recorded_cases,
)


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def test_targets_appear_when_they_are_flushed_and_not_before(tmp_path: Path) -> None:
    results = {str(tmp_path / name): name.encode() * 1000 for name in ("one", "two", "three")}
    keep = keeping(results)
    assert len(names(tmp_path)) == 3
    assert all(name.endswith(".tmp") for name in names(tmp_path))
    keep()
    assert names(tmp_path) == ["one", "three", "two"]
    assert all(Path(target).read_bytes() == raw for target, raw in results.items())


def test_a_disk_that_takes_a_part_is_given_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write
    monkeypatch.setattr(os, "write", lambda file, raw: write(file, raw[:7]))
    keeping({str(tmp_path / "result"): bytes(range(100))})()
    assert (tmp_path / "result").read_bytes() == bytes(range(100))


@pytest.mark.parametrize(("call", "kept"), [("write", 0), ("fsync", 0), ("replace", 1)])
@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="counts open files in /proc")
def test_a_disk_that_refuses_leaves_no_open_files_and_no_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, kept: int
) -> None:
    original, calls = getattr(os, call), []

    def second_fails(*arguments: object) -> object:
        calls.append(arguments)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(*arguments)

    files = names(Path("/proc/self/fd"))
    monkeypatch.setattr(os, call, second_fails)
    with pytest.raises(OSError, match="No space left"):
        keeping({str(tmp_path / name): b"result" for name in ("one", "two", "three")})()
    assert len(names(tmp_path)) == kept
    assert names(Path("/proc/self/fd")) == files


def test_a_record_is_of_its_build_and_of_its_case(small_mission: Mission, tmp_path: Path) -> None:
    """What a cluster's job of a build that was given up leaves in the folder of the next one."""
    record = CaseRecord(3, no_trajectory(small_mission), "nothing", 0, 0.0)
    keeping_records(tmp_path, [record], "this build")()
    assert load_record(tmp_path, 3, small_mission, "this build") is not None
    assert load_record(tmp_path, 3, small_mission, "another") is None
    record_path(tmp_path, 3).rename(record_path(tmp_path, 4))
    assert load_record(tmp_path, 4, small_mission, "this build") is None


def test_a_portion_is_one_file_and_damage_costs_no_more_than_that(
    small_mission: Mission, tmp_path: Path
) -> None:
    nothing = no_trajectory(small_mission)
    for cases in ((1, 3, 5), (2, 4), (0,), (7,)):
        records = [CaseRecord(case, nothing, f"case {case}", 0, 0.0) for case in cases]
        keeping_records(tmp_path, records, "this build")()
    assert names(tmp_path) == [f"cases_00000{first}.rec" for first in (0, 1, 2, 7)]
    assert count_records(tmp_path) == 7
    files, damaged = recorded_cases(tmp_path, 9, "this build")
    assert files.tolist() == [0, 1, 2, 1, 2, 1, NOT_KEPT, 7, NOT_KEPT]
    assert damaged == []
    found = load_records(tmp_path, 1, (3, 5, 8), small_mission, "this build")
    assert {case: record.message for case, record in found.items()} == {3: "case 3", 5: "case 5"}
    raw = bytearray(record_path(tmp_path, 1).read_bytes())
    raw[-1] ^= 1  # of the last record
    record_path(tmp_path, 1).write_bytes(raw)
    assert list(load_records(tmp_path, 1, (1, 3, 5), small_mission, "this build")) == [1, 3]
    record_path(tmp_path, 2).write_bytes(record_path(tmp_path, 2).read_bytes()[:3])
    record_path(tmp_path, 7).write_bytes(record_path(tmp_path, 0).read_bytes())
    files, damaged = recorded_cases(tmp_path, 9, "this build")
    assert files.tolist() == [0, *[NOT_KEPT] * 8]
    assert sorted(damaged) == [record_path(tmp_path, first) for first in (1, 2, 7)]
    files, damaged = recorded_cases(tmp_path, 9, "another")
    assert (files == NOT_KEPT).all()
    assert len(damaged) == 4


def test_a_record_that_cannot_be_read_is_not_taken_for_a_damaged_one(
    small_mission: Mission, tmp_path: Path
) -> None:
    """It may be whole: another user's, or a disk that is away for a moment."""
    record_path(tmp_path, 3).mkdir()
    with pytest.raises(OSError, match="Is a directory"):
        load_record(tmp_path, 3, small_mission, "this build")
    (tmp_path / FINGERPRINTS[0]).mkdir()
    with pytest.raises(OSError, match="Is a directory"):
        read_fingerprint(fingerprints(tmp_path))


def test_one_copy_of_the_fingerprint_is_enough(tmp_path: Path) -> None:
    """The disk cannot read the first, be it damaged or out of reach."""
    write_fingerprint(fingerprints(tmp_path), {"solver": "this one"})
    (tmp_path / FINGERPRINTS[0]).unlink()
    (tmp_path / FINGERPRINTS[0]).mkdir()
    assert read_fingerprint(fingerprints(tmp_path)) == {"solver": "this one"}


def test_a_block_is_of_its_build(tmp_path: Path) -> None:
    keeping_block(tmp_path, 2, b"values", "this build")()
    assert load_block(tmp_path, 2, "this build") == b"values"
    assert load_block(tmp_path, 2, "another") is None


def test_a_folder_that_empties_as_its_lock_closes_goes(tmp_path: Path) -> None:
    """A network's file system keeps an open file under another name until it is closed."""
    folder = tmp_path / "a.h5.partial"
    with exclusive(folder):
        (folder / "lock").unlink()
        assert folder.is_dir()
    assert not folder.exists()
