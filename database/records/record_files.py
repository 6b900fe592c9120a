"""What is kept of a build under way: one file per job in `PATH.partial`.

    build.json         what the records belong to: mission, solver, settings, version
    build.copy.json    the same: a fault of the disk in one of them must not cost the records
    mission.toml       the mission itself, so that a case can be examined before the file is whole
    cases_000042.rec   solved or failed cases, 42 the first of them: a line that says which cases and how
                       many bytes each, then one `CaseRecord.packed` after the other
    block_000003.rec   a run of cases in index order, with gains and re-integration, ready to merge
    again_01           records and blocks of a second pass over what was not solved, round by round
    lock               held by the process that builds

Every file is written under another name, flushed to disk and renamed: a process that dies at any moment
leaves whole files only, and the next one continues from them. A result is a function of the mission
alone, so writing one twice does no harm. A case lies in one file, and whoever builds on it is told which
(`Files`): nobody looks for it. A file that is damaged costs its cases, a portion at most.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import zlib
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import islice
from pathlib import Path
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.workers.keeping import delete, entry_names, keeping
from ampi.workers.seal import mark, sealed, unsealed
from database.records.case_record import CaseRecord

AT_ONCE = 64  # files that a thread takes to delete
DELETERS = 16  # a file that was flushed takes milliseconds to delete; side by side they overlap
NOT_KEPT = -1
_RECORD = re.compile(r"cases_(\d{6,})\.rec")
_RESULT = re.compile(r"cases_.*|block_.*|mission\.toml")
Files = NDArray[np.int32]  # by case (c,): the file of its record, by its first case, or `NOT_KEPT`
FINGERPRINTS = ("build.json", "build.copy.json")
_NOTHING_WHOLE = (FileNotFoundError, ValueError, KeyError)  # a disk that cannot be read says so


def again_folder(folder: Path, rounds: int) -> Path:
    """Where the last of so many rounds of the second pass keeps its records; `folder` for none."""
    return folder / f"again_{rounds:02d}" if rounds else folder


def record_path(folder: Path, first: int) -> Path:
    """The file of records whose first case this is."""
    return folder / f"cases_{first:06d}.rec"


def keeping_records(folder: Path, records: Sequence[CaseRecord], label: str) -> Callable[[], None]:
    """`keeping` cases of the build with this label, in one file."""
    bodies = [r.packed(label) for r in records]
    first = records[0].case
    line = json.dumps([[r.case for r in records], [len(body) for body in bodies]])
    head = f"{line} {_crc_of_line(line, first, label)}\n".encode()
    return keeping({str(record_path(folder, first)): b"".join([head, *bodies])})


def load_records(
    folder: Path, first: int, cases: Iterable[int], mission: Mission, label: str
) -> dict[int, CaseRecord]:
    """Those of the `cases` whose records are whole, in a file of the build with this label.

    Another's: a cluster may still be running a job of a build that was given up, and keep its result in
    the folder of the next one.

    Raises
    ------
    OSError
        If it cannot be read: it may be whole.
    """
    found = {}
    try:
        bodies = _bodies(_read(folder, first), first, label)
    except _NOTHING_WHOLE:
        return {}
    for case in cases:
        with suppress(*_NOTHING_WHOLE):
            found[case] = CaseRecord.unpacked(case, bodies[case], mission, label)
    return found


def load_record(folder: Path, case: int, mission: Mission, label: str) -> CaseRecord | None:
    """The record of a case that is the first of its file; None if that is absent, damaged, another's."""
    return load_records(folder, case, (case,), mission, label).get(case)


def is_recorded(folder: Path, first: int) -> bool:
    """Whether there is a file of records of this name, whole or not."""
    return record_path(folder, first).exists()


def recorded_cases(folder: Path, count: int, label: str) -> tuple[Files, list[Path]]:
    """Where the records of the first `count` cases lie; the files that are damaged or another's.

    Raises
    ------
    OSError
        If one cannot be read: it may be whole.
    """
    found, damaged = nowhere(count), []
    for first in _record_files(folder):
        try:
            bodies = _bodies(_read(folder, first), first, label)
            for case, body in bodies.items():
                unsealed(body, mark(label, case))
            found[list(bodies)] = first
        except _NOTHING_WHOLE:
            damaged.append(record_path(folder, first))
    return found, damaged


def fingerprints(folder: Path) -> list[Path]:
    """The files that say what the records of a folder belong to."""
    return [folder / name for name in FINGERPRINTS]


def nowhere(count: int) -> Files:
    """Where the records lie while there are none."""
    return np.full(count, NOT_KEPT, dtype=np.int32)


def count_records(folder: Path) -> int:
    """How many finished cases a folder holds; one for a file that cannot be read."""
    count = 0
    for first in _record_files(folder):
        try:
            with record_path(folder, first).open("rb") as file:
                count += len(json.loads(file.readline().rpartition(b" ")[0])[0])
        except (OSError, ValueError):
            count += 1
    return count


def _record_files(folder: Path) -> list[int]:
    """The files of records by their first cases."""
    matches = (_RECORD.fullmatch(name) for name in entry_names(folder))
    return [int(match[1]) for match in matches if match]


def _read(folder: Path, first: int) -> bytes:
    with open(record_path(folder, first), "rb", buffering=0) as file:
        return file.read()


def _bodies(raw: bytes, first: int, label: str) -> dict[int, bytes]:
    """What a file of records holds of each case; ValueError if it does not say that any more."""
    head, _, rest = raw.partition(b"\n")
    line, _, checksum = head.decode().rpartition(" ")
    if checksum != _crc_of_line(line, first, label):
        raise ValueError("a file of records does not match its checksum")
    cases, sizes = json.loads(line)
    ends = np.cumsum(sizes).tolist()
    return {
        case: rest[end - size : end] for case, size, end in zip(cases, sizes, ends, strict=True)
    }


def _crc_of_line(line: str, first: int, label: str) -> str:
    return f"{zlib.crc32(line.encode(), mark(label, first)):08x}"


def block_path(folder: Path, number: int) -> Path:
    """File of one block."""
    return folder / f"block_{number:06d}.rec"


def keeping_block(folder: Path, number: int, encoded: bytes, label: str) -> Callable[[], None]:
    """`keeping` one block (`hdf5_file.encoded_block`) of the build with this label."""
    return keeping({str(block_path(folder, number)): sealed(encoded, mark(label, number))})


def load_block(folder: Path, number: int, label: str) -> memoryview | None:
    """A block of the build with this label; None if it is absent, damaged or another's."""
    try:
        return unsealed(block_path(folder, number).read_bytes(), mark(label, number))
    except _NOTHING_WHOLE:
        return None


def discard_records(folder: Path) -> None:
    """Empty the folder of records; what they belong to goes last, so no record is ever orphaned."""
    for again in folder.glob("again_*"):
        shutil.rmtree(again)
    results = (f"{folder}{os.sep}{name}" for name in entry_names(folder) if _RESULT.fullmatch(name))
    taking = Lock()

    def delete_some() -> None:
        while True:
            with taking:
                some = list(islice(results, AT_ONCE))
            if not some:
                return
            delete(some)

    with ThreadPoolExecutor(DELETERS) as pool:
        for done in [pool.submit(delete_some) for _ in range(DELETERS)]:
            done.result()
    delete(map(str, fingerprints(folder)))
