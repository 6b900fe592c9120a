"""The same database by CasADi and IPOPT: what the convex method is measured against.

The full transcription as one nonlinear program (ipopt_program), with a primal-dual warm start from the
neighbour that is one grid step nearer to the centre: the same nodes, the same grid, the same order, the
same processes. Both barrier strategies are tried on a sample and the faster one builds the grid.
"""

from __future__ import annotations

import cProfile
import pstats
import tempfile
import time
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from ipopt_program import Point, Program
from joblib import Parallel, delayed
from joblib.externals.loky import get_reusable_executor
from numpy.typing import NDArray

import ampi
import database
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.workers.engines import LocalEngine
from database.factory.jobs import MODULE, AssembleBlock, SolvePortion
from database.factory.schedule import run_jobs
from database.factory.tasks import planned_tasks
from database.plan.continuation import layers
from database.plan.grid import Grid
from database.records.campaign import Campaign
from database.records.reader import RecordReader
from database.records.record_files import nowhere

Array = NDArray[np.float64]

BARRIERS = ("monotone", "adaptive")


@lru_cache(maxsize=2)
def _program(toml: str, barrier: str) -> Program:
    return Program(parse_mission(toml), barrier)


def _solve(toml: str, barrier: str, entry_state: Array, start: Point) -> Point:
    return _program(toml, barrier).solve(entry_state, start)


def compare(mission: Mission, n_jobs: int) -> dict[str, Any]:
    """Ours and theirs, one after the other, in this run; medians of three."""
    whole, theirs, mine = (
        _median([run(mission, n_jobs) for _ in range(3)]) for run in (whole_build, build, ours)
    )
    a, b = np.array(mine.pop("costs")), np.array(theirs.pop("costs"))
    return {
        "cases": len(a),
        "ours": mine,
        "whole_build": whole,
        "ipopt": theirs,
        "ratio": theirs["seconds"] / mine["seconds"],
        "whole_build_ratio": theirs["seconds"] / whole["seconds"],
        "greatest_cost_difference": float(np.max(np.abs(a / b - 1.0))),
        "phases": phases(mission),
    }


