"""What is kept of a build under way: one file per result in `PATH.partial`.

    build.json         what the records belong to: mission, solver, settings, version
    build.copy.json    the same: a fault of the disk in one of them must not cost the records
    mission.toml       the mission itself, so that a case can be examined before the file is whole
    case_000042.rec    one solved or failed case: see `CaseRecord.packed`
    block_000003.rec   a run of cases in index order, with gains and re-integration, ready to merge
    again_01           records and blocks of a second pass over what was not solved, round by round
    lock               held by the process that builds

Every file is written under another name, flushed to disk and renamed: a process that dies at any moment
leaves whole files only, and the next one continues from them. A result is a function of the mission
alone, so writing one twice does no harm.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import shutil
import socket
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.trajectory import Statistics, Status, Trajectory

HOST = socket.gethostname()
CHECKSUM_BYTES = 4
NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
AT_ONCE = 64  # files that a thread takes to delete
DELETERS = 16  # a file that was flushed takes milliseconds to delete; side by side they overlap
_RECORD = re.compile(r"case_(\d{6,})\.rec")
_RESULT = re.compile(r"case_.*|block_.*|mission\.toml")
FINGERPRINTS = ("build.json", "build.copy.json")
_NOTHING_WHOLE = (FileNotFoundError, ValueError, KeyError)  # a disk that cannot be read says so


@dataclass(frozen=True, eq=False)
class CaseRecord:
    """What is kept of one case."""

    case: int
    trajectory: Trajectory
    message: str
    solves: int  # optimal control problems solved to get there
    seconds: float

    def packed(self, label: str) -> bytes:
        """One line of JSON, the arrays it names one after the other as f8, a CRC-32 of all that.

        The CRC is also of the build's `label` and of the case's number.

        An .npz takes ten times as long to read, a quarter of a millisecond, and portions read hundreds.
        """
        t = self.trajectory
        arrays = {"states": t.states, "bank_rate": t.bank_rate}
        if t.target_multipliers is not None:
            arrays["target_multipliers"] = t.target_multipliers
        scalars = np.array([t.final_time, t.cost, self.seconds, *t.statistics.limit_excess])
        arrays["scalars"] = scalars  # not in JSON: it has no word for what is not a number
        head = {
            "status": int(t.status),
            "iterations": t.statistics.iterations,
            "solves": self.solves,
            "message": self.message,
            "shapes": {name: values.shape for name, values in arrays.items()},
        }
        parts = [json.dumps(head).encode(), b"\n"]
        parts += [np.ascontiguousarray(values, dtype="<f8").tobytes() for values in arrays.values()]
        return _sealed(b"".join(parts), _mark(label, self.case))

    @classmethod
    def unpacked(cls, case: int, raw: bytes, mission: Mission, label: str) -> CaseRecord:
        """The record in `raw`; ValueError if it is damaged, or of another case or build."""
        body = _unsealed(raw, _mark(label, case))
        line, _, _ = body.partition(b"\n")
        head, place = json.loads(line), len(line) + 1
        arrays = {}
        for name, shape in head["shapes"].items():
            count = math.prod(shape)
            arrays[name] = np.frombuffer(body, "<f8", count, place).reshape(shape)
            place += 8 * count
        final_time, cost, seconds, *excess = arrays["scalars"].tolist()
        trajectory = Trajectory(
            mesh=mission.pseudospectral_mesh,
            states=arrays["states"],
            bank_rate=arrays["bank_rate"],
            final_time=final_time,
            cost=cost,
            status=Status(head["status"]),
            statistics=Statistics(iterations=head["iterations"], limit_excess=tuple(excess)),
            target_multipliers=arrays.get("target_multipliers"),
        )
        return cls(case, trajectory, head["message"], head["solves"], seconds)


def keeping(results: Mapping[str, bytes]) -> Callable[[], None]:
    """Write all under other names; what it returns flushes and renames: every target is whole or absent.

    The kernel is told to bring them all to the disk before any is waited for. A flush then mostly finds
    its work done; one by one, each would wait for the disk in its turn. The folder is not flushed: a
    loss of power may take back the last renames, and those results are worked out again.
    """
    writer = f"{HOST}.{os.getpid()}"  # on a cluster, two may have one number
    temporaries = [f"{target}.{writer}.tmp" for target in results]
    files: list[int] = []

    def keep() -> None:
        with _cleared_away(files, temporaries):
            for file in files:
                os.fsync(file)
            while files:
                os.close(files.pop())
            for temporary, target in zip(temporaries, results, strict=True):
                os.replace(temporary, target)

    with _cleared_away(files, temporaries):
        for temporary, raw in zip(temporaries, results.values(), strict=True):
            files.append(os.open(temporary, NEW_FILE, 0o666))
            _write(files[-1], raw)
        if hasattr(os, "posix_fadvise"):
            for file in files:  # who does not need a page has it written
                os.posix_fadvise(file, 0, 0, os.POSIX_FADV_DONTNEED)
    return keep


@contextmanager
def _cleared_away(files: list[int], temporaries: list[str]) -> Iterator[None]:
    """If the disk refuses, close and delete: what is kept needs the room."""
    try:
        yield
    except OSError:
        while files:
            os.close(files.pop())
        for temporary in temporaries:
            Path(temporary).unlink(missing_ok=True)
        raise


def _write(file: int, raw: bytes) -> None:
    """All of it: a disk that is nearly full takes a part without a word."""
    left = memoryview(raw)
    while left:
        left = left[os.write(file, left) :]


@contextmanager
def no_parts(folder: Path) -> Iterator[None]:
    """Delete, before and after, what processes that were killed did not finish: it holds room.

    A driver that dies leaves some to the next; one that gives up kills its workers as they write.
    """
    _delete_parts(folder)
    try:
        yield
    finally:
        _delete_parts(folder)


def _delete_parts(folder: Path) -> None:
    with suppress(FileNotFoundError):  # the folder: the file is whole
        _delete(f"{folder}{os.sep}{name}" for name in _names(folder) if name.endswith(".tmp"))


def again_folder(folder: Path, rounds: int) -> Path:
    """Where the last of so many rounds of the second pass keeps its records; `folder` for none."""
    return folder / f"again_{rounds:02d}" if rounds else folder


def record_path(folder: Path, case: int) -> Path:
    """File of one case."""
    return folder / _record_name(case)


def is_recorded(folder: Path, case: int) -> bool:
    """Whether a case has a file, whole or not."""
    return os.path.exists(_record_file(folder, case))


def recorded_cases(folder: Path, count: int) -> NDArray[np.bool_]:
    """Which of the first `count` cases have a file, whole or not, (count,)."""
    found = np.zeros(count, dtype=bool)
    for name in _names(folder):
        match = _RECORD.fullmatch(name)
        if match and int(match[1]) < count and _record_name(int(match[1])) == name:
            found[int(match[1])] = True
    return found


def _names(folder: Path) -> Iterator[str]:
    """What lies in a folder, an entry at a time: it may hold millions."""
    with os.scandir(folder) as entries:
        for entry in entries:
            yield entry.name


def _record_name(case: int) -> str:
    return f"case_{case:06d}.rec"


def _record_file(folder: Path, case: int) -> str:
    """`record_path` as text: asking for a case is quicker than making a Path, and builds ask often."""
    return f"{folder}{os.sep}{_record_name(case)}"


def keeping_records(folder: Path, records: Iterable[CaseRecord], label: str) -> Callable[[], None]:
    """`keeping` cases of the build with this label, each in its file."""
    return keeping({_record_file(folder, r.case): r.packed(label) for r in records})


def load_record(folder: Path, case: int, mission: Mission, label: str) -> CaseRecord | None:
    """The record of a case; None if it is absent, damaged or of a build with another label.

    Another's: a cluster may still be running a job of a build that was given up, and keep its result in
    the folder of the next one.

    Raises
    ------
    OSError
        If it cannot be read: it may be whole.
    """
    try:
        with open(_record_file(folder, case), "rb", buffering=0) as file:
            raw = file.read()
        return CaseRecord.unpacked(case, raw, mission, label)
    except _NOTHING_WHOLE:
        return None


def block_path(folder: Path, number: int) -> Path:
    """File of one block."""
    return folder / f"block_{number:06d}.rec"


def keeping_block(folder: Path, number: int, encoded: bytes, label: str) -> Callable[[], None]:
    """`keeping` one block (`hdf5_file.encoded_block`) of the build with this label."""
    return keeping({str(block_path(folder, number)): _sealed(encoded, _mark(label, number))})


def load_block(folder: Path, number: int, label: str) -> bytes | None:
    """A block of the build with this label; None if it is absent, damaged or another's."""
    try:
        return _unsealed(block_path(folder, number).read_bytes(), _mark(label, number))
    except _NOTHING_WHOLE:
        return None


