"""The trajectory database: HDF5 schema and read-only reader.

    /                      root attributes: schema_version, mission TOML, provenance, content digest
    axis_<parameter>       the parameter axes, dimension scales (SI, rad)
    state                  names of the state rows, a dimension scale
    node, high_density     node indices, dimension scales
    states                 (p_1 … p_d, state, node)
    bank_rate              (p_1 … p_d, node)
    gains                  (p_1 … p_d, state, node)
    final_time, cost, status, iterations, position_error, altitude_error, speed_error, peak, message
    node_time              (2, node): a, b of t = a + b t_f
    high_density_time      (2, high_density)
    ld_to_hd               (node, high_density), P_FRP

Every dataset carries `units` and `long_name`, is chunked with shuffle, gzip and fletcher32, and enters
the content digest (SHA-256), as do the root attributes. The whole file is sealed besides by a SHA-256
in its user block: a flipped bit anywhere is found on loading.
"""

from __future__ import annotations

import hashlib
import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission, parse_mission
from ampi.trajectory import Statistics, Status, Trajectory

Array = NDArray[np.float64]

SCHEMA_VERSION = 2  # 1: six parameter axes always, those of one point included
DIGEST = "content_sha256"
SEAL_BYTES = 512  # the smallest HDF5 user block; readers skip it


class DatasetError(ValueError):
    """A file that is not a whole trajectory database of this schema."""


