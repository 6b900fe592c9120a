"""A case that stands out of its family is solved again from each of its neighbours.

Of what the neighbours lead to and what stands there, the case's smoothest optimum is kept: the one of
least roughness (database/coherence.py, Eq. (3)). All else of the file stays, to the bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import partial_folder, read_dataset
from ampi.scp.solve import solve
from ampi.trajectory import Trajectory
from database.build import KnownCase, build
from database.campaign import BuildError, Solver, as_built
from database.coherence import Outlier, case_roughness, coherence, family_rows
from database.grid import Grid

Array = NDArray[np.float64]

MATERIALLY = 0.9  # of the roughness there: what is less than a tenth smoother is the same optimum


@dataclass(frozen=True)
class Repair:
    """What became of one outlier."""

    outlier: Outlier
    roughness: float  # of what is kept
    replaced: bool
    message: str


def repair(path: str | Path, *, solver: Solver = solve, n_jobs: int = 2) -> tuple[Repair, ...]:
    """Re-solve the outliers of a database and replace the file if any became smoother.

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
    found = coherence(dataset)
    rows, grid = family_rows(dataset), Grid.from_mission(dataset.mission)
    suspects = {outlier.case for outlier in found.outliers}
    known = {
        int(case): KnownCase.of(dataset, int(case))
        for case in np.flatnonzero(dataset.solved.ravel())
    }
    done = []
    for outlier in found.outliers:
        best, roughness, message = None, outlier.roughness, "no neighbour leads to a smoother one"
        for neighbour in grid.beside(outlier.case):
            if neighbour in suspects or neighbour not in known:
                continue
            mission = dataset.mission.with_parameters(grid.point(outlier.case))
            candidate = solver(mission, guess=known[neighbour].trajectory)
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
            known[outlier.case] = KnownCase(best, message)
        done.append(Repair(outlier, roughness, best is not None, message))
    if any(one.replaced for one in done):
        mended = path.with_name(f".{path.name}.repaired")
        build(dataset.mission, mended, n_jobs=n_jobs, resume=False, known=known, **settings)
        mended.replace(path)
    return tuple(done)


def _rows(trajectory: Trajectory) -> Array:
    final_time = np.full((1, trajectory.states.shape[1]), trajectory.final_time)
    return np.concatenate([trajectory.states, final_time])