def write_fingerprint(folder: Path, fingerprint: dict[str, str], toml: str) -> None:
    """Mark a folder of records with what made it."""
    checked = {**fingerprint, "crc32": _crc_of(fingerprint)}
    text = json.dumps(checked, indent=1, sort_keys=True).encode()
    keeping({str(folder / "mission.toml"): toml.encode()})()
    keeping({str(folder / name): text for name in FINGERPRINTS})()


def label_of(fingerprint: Mapping[str, str]) -> str:
    """What the records of a build are sealed with."""
    return hashlib.sha256(json.dumps(fingerprint, sort_keys=True).encode()).hexdigest()


def _mark(label: str, number: int) -> int:
    """Where a CRC-32 begins that is to be of a result and of what it belongs to."""
    return zlib.crc32(str(number).encode(), _crc_of_text(label))


@lru_cache(maxsize=8)
def _crc_of_text(label: str) -> int:
    return zlib.crc32(label.encode())


def _sealed(raw: bytes, mark: int) -> bytes:
    return raw + zlib.crc32(raw, mark).to_bytes(CHECKSUM_BYTES, "little")


def _unsealed(raw: bytes, mark: int) -> bytes:
    body, checksum = raw[:-CHECKSUM_BYTES], raw[-CHECKSUM_BYTES:]
    if zlib.crc32(body, mark).to_bytes(CHECKSUM_BYTES, "little") != checksum:
        raise ValueError("a record does not match its checksum")
    return body


