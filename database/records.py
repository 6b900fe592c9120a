"""What is kept of a build under way: one file per result in `PATH.partial`.

    build.json         what the records belong to: mission, solver, version
    mission.toml       the mission itself, so that a case can be examined before the file is whole
    case_000042.npz    one solved or failed case
    block_000003.npz   a run of cases in index order, with gains and re-integration, ready to merge
    lock               held by the process that builds

Every file is written under another name, flushed to disk and renamed: a process that dies at any moment
leaves whole files only, and the next one continues from them. A result is a function of the mission
alone, so writing one twice does no harm.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.trajectory import Statistics, Status, Trajectory

_DAMAGED = (OSError, ValueError, KeyError, EOFError, BadZipFile)


@dataclass(frozen=True, eq=False)
class CaseRecord:
    """What is kept of one case."""

    case: int
    trajectory: Trajectory
    message: str
    solves: int  # optimal control problems solved to get there
    seconds: float


def keep(target: Path, write: Callable[[IO[bytes]], None]) -> None:
    """Write, flush, rename: `target` is whole or absent.

    The folder is not flushed: a loss of power may take back the last renames, and those results are
    worked out again. Flushing it would cost as much as flushing the file, for every case.
    """
    temporary = target.with_name(f"{target.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except OSError:
        temporary.unlink(missing_ok=True)  # a full disk needs the room
        raise


def record_path(folder: Path, case: int) -> Path:
    """File of one case."""
    return folder / f"case_{case:06d}.npz"


def save_record(folder: Path, record: CaseRecord) -> None:
    """Keep one case."""
    trajectory = record.trajectory
    counts = [int(trajectory.status), trajectory.statistics.iterations, record.solves]
    values = {
        "states": trajectory.states,
        "bank_rate": trajectory.bank_rate,
        "scalars": np.array([trajectory.final_time, trajectory.cost, record.seconds]),
        "counts": np.array(counts),
        "limit_excess": np.array(trajectory.statistics.limit_excess),
        "message": np.array(record.message),
    }
    keep(record_path(folder, record.case), lambda file: _write_arrays(file, values))


def load_record(folder: Path, case: int, mission: Mission) -> CaseRecord | None:
    """The record of a case, or None if it is absent or damaged (then it is solved again)."""
    try:
        with record_path(folder, case).open("rb") as file, np.load(file) as data:
            final_time, cost, seconds = (float(v) for v in data["scalars"])
            status, iterations, solves = (int(v) for v in data["counts"])
            excess = data["limit_excess"]
            trajectory = Trajectory(
                mesh=mission.pseudospectral_mesh,
                states=data["states"],
                bank_rate=data["bank_rate"],
                final_time=final_time,
                cost=cost,
                status=Status(status),
                statistics=Statistics(
                    iterations=iterations,
                    limit_excess=tuple(excess.tolist()),
                ),
            )
            return CaseRecord(case, trajectory, str(data["message"]), solves, seconds)
    except _DAMAGED:
        return None


def block_path(folder: Path, number: int) -> Path:
    """File of one block."""
    return folder / f"block_{number:06d}.npz"


def save_block(folder: Path, number: int, values: dict[str, NDArray[Any]]) -> None:
    """Keep one block."""
    keep(block_path(folder, number), lambda file: _write_arrays(file, values))


def load_block(folder: Path, number: int) -> dict[str, NDArray[Any]] | None:
    """The values of a block, or None if it is absent or damaged (then it is assembled again)."""
    try:
        with block_path(folder, number).open("rb") as file, np.load(file) as data:
            return {name: data[name] for name in data.files}
    except _DAMAGED:
        return None


def write_fingerprint(folder: Path, fingerprint: dict[str, str], toml: str) -> None:
    """Mark a folder of records with what made it."""
    keep(folder / "mission.toml", lambda file: _write_text(file, toml))
    text = json.dumps(fingerprint, indent=1, sort_keys=True)
    keep(folder / "build.json", lambda file: _write_text(file, text))


def _write_arrays(file: IO[bytes], values: Mapping[str, NDArray[Any]]) -> None:
    np.savez(file, **values)  # type: ignore[arg-type]  # no name is one of savez's own


def _write_text(file: IO[bytes], text: str) -> None:
    file.write(text.encode("utf-8"))


def read_fingerprint(folder: Path) -> dict[str, str] | None:
    """What made the records of a folder; None if it holds none."""
    try:
        return dict(json.loads((folder / "build.json").read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return None


def discard_records(folder: Path) -> None:
    """Empty the folder of records; what they belong to goes last, so no record is ever orphaned."""
    last = folder / "build.json"
    for file in [*folder.glob("*.npz"), *folder.glob("*.tmp"), folder / "mission.toml", last]:
        file.unlink(missing_ok=True)
