"""What a build will take, before its first job: cases, time, room on the disk, memory.

The figures are those of the machine of docs/results.md (`make benchmark-factory`), per case and
worker, so they are good for a factor of two or so. Cases that fail take longer: each is tried along
many paths.
"""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass
from pathlib import Path

from ampi.missions.mission import Mission
from ampi.physics.state import BANK, N_STATES
from database.records.campaign import Campaign

TOGETHER_SECONDS = (
    3e-3  # of one worker, for a case of `NODES` nodes among others of its flight model
)
SENSITIVITY_SECONDS = 0.7e-3  # for the derivatives of such a case over each parameter
ALONE_SECONDS = 0.25  # for one that is solved by itself
NODES = 64
GAINS = N_STATES
FILE_SHARE = 0.95  # of the numbers, once they are compressed: their last digits are noise
RECORD_HEAD = 400  # bytes: status, message, multipliers
DRIVER_MEMORY = 130e6  # bytes
WORKER_MEMORY = 330e6
CASE_MEMORY = (
    25  # bytes of the driver: where a case is kept, its distance, its bank at the stations
)

MOST_EVER = 10_000_000  # cases: a build keeps a file for each portion, and a record of each
MOST_CASES = 100_000  # without a question
MOST_SECONDS = 3600.0


@dataclass(frozen=True)
class Estimate:
    """Of one build."""

    cases: int
    workers: int
    seconds: float
    file_bytes: float
    disk_bytes: float  # the file, and what is kept until it is whole
    free_bytes: float  # on the disk of the file
    memory_bytes: float  # of driver and workers

    @property
    def large(self) -> bool:
        """Whether somebody should be asked first."""
        return (
            self.cases > MOST_CASES
            or self.seconds > MOST_SECONDS
            or self.disk_bytes > self.free_bytes
        )

    @property
    def possible(self) -> bool:
        """Whether there can be such a build at all."""
        return self.cases <= MOST_EVER

    def __str__(self) -> str:
        workers = f"{self.workers} worker{'' if self.workers == 1 else 's'}"
        return (
            f"{self.cases:,} cases: about {_duration(self.seconds)} with {workers}, a file of "
            f"{_size(self.file_bytes)}, {_size(self.disk_bytes)} of the disk on the way "
            f"({_size(self.free_bytes)} free), {_size(self.memory_bytes)} of memory"
        )


def estimate(
    mission: Mission, path: str | Path, *, workers: int, sensitivities: bool = False
) -> Estimate:
    """What building the mission's grid to `path` will take; nothing is solved."""
    path = Path(path).absolute()
    mission.checked()
    cases = math.prod(len(p.offsets) for p in mission.parameters)
    nodes = mission.pseudospectral_mesh.n_nodes
    together = Campaign(mission.toml, path).together
    each = TOGETHER_SECONDS * nodes / NODES if together else ALONE_SECONDS
    tables = 1  # of all rows, each case
    if sensitivities:
        tables += len(mission.parameters)
        each += SENSITIVITY_SECONDS * len(mission.parameters) * nodes / NODES
    recorded = (
        2 * mission.n_states - BANK
    )  # rows of doubles at each node: states, and their rates of angles
    file_bytes = FILE_SHARE * 8.0 * (recorded + GAINS) * nodes * cases * tables
    record = RECORD_HEAD + 8.0 * recorded * nodes
    return Estimate(
        cases=cases,
        workers=workers,
        seconds=each * cases / workers,
        file_bytes=file_bytes,
        disk_bytes=2.0 * file_bytes + record * cases,  # blocks, and the file beside them
        free_bytes=float(shutil.disk_usage(_existing(path.parent)).free),
        memory_bytes=DRIVER_MEMORY + CASE_MEMORY * cases + WORKER_MEMORY * workers,
    )


def _existing(folder: Path) -> Path:
    while not folder.exists():
        folder = folder.parent
    return folder


def _duration(seconds: float) -> str:
    for unit, length in (("years", 3.156e7), ("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * length:
            return f"{_figure(seconds / length)} {unit}"
    return f"{max(1.0, math.ceil(seconds)):.0f} s"


def _size(count: float) -> str:
    for unit, size in (("EB", 1e18), ("PB", 1e15), ("TB", 1e12), ("GB", 1e9)):
        if count >= size:
            return f"{_figure(count / size)} {unit}"
    return f"{_figure(count / 1e6)} MB"


def _figure(value: float) -> str:
    """Two figures, and no exponent."""
    return f"{float(f'{value:.2g}'):,.10g}"
