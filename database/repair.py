"""Cases that stand out of their family are solved again from their neighbours.

First what is rough (`coherence`): of what the neighbours lead to and what stands there, the
case's smoothest optimum is kept, the one of least roughness, Eq. (3). Then what lies on another branch
(`branches`): each branch is followed outwards, neighbour by neighbour, as far as it exists,
and all cases are taken from one that exists for all of them. That is the branch of the nominal case if
it does: the mission's guess has chosen it. Else it is the one of the least total cost; and if no branch
exists for all cases, the one that exists for most. All else of the file stays, to the bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset, partial_folder, read_dataset
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.solve import solve
from ampi.trajectory import Trajectory
from database.audit.branches import Branches, branches, continued, same_optimum
from database.audit.coherence import Outlier, case_roughness, coherence, family_rows
from database.build import build
from database.building import KnownOptimum
from database.plan.grid import Grid
from database.records.campaign import BuildError, Campaign, Solver, as_built

Array = NDArray[np.float64]

MATERIALLY = 0.9  # of the roughness there: what is less than a tenth smoother is the same optimum


@dataclass(frozen=True)
class Repair:
    """What became of one outlier."""

    outlier: Outlier
    roughness: float  # of what is kept
    replaced: bool
    message: str

    def __str__(self) -> str:
        return (
            f"case {self.outlier.case}: {self.message} Roughness {self.outlier.roughness:.2g} → "
            f"{self.roughness:.2g}"
        )


@dataclass(frozen=True)
class Move:
    """What became of one case that was astray, or stood in the way of a branch that exists for all."""

    case: int
    bank_at_entry: tuple[float, float]  # rad, before and after
    cost: tuple[float, float]  # before and after
    replaced: bool
    message: str

    def __str__(self) -> str:
        bank, cost = np.degrees(self.bank_at_entry), self.cost
        return (
            f"case {self.case}: {self.message} Bank at entry {bank[0]:.1f} → {bank[1]:.1f} deg, "
            f"cost {cost[0]:.3g} → {cost[1]:.3g}"
        )


def repair(
    path: str | Path, *, solver: Solver = solve, n_jobs: int = 2
) -> tuple[Repair | Move, ...]:
    """Re-solve what stands out of a database, and replace the file if anything changed.

    `solver` is the optimiser that built it. Until the new file is whole the old one stays; what is
    killed halfway begins anew.

    Raises
    ------
    BuildError
        If an unfinished build of the same file stands in the way.
    """
    if partial_folder(path).is_dir():
        raise BuildError(
            f"{path}: expected no unfinished build beside the file, got {partial_folder(path)}; "
            "finish it with ampi build, or delete the folder"
        )
    path = Path(path).resolve()
    dataset = read_dataset(path)
    settings = as_built(dataset, solver)
    known = {
        int(case): KnownOptimum.of(dataset, int(case))
        for case in np.flatnonzero(dataset.solved.ravel())
    }
    campaign = Campaign(
        dataset.mission.toml, path, solver, settings["settings"] or SolverSettings()
    )
    done: list[Repair | Move] = [*_smoothed(dataset, campaign, known), *_gathered(campaign, known)]
    if any(one.replaced for one in done):
        mended = path.with_name(f".{path.name}.repaired")
        build(dataset.mission, mended, n_jobs=n_jobs, resume=False, known=known, **settings)
        mended.replace(path)
    return tuple(done)


def _smoothed(
    dataset: TrajectoryDataset, campaign: Campaign, known: dict[int, KnownOptimum]
) -> Iterator[Repair]:
    """Replace in `known` each outlier for which a neighbour leads to a smoother optimum."""
    found = coherence(dataset)
    rows, grid = family_rows(dataset), Grid.from_mission(dataset.mission)
    suspects = {outlier.case for outlier in found.outliers}
    for outlier in found.outliers:
        best, roughness, message = None, outlier.roughness, "no neighbour leads to a smoother one."
        for neighbour in grid.beside(outlier.case):
            if neighbour in suspects or neighbour not in known:
                continue
            mission = dataset.mission.with_parameters(grid.point(outlier.case))
            candidate = campaign.solve(mission, known[neighbour].trajectory)
            if not candidate.status.ok:
                continue
            rows[outlier.index] = _rows(candidate)
            there = case_roughness(dataset.axes, rows, outlier.index, found)
            if there < MATERIALLY * roughness:
                best, roughness = candidate, there
                message = f"re-solved from case {neighbour}: {candidate.status.sentence}"
        suspects.discard(outlier.case)
        rows[outlier.index] = _rows(best or known[outlier.case].trajectory)
        if best is not None:
            known[outlier.case] = KnownOptimum(best, message)
        yield Repair(outlier, roughness, best is not None, message)


def _gathered(campaign: Campaign, known: dict[int, KnownOptimum]) -> Iterator[Move]:
    """Bring all cases in `known` onto one branch, if that leaves fewer astray."""
    optima = {case: kept.trajectory for case, kept in known.items()}
    before = branches(campaign.mission, optima, campaign.solver, campaign.settings)
    if not before.astray:
        return
    reached, origin = _common_branch(campaign, optima, before)
    after = branches(campaign.mission, {**optima, **reached}, campaign.solver, campaign.settings)
    improved = len(after.cases) < len(before.cases)
    moved = [case for case in reached if improved and reached[case] is not optima[case]]
    for case in sorted({*moved, *after.cases} if improved else before.cases):
        now = reached[case] if case in moved else optima[case]
        message = "no branch leads here that would leave fewer cases astray."
        if case in moved:
            message = f"re-solved from case {origin[case]}: {now.status.sentence}"
            known[case] = KnownOptimum(now, message)
        entry = float(optima[case].states[6, 0]), float(now.states[6, 0])
        yield Move(case, entry, (optima[case].cost, now.cost), case in moved, message)


def _common_branch(
    campaign: Campaign, optima: Mapping[int, Trajectory], found: Branches
) -> tuple[dict[int, Trajectory], dict[int, int]]:
    """The optima of one branch, as far as it exists, and from which case each was followed."""
    nominal = int(np.ravel_multi_index(campaign.grid.centre, campaign.grid.shape))
    main = tuple(sorted(set(optima) - set(found.cases)))
    seeds = sorted([main, *(b.cases for b in found.astray)], key=lambda s: nominal not in s)
    best: tuple[dict[int, Trajectory], dict[int, int]] = ({}, {})
    standing = (1, np.inf)
    for seed in seeds:
        reached, origin = _followed(campaign, optima, seed)
        rank = (-len(reached), sum(optimum.cost for optimum in reached.values()))
        if rank < standing:
            best, standing = (reached, origin), rank
        if nominal in seed and len(reached) == len(optima):
            break
    return best


def _followed(
    campaign: Campaign, optima: Mapping[int, Trajectory], seed: tuple[int, ...]
) -> tuple[dict[int, Trajectory], dict[int, int]]:
    """The branch of the `seed` cases, followed outwards; what stands on it already is kept."""
    reached, origin = {case: optima[case] for case in seed}, dict[int, int]()
    edge = deque(seed)
    while edge:
        case = edge.popleft()
        for goal in campaign.grid.beside(case):
            if goal in reached or goal not in optima:
                continue
            arrived = continued(campaign, case, goal, reached[case])
            if arrived is None:
                continue
            stands = same_optimum(arrived, optima[goal])
            reached[goal] = optima[goal] if stands else arrived
            origin[goal] = case
            edge.append(goal)
    return reached, origin


def _rows(trajectory: Trajectory) -> Array:
    final_time = np.full((1, trajectory.states.shape[1]), trajectory.final_time)
    return np.concatenate([trajectory.states, final_time])
