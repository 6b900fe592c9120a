"""Is a database file what was written? Where is it damaged?

    seal          SHA-256 of all bytes, in the user block           any flipped bit
    HDF5          superblock, headers, indices                      opens, every dataset is there
    chunks        fletcher32 of every chunk                         which cases a damage touches
    content       SHA-256 of values and attributes                  a file rewritten by other means
    schema        version, shapes, types, units                     a file of other making
    values        axes are those of the mission's grid; solved cases are finite, others NaN

The loader refuses a file at the first doubt; here every check runs as far as it can, a chunk at a time.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ampi.dataset import (
    ANGLE_RATE,
    DIGEST,
    SCHEMA_VERSION,
    DatasetError,
    axis_faults,
    content_digest,
    described,
    is_this_schema,
    partial_folder,
    refuse_while_written,
    seal_holds,
)
from ampi.hdf5.seal import opened
from ampi.missions.loading import parse_mission
from ampi.trajectory import Status

FINITE = (
    "states",
    "bank_rate",
    ANGLE_RATE,
    "gains",
    "final_time",
)  # in every solved case, and in no other


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
        If there is no file to check, or another program is writing it.
    """
    path = Path(path)
    if not path.is_file():
        unfinished = partial_folder(path).is_dir()
        state = "its build is not finished" if unfinished else "no such file"
        state = "a folder" if path.is_dir() else state
        raise DatasetError(f"{path}: {state}, there is nothing to verify")
    with path.open("rb") as handle:
        sha256 = hashlib.file_digest(handle, "sha256").hexdigest()
    sealed = seal_holds(path)
    if not sealed:
        refuse_while_written(path)
    found = Findings() if sealed else _in_a_process_of_its_own(path)
    if sealed:
        examine(path, found)
    else:
        found.faults.insert(0, "seal: the bytes of the file are not those written")
    return Verification(
        path=path,
        bytes=path.stat().st_size,
        sha256=sha256,
        datasets=found.datasets,
        cases=found.cases,
        solved=found.solved,
        faults=tuple(found.faults),
    )


@dataclass(eq=False)
class Findings:
    """What has been found so far."""

    datasets: int = 0
    cases: int = 0
    solved: int = 0
    faults: list[str] = field(default_factory=list)


def examine(path: Path, found: Findings) -> None:
    """Let HDF5 read the file to its end, noting what is wrong."""
    try:
        with opened(path) as file:
            found.datasets = len(file)
            for fault in _check(file):
                found.faults.append(fault)
            found.cases, found.solved = _count(file)
    except Exception as error:  # what a damaged file looks like to a reader, nobody can list
        found.faults.append(f"HDF5: the file cannot be read to its end ({_short(error)})")


_EXAMINE = """
import json, sys
from pathlib import Path
from database.audit.verify import Findings, examine
found = Findings()
examine(Path(sys.argv[1]), found)
print(json.dumps(vars(found)))
"""
PATIENCE = 600.0  # s


def _in_a_process_of_its_own(path: Path) -> Findings:
    """Examine a file that is known to be damaged: HDF5 may crash or loop on it."""
    paths = os.pathsep.join(str(Path(p).resolve()) for p in sys.path)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _EXAMINE, str(path)],
            env={**os.environ, "PYTHONPATH": paths},
            capture_output=True,
            timeout=PATIENCE,
            check=True,
        )
    except subprocess.CalledProcessError as error:
        cause = -error.returncode if error.returncode < 0 else error.returncode
        return Findings(faults=[f"HDF5: its library crashes on the file (signal {cause})"])
    except subprocess.TimeoutExpired:
        return Findings(faults=[f"HDF5: its library did not come to an end in {PATIENCE:g} s"])
    return Findings(**json.loads(done.stdout))


def _check(file: h5py.File) -> Iterator[str]:
    version = file.attrs.get("schema_version")
    if version is None:
        yield "schema: an HDF5 file, but not a trajectory database"
        return
    if not is_this_schema(version):
        yield (
            f"schema: version {version}, this ampi verifies version {SCHEMA_VERSION}; "
            f"use ampi {file.attrs.get('ampi_version', '?')}, which wrote the file"
        )
        return
    missing = [name for name in described(file.attrs) if name not in file]
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
        places = list(dataset.iter_chunks()) if dataset.chunks else [()]
        for place in places:
            try:
                dataset[place]
            except (OSError, RuntimeError) as error:
                bad.append(f"{tuple(s.start for s in place)} ({_short(error)})")
        if bad:
            yield f"{name}: {len(bad)} of {len(places)} chunks damaged, the first at index {bad[0]}"


def _check_schema(file: h5py.File) -> Iterator[str]:
    parameters = tuple(f"axis_{n}" for n in file.attrs["parameters"])
    for name, form in described(file.attrs).items():
        scales = (*(parameters if form.per_case else ()), *form.dimensions)
        absent = [s for s in scales if s not in file]
        if absent:
            yield f"{name}: the scale(s) {', '.join(absent)} are missing"
            continue
        expected = tuple(len(file[s]) for s in scales)
        dataset = file[name]
        if dataset.shape != expected or dataset.dtype != np.dtype(form.dtype):
            yield (
                f"{name}: expected shape {expected} of type {np.dtype(form.dtype)}, "
                f"got {dataset.shape} of {dataset.dtype}"
            )
        if dataset.attrs.get("units") != form.units:
            yield f"{name}: expected units {form.units!r}, got {dataset.attrs.get('units')!r}"


def _check_values(file: h5py.File) -> Iterator[str]:
    try:
        yield from axis_faults(file, parse_mission(str(file.attrs["mission_toml"])))
    except ValueError as error:
        yield f"mission_toml: {_short(error)}"
    status = file["status"]
    form = described(file.attrs)
    for name in (name for name in FINITE if name in form):
        dataset, inner = file[name], len(form[name].dimensions)
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