def read_fingerprint(folder: Path) -> dict[str, str] | None:
    """What made the records of a folder; None if no copy of it is whole.

    Raises
    ------
    OSError
        If no copy is whole, and one cannot be read.
    """
    unreadable: OSError | None = None
    for name in FINGERPRINTS:
        try:
            found = dict(json.loads((folder / name).read_text(encoding="utf-8")))
        except (FileNotFoundError, ValueError, TypeError):
            continue
        except OSError as error:
            unreadable = error
            continue
        if found.pop("crc32", "") == _crc_of(found):
            return found
    if unreadable is not None:
        raise unreadable
    return None


def _crc_of(fingerprint: dict[str, str]) -> str:
    return f"{zlib.crc32(json.dumps(fingerprint, sort_keys=True).encode()):08x}"


def count_records(folder: Path) -> int:
    """How many finished cases a folder holds."""
    return sum(_RECORD.fullmatch(name) is not None for name in _names(folder))


def discard_records(folder: Path) -> None:
    """Empty the folder of records; what they belong to goes last, so no record is ever orphaned."""
    for again in folder.glob("again_*"):
        shutil.rmtree(again)
    results = (f"{folder}{os.sep}{name}" for name in _names(folder) if _RESULT.fullmatch(name))
    taking = Lock()

    def delete_some() -> None:
        while True:
            with taking:
                some = list(islice(results, AT_ONCE))
            if not some:
                return
            _delete(some)

    with ThreadPoolExecutor(DELETERS) as pool:
        for done in [pool.submit(delete_some) for _ in range(DELETERS)]:
            done.result()
    _delete(f"{folder}{os.sep}{name}" for name in FINGERPRINTS)


def _delete(files: Iterable[str]) -> None:
    for file in files:
        with suppress(FileNotFoundError):
            os.unlink(file)
