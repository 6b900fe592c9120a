"""What is kept of campaigns under way: a file per batch of flights in `FLIGHTS.h5.partial`.

    campaign.json         what the records belong to: the caller's identity, and the software
    campaign.copy.json    the same: a fault of the disk in one of them must not cost the records
    ampi.000012.rec       a batch of the campaign `ampi`: a line that names its arrays, and their bytes
    lock                  held by the process that flies

The worker that has flown a batch keeps it, under another name first, and says no more than where: a
driver that dies loses nothing, and the next one flies what is missing. A batch is a function of the
identity alone, so writing one twice does no harm. Each is sealed with the identity, its campaign and its
number: what is damaged, or was flown for another campaign, is flown again.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from collections.abc import Generator, Iterable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import partial_folder
from ampi.hdf5.seal import opened
from ampi.simulation.flights_file import require_name
from ampi.simulation.flights_schema import SEAL
from ampi.simulation.flights_writer import Arrays, Content, write_flights
from ampi.workers.fingerprint import differences, label_of, read_fingerprint, write_fingerprint
from ampi.workers.in_order import in_workers
from ampi.workers.job import Job, JobError
from ampi.workers.keeping import delete, keeper, keeping, no_parts, require_seen
from ampi.workers.lock import exclusive
from ampi.workers.seal import mark, sealed, unsealed
from ampi.workers.software import software
from ampi.workers.stopped import Wording, told

COPIES = ("campaign.json", "campaign.copy.json")
ALIGNED = 64  # bytes: the arrays of a record begin at a multiple of it
IDENTITY = "identity"  # root attribute of the file


class CampaignError(ValueError):
    """A campaign that cannot start or go on; the message says what is in its way."""


@dataclass(frozen=True)
class BatchRecords:
    """The records of one campaign; this travels to the workers with their jobs."""

    folder: Path
    campaign: str
    label: str  # of the identity that they are sealed with

    def path(self, number: int) -> Path:
        """The file of a batch."""
        return self.folder / f"{self.campaign}.{number:06d}.rec"

    def keep(self, number: int, arrays: Arrays) -> Future[Path]:
        """Write a batch; the result of a job that has flown it, once it is flushed to disk."""
        path = self.path(number)
        keep = keeping({str(path): self._packed(number, arrays)})

        def whole() -> Path:
            keep()
            return path

        return keeper().submit(whole)

    def read(self, number: int) -> dict[str, NDArray[Any]]:
        """The arrays of a batch.

        Raises
        ------
        FileNotFoundError, ValueError
            If there is none, or it is damaged or of another campaign.
        OSError
            If it cannot be read: it may be whole.
        """
        body = unsealed(self.path(number).read_bytes(), self._mark(number))
        place = int(bytes(body[:ALIGNED]).partition(b" ")[0])
        _, _, text = bytes(body[:place]).partition(b" ")
        arrays = dict[str, NDArray[Any]]()
        for name, (dtype, shape) in json.loads(text).items():
            array = np.frombuffer(body, dtype, math.prod(shape), place).reshape(shape)
            arrays[name], place = array, place + array.nbytes
        return arrays

    def missing(self, count: int) -> list[int]:
        """Which of the first `count` batches are still to be flown; what is not whole is deleted."""
        found = []
        for number in range(count):
            try:
                self.read(number)
            except (FileNotFoundError, ValueError):
                self.path(number).unlink(missing_ok=True)
                found.append(number)
        return found

    def _packed(self, number: int, arrays: Arrays) -> bytes:
        """Where the arrays begin; their names, types and shapes as JSON; and their bytes."""
        whole = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
        text = json.dumps({name: (v.dtype.str, v.shape) for name, v in whole.items()})
        place = ALIGNED * (len(text) // ALIGNED + 2)
        head = f"{place} {text}".ljust(place).encode()
        return sealed(b"".join([head, *(v.tobytes() for v in whole.values())]), self._mark(number))

    def _mark(self, number: int) -> int:
        return mark(f"{self.label} {self.campaign}", number)


@dataclass(frozen=True)
class Recorded:
    """The first `count` batches of a campaign, read from their records one at a time."""

    records: BatchRecords
    count: int

    def shapes(self) -> Iterator[Mapping[str, tuple[int, ...]]]:
        """Of the arrays of each batch."""
        for batch in self:
            yield {name: values.shape for name, values in batch.items()}

    def __iter__(self) -> Iterator[Arrays]:
        for number in range(self.count):
            try:
                yield self.records.read(number)
            except (FileNotFoundError, ValueError):
                raise JobError(
                    f"{self.records.path(number)} has disappeared or changed during the campaign"
                ) from None


@dataclass(frozen=True, eq=False)
class Heading:
    """What a campaign has besides its flights."""

    batches: int
    attributes: Mapping[str, Any]  # numbers and words (flights_schema.ATTRIBUTES)
    fixed: Arrays  # arrays that belong to no flight (flights_schema.FIELDS)


@dataclass(frozen=True)
class CampaignRecords:
    """The campaigns that are being flown for one file, held by one process."""

    path: Path
    identity: Mapping[str, str]

    @classmethod
    @contextmanager
    def open(
        cls, path: str | Path, identity: Mapping[str, str], *, resume: bool = True
    ) -> Iterator[CampaignRecords]:
        """Hold the records of a file of flights until the end of the block.

        Parameters
        ----------
        path
            The file to be; its records lie in `PATH.partial`.
        identity
            All that the numbers of the batches depend on, each by a name and its value or digest; the
            software is added. The campaigns of one file share it, so what tells these apart must
            follow from their names.
        resume
            Go on from what is kept; False starts afresh.

        Raises
        ------
        CampaignError
            If another process flies for this file, or the records are of another campaign; and in place
            of what a disk or a worker raises in the block: what is flown stays.
        """
        path = Path(path).absolute()
        if not path.parent.is_dir():
            raise CampaignError(f"{path}: the folder {path.parent} does not exist")
        if path.is_dir():
            raise CampaignError(f"{path}: expected a file to write, got a folder")
        folder = partial_folder(path)
        with told(folder, path, _WORDS), exclusive(folder), no_parts(folder):
            records = cls(path, {**identity, **software()})
            records._claim(resume=resume)
            yield records

    def of(self, campaign: str) -> BatchRecords:
        """The records of one of the campaigns."""
        require_name(campaign)
        return BatchRecords(partial_folder(self.path), campaign, label_of(self.identity))

    def fly(
        self, module: str, jobs: Iterable[Job[Path]], n_jobs: int, client: Any = None
    ) -> Generator[Path, None, None]:
        """Run jobs that keep a batch each, in worker processes or on a cluster (`in_workers`).

        Gives the file of each batch in the order of the jobs.

        Raises
        ------
        JobError
            If a job has no result, or a worker has kept it in a folder that is not this one.
        """
        with closing(in_workers(module, jobs, n_jobs, client)) as results:
            for kept in results:
                require_seen(kept.stem, kept)
                yield kept

    def merge(self, campaigns: Mapping[str, Heading]) -> None:
        """All batches into the file, campaign by campaign in their order; then the records go."""
        contents = {
            name: Content(one.attributes, one.fixed, Recorded(self.of(name), one.batches))
            for name, one in campaigns.items()
        }
        target = self.path.resolve()  # a link stays one, and the file is written where it leads
        temporary = target.with_name(target.name + ".tmp")
        try:
            write_flights(temporary, contents, {IDENTITY: _words(self.identity)})
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
        folder = partial_folder(self.path)
        _discard(folder)
        shutil.rmtree(folder, ignore_errors=True)  # the file is whole; `exclusive` sees to the rest

    def _claim(self, *, resume: bool) -> None:
        """Mark the folder as of this identity; refuse another's, or empty it."""
        folder = partial_folder(self.path)
        copies = [folder / name for name in COPIES]
        found = read_fingerprint(copies) if resume else None
        count = len(_records_in(folder))
        if resume and found is None and count:
            raise CampaignError(
                f"{folder}: neither {' nor '.join(COPIES)} can be read, so nobody knows what its "
                f"{count} finished batches belong to; put one of the two back, choose another path, or "
                "start afresh (resume=False, --force)"
            )
        if found is not None:
            different = _differing(found, self.identity)
            if different:
                raise CampaignError(
                    f"{folder} holds results of another campaign (different {', '.join(different)}); "
                    "finish that one as it was begun, choose another path, or start afresh "
                    "(resume=False, --force)"
                )
        else:
            _discard(folder)
        write_fingerprint(copies, self.identity)


