"""The trajectory database: HDF5 schema and read-only reader (database.file.hdf5_file writes it).

    /                      root attributes: schema_version, mission TOML, provenance, content digest
    axis_<parameter>       the parameter axes, dimension scales (SI, rad)
    state, target          names of the state rows and of those the target holds, dimension scales
    limit                  names of the mission's limits, dimension scale
    node, high_density     node indices, dimension scales
    states                 (p_1 … p_d, state, node)
    bank_rate              (p_1 … p_d, node)
    gains                  (p_1 … p_d, state, node)
    target_multipliers     (p_1 … p_d, target): what a solve beside a case starts from
    final_time, cost, status, iterations, position_error, altitude_error, speed_error, peak, message
    node_time              (2, node): a, b of t = a + b t_f
    high_density_time      (2, high_density)
    ld_to_hd               (node, high_density), P_FRP

and where they were asked for, which the root attribute `sensitivities` says,

    parameter, row         names of the parameters and of states, bank rate and gains, dimension scales
    sensitivities          (p_1 … p_d, parameter, row, node), ∂/∂p; NaN where an optimum has none
    final_time_sensitivity (p_1 … p_d, parameter)

and where the angle of attack is a control as well, which the root attribute `controls` says, it is the
last of the states, and of the rows, and there is

    tracked                names of the states that the gains multiply, dimension scale of theirs
    angle_of_attack_rate   (p_1 … p_d, node)

Every dataset carries `units` and `long_name`, is chunked with shuffle, gzip and fletcher32, and enters
the content digest (SHA-256), as do the root attributes. The whole file is sealed besides by a SHA-256
in its user block: a flipped bit anywhere is found on loading.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ampi.hdf5.seal import Seal, opened
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.missions.sections import MissionError
from ampi.physics.state import CONTROL_UNITS, STATE_UNITS, STEERED_UNITS
from ampi.trajectory import Statistics, Status, Trajectory

Array = NDArray[np.float64]

# An optional dataset more is no other schema: who reads the others reads what they read before.
# 5: with solver_settings, and another digest; 4: with the peaks of three limits only; 3: without
# time_limit; 2: and without target_multipliers; 1: and with six parameter axes always
SCHEMA_VERSION = 6
DIGEST = "content_sha256"
_SEAL = Seal("ampi trajectory database")
seal, seal_holds = _SEAL.write, _SEAL.holds


class DatasetError(ValueError):
    """A file that is not a whole trajectory database of this schema."""


@dataclass(frozen=True, eq=False)
class TrajectoryDataset:
    """The whole content of a database file, in memory. Grid shape (p_1 … p_d), c = its product."""

    mission: Mission
    names: tuple[str, ...]
    axes: tuple[Array, ...]
    states: Array  # (p…, 7, n); (p…, 8, n) where the angle of attack is a control
    bank_rate: Array  # (p…, n)
    gains: Array  # (p…, 7, n)
    target_multipliers: Array  # (p…, m), cost per SI unit of each row of the target
    final_time: Array  # (p…)
    cost: Array  # (p…)
    status: NDArray[np.int64]  # (p…)
    iterations: NDArray[np.int64]  # (p…)
    position_error: Array  # (p…), m, of re-integration
    altitude_error: Array  # (p…), m
    speed_error: Array  # (p…), m/s
    peak: Array  # (p…, l), greatest use of each limit of the mission, between the nodes
    message: NDArray[np.bytes_]  # (p…)
    conversion: Array  # (n, m)
    high_density_time: Array  # (2, m)
    attributes: dict[str, Any]
    sensitivities: Array | None = None  # (p…, d, 15, n): states, bank rate and gains over p
    final_time_sensitivity: Array | None = None  # (p…, d)
    angle_of_attack_rate: Array | None = None  # (p…, n), where it is a control

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
        rate = self.angle_of_attack_rate
        return Trajectory(
            mesh=self.mission.pseudospectral_mesh,
            states=self.states[index],
            bank_rate=self.bank_rate[index],
            final_time=float(self.final_time[index]),
            cost=float(self.cost[index]),
            status=Status(int(self.status[index])),
            statistics=Statistics(iterations=int(self.iterations[index])),
            target_multipliers=self.target_multipliers[index],
            angle_of_attack_rate=None if rate is None else rate[index],
        )


def content_digest(file: h5py.File, known: Mapping[str, bytes] | None = None) -> str:
    """SHA-256 over names, shapes, types, attributes and values of everything but the digest.

    The values of a dataset enter as the SHA-256 of its chunks' `chunk_digest`s in their order: `known`
    by its name, or read.
    """
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
        digest.update((known or {}).get(name) or _values_digest(dataset))
    return digest.hexdigest()


def _values_digest(dataset: h5py.Dataset) -> bytes:
    """A chunk at a time: a file may exceed the memory."""
    digest, last = hashlib.sha256(), None
    with ThreadPoolExecutor(1) as hashing:  # one chunk while the next is being read
        for part in dataset.iter_chunks() if dataset.chunks else (...,):  # forged: ours have chunks
            values = dataset[part]
            if last is not None:
                digest.update(last.result())
            last = hashing.submit(chunk_digest, values)
        if last is not None:
            digest.update(last.result())
    return digest.digest()


def chunk_digest(values: NDArray[Any]) -> bytes:
    """SHA-256 of the values of a chunk, in the type of its dataset, as far as they lie inside that."""
    return hashlib.sha256(values.tobytes()).digest()


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
    if path.is_dir():
        raise DatasetError(f"{path}: expected a file, got a folder")
    if not path.is_file():
        if partial_folder(path).is_dir():
            raise DatasetError(
                f"{path}: the build is not finished (its cases are in {partial_folder(path)}); "
                "run the same build command again to complete it"
            )
        raise DatasetError(f"{path}: no such file; make one with: ampi build MISSION {path}")
    _refuse_broken_seal(path)
    try:
        with opened(path) as file:
            return _read_checked(file, path)
    except (DatasetError, MissionError):
        raise
    except (OSError, KeyError, RuntimeError, TypeError, ValueError, zlib.error) as error:
        refuse_while_written(path)
        raise DatasetError(
            f"{path}: not a readable trajectory database, or damaged ({error}); rebuild it"
        ) from None


def refuse_while_written(path: Path) -> None:
    """Raise DatasetError if another program has the file open for writing: it need not be damaged.

    HDF5 holds a lock (flock) on a file that it writes. Where there are no locks, nobody can tell.
    """
    import fcntl  # a reader without trouble needs no POSIX

    with path.open("rb") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DatasetError(
                f"{path}: another program has the file open for writing; close it there and try again"
            ) from None
        except OSError:
            return


def stored_mission(path: Path) -> str | None:
    """Mission TOML of a database file, unchecked; None if it is not one."""
    try:
        with opened(path) as file:
            return str(file.attrs["mission_toml"])
    except (OSError, KeyError):
        return None


def _refuse_broken_seal(path: Path) -> None:
    """Before HDF5 sees the file: its library may crash on a damaged one."""
    if _SEAL.is_on(path) and not seal_holds(path):
        refuse_while_written(path)
        raise DatasetError(
            f"{path}: the file does not match its checksum, it is damaged; rebuild it "
            "('ampi verify' says what is damaged)"
        )


def is_this_schema(version: object) -> bool:
    """Whether a file's `schema_version` is the one that this module reads."""
    return isinstance(version, int | np.integer) and int(version) == SCHEMA_VERSION


