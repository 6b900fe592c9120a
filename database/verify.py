"""Is a database file what was written? Where is it damaged?

    seal          SHA-256 of all bytes, in the user block           any flipped bit
    HDF5          superblock, headers, indices                      opens, every dataset is there
    chunks        fletcher32 of every chunk                         which cases a damage touches
    content       SHA-256 of values and attributes                  a file rewritten by other means
    schema        version, shapes, types, units                     a file of other making
    values        axes increase; solved cases are finite, others NaN

The loader refuses a file at the first doubt; here every check runs as far as it can, a chunk at a time.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ampi.dataset import (
    DIGEST,
    FIELDS,
    SCHEMA_VERSION,
    DatasetError,
    content_digest,
    partial_folder,
    seal_holds,
)
from ampi.trajectory import Status

UNREADABLE = (OSError, RuntimeError, KeyError, ValueError, TypeError, zlib.error)
FINITE = ("states", "bank_rate", "gains", "final_time")  # in every solved case, and in no other


@dataclass(frozen=True)
class Verification:
    """What `verify` found."""

    path: Path
    bytes: int
    sha256: str  # of the whole file
    datasets: int
    cases: int
    solved: int
    faults: tuple[str, ...]

    @property
    def whole(self) -> bool:
        """Whether nothing is wrong."""
        return not self.faults

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "path": str(self.path), "whole": self.whole}


def verify(path: str | Path) -> Verification:
    """Check every byte of a database file and name what is damaged.

    Raises
    ------
    DatasetError
        If there is no file to check.
    """
    path = Path(path)
    if not path.is_file():
        unfinished = partial_folder(path).is_dir()
        state = "its build is not finished" if unfinished else "no such file"
        raise DatasetError(f"{path}: {state}, there is nothing to verify")
    with path.open("rb") as handle:
        sha256 = hashlib.file_digest(handle, "sha256").hexdigest()
    faults = [] if seal_holds(path) else ["seal: the bytes of the file are not those written"]
    datasets = cases = solved = 0
    try:
        with h5py.File(path, "r") as file:
            datasets = len(file)
            faults += _check(file)
            cases, solved = _count(file)
    except UNREADABLE as error:
        faults.append(f"HDF5: the file cannot be read to its end ({_short(error)})")
    return Verification(path, path.stat().st_size, sha256, datasets, cases, solved, tuple(faults))


def _check(file: h5py.File) -> Iterator[str]:
    version = file.attrs.get("schema_version")
    if version is None:
        yield "schema: an HDF5 file, but not a trajectory database"
        return
    if int(version) != SCHEMA_VERSION:
        yield (
            f"schema: version {version}, this ampi verifies version {SCHEMA_VERSION}; "
            f"use ampi {file.attrs.get('ampi_version', '?')}, which wrote the file"
        )
        return
    missing = [name for name in FIELDS if name not in file]
    missing += [f"axis_{n}" for n in file.attrs["parameters"] if f"axis_{n}" not in file]
    if missing:
        yield f"schema: missing dataset(s) {', '.join(missing)}"
        return
    damaged = list(_check_chunks(file))
    yield from damaged
    yield from _check_schema(file)
    if damaged:  # what cannot be read has neither a digest nor values
        return
    if file.attrs.get(DIGEST) != content_digest(file):
        yield "content: values or attributes are not those whose digest the file states"
    yield from _check_values(file)


def _check_chunks(file: h5py.File) -> Iterator[str]:
    """Read everything; HDF5 checks each chunk against its checksum."""
    for name in sorted(file):
        dataset, bad = file[name], []
        for place in dataset.iter_chunks():
            try:
                dataset[place]
            except UNREADABLE as error:
                bad.append(f"{tuple(s.start for s in place)} ({_short(error)})")
        if bad:
            total = sum(1 for _ in dataset.iter_chunks())
            yield f"{name}: {len(bad)} of {total} chunks damaged, the first at index {bad[0]}"


def _check_schema(file: h5py.File) -> Iterator[str]:
    parameters = tuple(f"axis_{n}" for n in file.attrs["parameters"])
    for name, field in FIELDS.items():
        scales = (*(parameters if field.per_case else ()), *field.dimensions)
        absent = [s for s in scales if s not in file]
        if absent:
            yield f"{name}: the scale(s) {', '.join(absent)} are missing"
            continue
        expected = tuple(len(file[s]) for s in scales)
        dataset = file[name]
        if dataset.shape != expected or dataset.dtype != np.dtype(field.dtype):
            yield (
                f"{name}: expected shape {expected} of type {np.dtype(field.dtype)}, "
                f"got {dataset.shape} of {dataset.dtype}"
            )
        if dataset.attrs.get("units") != field.units:
            yield f"{name}: expected units {field.units!r}, got {dataset.attrs.get('units')!r}"


def _check_values(file: h5py.File) -> Iterator[str]:
    for name in file.attrs["parameters"]:
        axis = file[f"axis_{name}"][()]
        if not (np.all(np.isfinite(axis)) and np.all(np.diff(axis) > 0)):
            yield f"axis_{name}: expected finite, strictly increasing values, got {axis}"
    status = file["status"]
    for name in FINITE:
        dataset, inner = file[name], len(FIELDS[name].dimensions)
        wrong = 0
        for place in dataset.iter_chunks():
            here = place[: len(place) - inner]
            finite = np.isfinite(dataset[place])
            whole = finite.all(axis=tuple(range(len(here), len(place))))
            wrong += int(np.sum(whole != (status[here] == int(Status.SOLVED))))
        if wrong:
            yield f"{name}: {wrong} cases are not finite though solved, or finite though not solved"
    for name in ("node_time", "high_density_time", "ld_to_hd"):
        if not np.all(np.isfinite(file[name][()])):
            yield f"{name}: expected finite values"


def _count(file: h5py.File) -> tuple[int, int]:
    if "status" not in file:
        return 0, 0
    status = file["status"][()]
    return int(status.size), int(np.sum(status == int(Status.SOLVED)))


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:160]
