"""One case again, with everything a person wants to see: each attempt and its convergence log.

The case is solved as the build solves it, from the same neighbours along the same paths, from a finished
file or from the records of a build under way. Nothing is written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ampi.dataset import DatasetError, partial_folder, read_dataset
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.propagation.reintegration import flown_again
from ampi.scp.problem.shortfall import outcome_sentence
from ampi.scp.solve import solve
from ampi.trajectory import Trajectory
from ampi.workers.fingerprint import label_of, read_fingerprint
from database.factory.attempts import Attempt, attempts, follow, is_vain, no_trajectory, path_to
from database.factory.second_pass import nearby
from database.plan.continuation import planned
from database.plan.grid import Grid
from database.plan.prediction import predicted
from database.records.campaign import Campaign, Solver, require_solver, settings_of
from database.records.record_files import FINGERPRINTS, fingerprints, load_records, recorded_cases

PATIENCE = 86400.0  # s for one solve: a person is watching, and can stop it


@dataclass(frozen=True, eq=False)
class AttemptResult:
    """How one attempt went."""

    attempt: str
    outcome: str
    solves: int
    trajectory: Trajectory | None  # of its last solve; None if it raised

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        log = () if self.trajectory is None else self.trajectory.statistics.log
        return {
            "attempt": self.attempt,
            "outcome": self.outcome,
            "solves": self.solves,
            "log": [asdict(row) for row in log],
        }


@dataclass(frozen=True, eq=False)
class Rerun:
    """A case solved again."""

    case: int
    where: str  # grid index, for people
    mission: Mission  # of this case
    stored: str  # what the file or the folder says of it
    attempts: tuple[AttemptResult, ...]
    trajectory: Trajectory

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "case": self.case,
            "where": self.where,
            "stored": self.stored,
            **self.trajectory.summary(),
            "attempts": [a.as_dict() for a in self.attempts],
        }


def rerun(
    path: str | Path,
    case: int,
    *,
    solver: Solver = solve,
    watch: Callable[[AttemptResult], None] | None = None,
) -> Rerun:
    """Solve case number `case` (C order) of a file, or of the records of a build, again.

    `solver` is the optimiser of the build; `watch` is called after each attempt.

    Raises
    ------
    DatasetError
        If neither file nor records are there, or the file is damaged.
    ValueError
        If the grid has no such case, or another optimiser built it.
    """
    toml, made_by, stored = _open(Path(path))
    require_solver(made_by["solver"], solver)
    settings = settings_of(made_by["settings"])
    campaign = Campaign(toml, Path(path), solver, settings, time_limit=PATIENCE)
    mission, grid = campaign.mission, campaign.grid
    if not 0 <= case < grid.size:
        raise ValueError(f"case: expected a number from 0 to {grid.size - 1}, got {case}")
    starts = _solved_neighbours(grid, case, stored)
    continued = predicted(grid, case, lambda corner: _solved(stored, corner))
    results: list[AttemptResult] = []
    ways = attempts(list(starts), predicted=continued is not None)
    for attempt in [*ways, *_from_nearby(grid, case, stored, starts)]:
        ended = [r.trajectory.status if r.trajectory is not None else None for r in results]
        if attempt in ways and is_vain(attempt, ways, ended):
            continue
        start = continued if attempt.predicted else None
        if attempt.neighbour is not None:
            start = starts[attempt.neighbour]
        result, arrived = _made(campaign, case, attempt, start)
        results.append(result)
        if watch is not None:
            watch(result)
        if arrived:
            break
    last = results[-1].trajectory
    known = stored(case)
    return Rerun(
        case=case,
        where=grid.describe(case),
        mission=path_to(mission, grid, case, attempts([], predicted=False)[0])[-1],
        stored="nothing yet" if known is None else known[1],
        attempts=tuple(results),
        trajectory=no_trajectory(mission) if last is None else last,
    )


def _made(
    campaign: Campaign, case: int, attempt: Attempt, start: Trajectory | None
) -> tuple[AttemptResult, bool]:
    """How an attempt goes, and whether it arrives at a solution."""
    try:
        path = path_to(campaign.mission, campaign.grid, case, attempt)
        flown, solves = follow(campaign, path, start)
        arrived = flown.status.ok
        if arrived and campaign.judged:  # as it is assembled: what it finds sends nobody back
            flown = flown_again(path[-1], flown)
        said = outcome_sentence(path[solves - 1], flown)
        return AttemptResult(str(attempt), said, solves, flown), arrived
    except Exception as error:  # as in the build: an attempt that raises is one that failed
        return AttemptResult(str(attempt), f"{type(error).__name__}: {error}", 0, None), False


Stored = Callable[[int], tuple[Trajectory, str] | None]


def _open(path: Path) -> tuple[str, Mapping[str, str], Stored]:
    """Mission text, what made the cases, and of each what is known: trajectory and message."""
    folder = path if path.is_dir() else partial_folder(path)
    if path.is_file() or not folder.is_dir():
        dataset = read_dataset(path)  # an absent file is its error

        def from_file(case: int) -> tuple[Trajectory, str]:
            return dataset.trajectory(case), dataset.message.ravel()[case].decode()

        return dataset.mission.toml, dataset.attributes, from_file
    try:
        toml = (folder / "mission.toml").read_text(encoding="utf-8")
    except OSError:
        raise DatasetError(
            f"{folder}: expected the records of a build, got a folder without mission.toml"
        ) from None
    fingerprint = read_fingerprint(fingerprints(folder))
    if fingerprint is None:
        raise DatasetError(f"{folder}: neither {' nor '.join(FINGERPRINTS)} can be read")
    mission, label = parse_mission(toml), label_of(fingerprint)
    files, _ = recorded_cases(folder, Grid.from_mission(mission).size, label)

    def from_records(case: int) -> tuple[Trajectory, str] | None:
        found = load_records(folder, int(files[case]), (case,), mission, label)
        return (found[case].trajectory, found[case].message) if found else None

    return toml, fingerprint, from_records


def _solved_neighbours(grid: Grid, case: int, stored: Stored) -> dict[int, Trajectory]:
    (here,) = planned(grid, np.array([case]))
    found = {neighbour: _solved(stored, neighbour) for neighbour in here.neighbours}
    return {neighbour: start for neighbour, start in found.items() if start is not None}


def _from_nearby(
    grid: Grid, case: int, stored: Stored, starts: dict[int, Trajectory]
) -> Iterator[Attempt]:
    """As in the second pass, from whatever is solved beside the case and not tried yet."""
    for near, _ in nearby(grid, case):
        start = None if near in starts else _solved(stored, near)
        if start is not None:
            starts[near] = start
            yield Attempt(near)


def _solved(stored: Stored, case: int) -> Trajectory | None:
    known = stored(case)
    return known[0] if known is not None and known[0].status.ok else None