def check_whole(file: h5py.File, path: Path) -> None:
    """Raise DatasetError unless an open file is a whole database of this schema."""
    version = file.attrs.get("schema_version")
    if version is None:
        raise DatasetError(f"{path}: an HDF5 file, but not a trajectory database")
    if not is_this_schema(version):
        raise DatasetError(
            f"{path}: schema version {version}, this ampi reads version {SCHEMA_VERSION}; read it "
            f"with the ampi that wrote it, {file.attrs.get('ampi_version', '?')} (git revision "
            f"{file.attrs.get('git_revision', '?')}), or build it anew from its mission"
        )
    if not seal_holds(path) or file.attrs.get(DIGEST) != content_digest(file):
        raise DatasetError(
            f"{path}: the file does not match its checksum, it is damaged; rebuild it"
        )


def axis_faults(file: h5py.File, mission: Mission) -> Iterator[str]:
    """Where the axes of a file are not those of the mission it carries: its cases are of those."""
    declared = [p.name for p in mission.parameters]
    names = [str(name) for name in file.attrs["parameters"]]
    if names != declared:
        yield f"parameters: expected {', '.join(declared)} of the mission's grid, got {', '.join(names)}"
        return
    for parameter in mission.parameters:
        axis = file[f"axis_{parameter.name}"][()]
        if not np.array_equal(axis, parameter.axis):
            yield (
                f"axis_{parameter.name}: expected {parameter.axis} of the mission's grid, got {axis}"
            )