@dataclass(frozen=True, eq=False)
class TrajectoryDataset:
    """The whole content of a database file, in memory. Grid shape (p_1 … p_d), c = its product."""

    mission: Mission
    names: tuple[str, ...]
    axes: tuple[Array, ...]
    states: Array  # (p…, 7, n)
    bank_rate: Array  # (p…, n)
    gains: Array  # (p…, 7, n)
    final_time: Array  # (p…)
    cost: Array  # (p…)
    status: NDArray[np.int64]  # (p…)
    iterations: NDArray[np.int64]  # (p…)
    position_error: Array  # (p…), m, of re-integration
    altitude_error: Array  # (p…), m
    speed_error: Array  # (p…), m/s
    peak: Array  # (p…, 3), path constraints over their limits, between the nodes
    message: NDArray[np.bytes_]  # (p…)
    conversion: Array  # (n, m)
    high_density_time: Array  # (2, m)
    attributes: dict[str, Any]

    @property
    def shape(self) -> tuple[int, ...]:
        """Points per axis."""
        return self.final_time.shape

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Cases that may fly, (p…)."""
        return np.asarray(self.status == int(Status.SOLVED))

    def trajectory(self, case: int) -> Trajectory:
        """Case number `case` (C order) as a Trajectory."""
        index = np.unravel_index(case, self.shape)
        return Trajectory(
            mesh=self.mission.pseudospectral_mesh,
            states=self.states[index],
            bank_rate=self.bank_rate[index],
            final_time=float(self.final_time[index]),
            cost=float(self.cost[index]),
            status=Status(int(self.status[index])),
            statistics=Statistics(iterations=int(self.iterations[index])),
        )


def content_digest(file: h5py.File) -> str:
    """SHA-256 over names, shapes, types, attributes and values of everything but the digest."""
    digest = hashlib.sha256()

    def add_attributes(node: h5py.HLObject) -> None:
        for key in sorted(node.attrs):
            if key != DIGEST and key not in _SCALE_ATTRIBUTES:
                value = node.attrs[key]
                text = [str(v) for v in value] if isinstance(value, np.ndarray) else str(value)
                digest.update(f"{key}={text}".encode())

    add_attributes(file)
    for name in sorted(file):
        dataset = file[name]
        digest.update(f"{name}:{dataset.shape}:{dataset.dtype}".encode())
        add_attributes(dataset)
        digest.update(np.ascontiguousarray(dataset[()]).tobytes())
    return digest.hexdigest()


# HDF5's own bookkeeping of dimension scales: object references, which depend on the file's layout.
_SCALE_ATTRIBUTES = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"}


def partial_folder(path: str | Path) -> Path:
    """Where a build keeps its case records until the file is whole."""
    return Path(f"{path}.partial")


def read_dataset(path: str | Path) -> TrajectoryDataset:
    """Read and check a database file.

    Raises
    ------
    DatasetError
        If the file is absent, half-built, damaged, or of another schema; the message says which.
    """
    path = Path(path)
    if not path.is_file():
        if partial_folder(path).is_dir():
            raise DatasetError(
                f"{path}: the build is not finished (its cases are in {partial_folder(path)}); "
                "run the same build command again to complete it"
            )
        raise DatasetError(f"{path}: no such file; make one with: ampi build MISSION {path}")
    try:
        with h5py.File(path, "r") as file:
            return _read_checked(file, path)
    except (OSError, KeyError, RuntimeError, UnicodeDecodeError, zlib.error) as error:
        raise DatasetError(
            f"{path}: not a readable trajectory database, or damaged ({error}); rebuild it"
        ) from None


def stored_mission(path: Path) -> str | None:
    """Mission TOML of a database file, unchecked; None if it is not one."""
    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs["mission_toml"])
    except (OSError, KeyError):
        return None


def _seal(content: bytes) -> bytes:
    """User block in front of the HDF5 content: its SHA-256, so that any flipped byte is found."""
    text = f"ampi trajectory database\nsha256 of what follows byte {SEAL_BYTES}: "
    return (text + hashlib.sha256(content).hexdigest() + "\n").encode().ljust(SEAL_BYTES, b"\n")


def _read_checked(file: h5py.File, path: Path) -> TrajectoryDataset:
    version = file.attrs.get("schema_version")
    if version is None:
        raise DatasetError(f"{path}: an HDF5 file, but not a trajectory database")
    if int(version) != SCHEMA_VERSION:
        raise DatasetError(
            f"{path}: schema version {version}, this ampi reads version {SCHEMA_VERSION}; read it "
            f"with the ampi that wrote it, {file.attrs.get('ampi_version', '?')} (git revision "
            f"{file.attrs.get('git_revision', '?')}), or build it anew from its mission"
        )
    raw = path.read_bytes()
    if raw[:SEAL_BYTES] != _seal(raw[SEAL_BYTES:]) or file.attrs.get(DIGEST) != content_digest(
        file
    ):
        raise DatasetError(
            f"{path}: the file does not match its checksum, it is damaged; rebuild it"
        )
    mission = parse_mission(str(file.attrs["mission_toml"]), label=f"{path}: mission")
    names = tuple(str(name) for name in file.attrs["parameters"])
    return TrajectoryDataset(
        mission=mission,
        names=names,
        axes=tuple(file[f"axis_{name}"][()] for name in names),
        conversion=file["ld_to_hd"][()],
        attributes=dict(file.attrs),
        **{
            name: file[name][()]
            for name in (
                "states",
                "bank_rate",
                "gains",
                "final_time",
                "cost",
                "status",
                "iterations",
                "position_error",
                "altitude_error",
                "speed_error",
                "peak",
                "message",
                "high_density_time",
            )
        },
    )


@dataclass(frozen=True)
class Field:
    """How one dataset is described in the file."""

    units: str
    long_name: str
    dimensions: tuple[str, ...]  # after the parameter axes if `per_case`
    per_case: bool = True


STATE_UNITS = "m rad rad m/s rad rad rad"
FIELDS: dict[str, Field] = {
    "states": Field(STATE_UNITS, "optimal states at the Radau nodes", ("state", "node")),
    "bank_rate": Field("rad/s", "optimal bank rate at the Radau nodes", ("node",)),
    "gains": Field(
        "rad/s per unit of each state", "tracking gains at the Radau nodes", ("state", "node")
    ),
    "final_time": Field("s", "optimal final time", ()),
    "cost": Field("1", "optimal cost J", ()),
    "status": Field("1", "solver status; see the attribute 'meanings'", ()),
    "iterations": Field("1", "convex iterations of the last solve", ()),
    "position_error": Field("m", "greatest position error against re-integration", ()),
    "altitude_error": Field("m", "greatest altitude error against re-integration", ()),
    "speed_error": Field("m/s", "greatest speed error against re-integration", ()),
    "peak": Field("1", "greatest path constraint over its limit, 1 s grid", ("limit",)),
    "message": Field("1", "how the case was solved, or why it failed", ()),
    "node_time": Field("s", "a, b of node times t = a + b t_f", ("affine", "node"), False),
    "high_density_time": Field(
        "s", "a, b of high-density times t = a + b t_f", ("affine", "high_density"), False
    ),
    "ld_to_hd": Field(
        "1", "low- to high-density conversion matrix", ("node", "high_density"), False
    ),
}


def write_dataset(
    path: Path,
    *,
    names: tuple[str, ...],
    axes: tuple[Array, ...],
    axis_units: tuple[str, ...],
    scales: Mapping[str, NDArray[Any]],
    values: Mapping[str, NDArray[Any]],
    attributes: Mapping[str, Any],
) -> None:
    """Write a database under another name, check it by reading, flush it and rename it to `path`."""
    temporary = path.with_name(path.name + ".tmp")
    with h5py.File(temporary, "w", track_order=False, userblock_size=SEAL_BYTES) as file:
        for key, value in attributes.items():
            file.attrs[key] = value
        for name, axis, unit in zip(names, axes, axis_units, strict=True):
            scale = file.create_dataset(f"axis_{name}", data=axis, fletcher32=True, chunks=True)
            scale.make_scale(name)
            scale.attrs["units"], scale.attrs["long_name"] = unit, f"parameter axis: {name}"
        for name, scale_values in scales.items():
            scale = file.create_dataset(name, data=scale_values, fletcher32=True, chunks=True)
            scale.make_scale(name)
            scale.attrs["units"], scale.attrs["long_name"] = "1", f"{name} labels"
        for name, field in FIELDS.items():
            _write_field(file, name, field, values[name], names)
        file["status"].attrs["meanings"] = "; ".join(
            f"{int(s)} {s.name}: {s.sentence}" for s in Status
        )
        file.attrs[DIGEST] = content_digest(file)
    with temporary.open("rb+") as handle:
        handle.seek(SEAL_BYTES)
        seal = _seal(handle.read())
        handle.seek(0)
        handle.write(seal)
        handle.flush()
        os.fsync(handle.fileno())
    read_dataset(temporary)  # a file that cannot be read back never gets the real name
    temporary.replace(path)


def _write_field(
    file: h5py.File, name: str, field: Field, value: NDArray[Any], names: tuple[str, ...]
) -> None:
    dataset = file.create_dataset(
        name, data=value, chunks=True, shuffle=True, compression="gzip", fletcher32=True
    )
    dataset.attrs["units"], dataset.attrs["long_name"] = field.units, field.long_name
    parameters = tuple(f"axis_{n}" for n in names) if field.per_case else ()
    for i, scale in enumerate((*parameters, *field.dimensions)):
        dataset.dims[i].label = scale.removeprefix("axis_")
        dataset.dims[i].attach_scale(file[scale])