def is_flown(path: str | Path, identity: Mapping[str, str]) -> bool:
    """Whether `path` is a whole file of flights, merged under this identity by this software.

    Raises
    ------
    CampaignError
        If it holds other flights: they would be lost.
    """
    path = Path(path)
    if not path.is_file() or partial_folder(path).is_dir() or not SEAL.holds(path):
        return False
    with opened(path) as file:
        found = json.loads(file.attrs.get(IDENTITY, "{}"))
    different = _differing(found, {**identity, **software()})
    if different:
        raise CampaignError(
            f"{path} holds results of another campaign (different {', '.join(different)}); nothing was "
            "overwritten: choose another path, or start afresh (resume=False, --force)"
        )
    return True


def _differing(found: Mapping[str, str], identity: Mapping[str, str]) -> list[str]:
    gone = sorted(found.keys() - identity.keys())
    return differences(found, {**identity, **dict.fromkeys(gone, "none")})


def _words(identity: Mapping[str, str]) -> str:
    return json.dumps(identity, sort_keys=True)


def _records_in(folder: Path) -> list[str]:
    with os.scandir(folder) as entries:
        return [entry.path for entry in entries if _RECORD.fullmatch(entry.name)]


def _discard(folder: Path) -> None:
    """What the records belong to goes last, so none is ever orphaned."""
    delete(_records_in(folder))
    delete(str(folder / name) for name in COPIES)


def _kept(folder: Path) -> str:
    count = len(_records_in(folder))
    return f"{count} finished batches" if count else ""


_RECORD = re.compile(r".*\.\d{6,}\.rec")
_WORDS = Wording(CampaignError, "flown", "fly the same campaign again", "two campaigns", _kept)