def _read_checked(file: h5py.File, path: Path) -> TrajectoryDataset:
    check_whole(file, path)
    mission = parse_mission(str(file.attrs["mission_toml"]), label=f"{path}: mission")
    names = tuple(str(name) for name in file.attrs["parameters"])
    for fault in axis_faults(file, mission):
        raise DatasetError(f"{path}: {fault}; rebuild it")
    return TrajectoryDataset(
        mission=mission,
        names=names,
        axes=tuple(file[f"axis_{name}"][()] for name in names),
        conversion=file["ld_to_hd"][()],
        attributes=dict(file.attrs),
        **{name: file[name][()] for name in READ if name in described(file.attrs)},
    )


@dataclass(frozen=True)
class Field:
    """How one dataset is described in the file."""

    units: str
    long_name: str
    dimensions: tuple[str, ...]  # after the parameter axes if `per_case`
    per_case: bool = True
    dtype: str = "f8"


FIELDS: dict[str, Field] = {
    "states": Field(" ".join(STATE_UNITS), "optimal states at the Radau nodes", ("state", "node")),
    "bank_rate": Field(" ".join(CONTROL_UNITS), "optimal bank rate at the Radau nodes", ("node",)),
    "gains": Field(
        f"{CONTROL_UNITS[0]} per unit of each state",
        "tracking gains at the Radau nodes",
        ("state", "node"),
    ),
    "target_multipliers": Field(
        "cost per unit of each state", "multipliers of the target's rows", ("target",)
    ),
    "final_time": Field("s", "optimal final time", ()),
    "cost": Field("1", "optimal cost J", ()),
    "status": Field("1", "solver status; see the attribute 'meanings'", (), dtype="i8"),
    "iterations": Field("1", "convex iterations of the last solve", (), dtype="i8"),
    "position_error": Field("m", "greatest position error against re-integration", ()),
    "altitude_error": Field("m", "greatest altitude error against re-integration", ()),
    "speed_error": Field("m/s", "greatest speed error against re-integration", ()),
    "peak": Field("1", "greatest use of each limit, 1 s grid", ("limit",)),
    "message": Field("1", "how the case was solved, or why it failed", (), dtype="S1000"),
    "node_time": Field("s", "a, b of node times t = a + b t_f", ("affine", "node"), False),
    "high_density_time": Field(
        "s", "a, b of high-density times t = a + b t_f", ("affine", "high_density"), False
    ),
    "ld_to_hd": Field(
        "1", "low- to high-density conversion matrix", ("node", "high_density"), False
    ),
}
SENSITIVITIES = "sensitivities"  # the root attribute, and a dataset
SENSITIVITY_FIELDS: dict[str, Field] = {
    SENSITIVITIES: Field(
        f"{' '.join((*STATE_UNITS, *CONTROL_UNITS))}, {CONTROL_UNITS[0]} per unit of each state; "
        "per unit of each parameter",
        "derivatives of optimal states, bank rate and gains over the parameters",
        ("parameter", "row", "node"),
    ),
    "final_time_sensitivity": Field(
        "s per unit of each parameter",
        "derivatives of the optimal final time over the parameters",
        ("parameter",),
    ),
}
CONTROLS_OF = "controls"  # the root attribute of a file whose controls are two
ANGLE_RATE = "angle_of_attack_rate"
STEERED_FIELDS: dict[str, Field] = {
    "states": replace(FIELDS["states"], units=" ".join(STEERED_UNITS)),
    ANGLE_RATE: Field("rad/s", "optimal rate of the angle of attack at the Radau nodes", ("node",)),
    "gains": replace(FIELDS["gains"], dimensions=("tracked", "node")),
}
STEERED_SENSITIVITY = replace(
    SENSITIVITY_FIELDS[SENSITIVITIES],
    units=SENSITIVITY_FIELDS[SENSITIVITIES].units.replace(";", ", rad;"),
    long_name="derivatives of optimal states, bank rate, gains and angle of attack over the parameters",
)
READ = (  # what a TrajectoryDataset holds by the same name
    *(name for name, field in FIELDS.items() if field.per_case),
    "high_density_time",
    *SENSITIVITY_FIELDS,
    ANGLE_RATE,
)


def described(attributes: Mapping[str, Any]) -> dict[str, Field]:
    """The datasets of a file, but for scales, by its root attributes."""
    found = FIELDS | SENSITIVITY_FIELDS if SENSITIVITIES in attributes else FIELDS
    if CONTROLS_OF not in attributes:
        return found
    steered = found | STEERED_FIELDS
    return steered | {SENSITIVITIES: STEERED_SENSITIVITY} if SENSITIVITIES in found else steered