def _median(runs: list[dict[str, Any]]) -> dict[str, Any]:
    return sorted(runs, key=lambda run: float(run["seconds"]))[len(runs) // 2]


def ours(mission: Mission, n_jobs: int) -> dict[str, Any]:
    """Solve the whole grid as the build does, without gains, re-integration and the file."""
    with tempfile.TemporaryDirectory() as folder:
        campaign = Campaign(mission.toml, Path(folder))
        began = time.perf_counter()
        engine = LocalEngine(MODULE, n_jobs)
        files = nowhere(campaign.grid.size)
        tasks = planned_tasks(campaign, files, engine.width)
        solving = (task for task in tasks if not isinstance(task.job, AssembleBlock))
        run_jobs(solving, files, engine, lambda cases: None)
        seconds = time.perf_counter() - began
        engine.close()
        found = RecordReader(campaign, dict(enumerate(files.tolist()))).read(range(len(files)))
    records = [found[case] for case in range(len(files))]
    return {
        "seconds": seconds,
        "solved": sum(r.trajectory.status.ok for r in records),
        "median_iterations": float(
            np.median([r.trajectory.statistics.iterations for r in records])
        ),
        "median_solve_seconds": float(np.median([r.seconds for r in records])),
        "costs": [r.trajectory.cost for r in records],
    }


def whole_build(mission: Mission, n_jobs: int) -> dict[str, Any]:
    """The finished database: with gains, re-integration of every case, checksums, the file."""
    with tempfile.TemporaryDirectory() as folder:
        report = database.build(mission, Path(folder) / "database.h5", n_jobs=n_jobs)
    return {"seconds": report.seconds, "solved": report.solved}


PHASES = {
    "derivatives": ("/tracing/vectorised.py", "/tracing/dynamics.py"),
    "condensing": ("/condensed/condensing.py", "/condensed/curvature.py"),
    "prediction": ("/prediction.py",),
    "records": ("/record_files.py", "/case_record.py", "/reader.py"),
    "Newton step and the rest of the iteration": (
        "/condensed/newton.py",
        "/condensed/newton_system.py",
        "/condensed/points.py",
        "/condensed/cost.py",
        "/condensed/limit_rows.py",
        "/condensed/kkt_factors.py",
        "/condensed/dual_steps.py",
    ),
}


def phases(mission: Mission, portions: int = 12) -> dict[str, float]:
    """Share of each phase in the time of solving portions together, by cProfile, in this process."""
    profile = cProfile.Profile()
    with tempfile.TemporaryDirectory() as folder:
        campaign = Campaign(mission.toml, Path(folder))
        files, measured = nowhere(campaign.grid.size), 0
        for task in planned_tasks(campaign, files, width=4):
            job = task.job.placed({int(case): int(files[case]) for case in task.needs})
            if isinstance(job, SolvePortion) and len(job.cases) > 12:
                measured += 1
                kept = profile.runcall(job.compute, lambda attempt: None).result()
            else:
                kept = job.run(lambda attempt: None)
            for one in job.left(kept):
                kept += one.run(lambda attempt: None)
            for cases in kept:
                files[list(cases)] = cases[0]
            if measured == portions:
                break
    stats = pstats.Stats(profile)
    inside: dict[str, float] = dict.fromkeys(PHASES, 0.0)
    called: dict[str, float] = dict.fromkeys(PHASES, 0.0)
    # cumulative time where another module enters a phase's module, less what that hands to other phases
    for (file, _, _), (*_, callers) in stats.stats.items():  # type: ignore[attr-defined]
        phase = _phase_of(file)
        for (caller, _, _), (_, _, _, spent) in callers.items():
            if phase is not None and caller != file:
                inside[phase] += spent
                if (outer := _phase_of(caller)) is not None:
                    called[outer] += spent
    total = stats.total_tt  # type: ignore[attr-defined]
    shares = {phase: (inside[phase] - called[phase]) / total for phase in PHASES}
    return {**shares, "the rest": 1.0 - sum(shares.values())}


def _phase_of(file: str) -> str | None:
    return next((phase for phase, names in PHASES.items() if file.endswith(names)), None)


def build(mission: Mission, n_jobs: int, sample: int = 12) -> dict[str, Any]:
    """Solve the whole grid by IPOPT, layer by layer; returns times, iterations and costs."""
    grid = Grid.from_mission(mission)
    plan = layers(grid)
    centre = _program(mission.toml, "monotone")
    nominal = centre.solve(
        mission.entry_state, centre.start(ampi.solve(mission))
    )  # with multipliers
    trial = [planned.case for planned in plan[1]][:sample]
    medians = {
        barrier: float(
            np.median(
                [_solve(mission.toml, barrier, grid.point(c), nominal).seconds for c in trial]
            )
        )
        for barrier in BARRIERS
    }
    barrier = min(medians, key=lambda name: medians[name])
    get_reusable_executor().shutdown(wait=True)  # ours starts its processes, too
    began = time.perf_counter()
    points: dict[int, Point] = {plan[0][0].case: nominal}
    with Parallel(n_jobs=n_jobs) as pool:
        for layer in plan[1:]:
            solved = pool(
                delayed(_solve)(mission.toml, barrier, grid.point(p.case), points[p.neighbours[0]])
                for p in layer
            )
            points.update({p.case: s for p, s in zip(layer, solved, strict=True)})
    seconds = nominal.seconds + time.perf_counter() - began  # ours solves the nominal case, too
    return {
        "barrier": barrier,
        "sample_median_seconds": medians,
        "seconds": seconds,
        "solved": sum(p.ok for p in points.values()),
        "median_iterations": float(np.median([p.iterations for p in points.values()])),
        "median_solve_seconds": float(np.median([p.seconds for p in points.values()])),
        "costs": [points[c].cost for c in sorted(points)],
    }
