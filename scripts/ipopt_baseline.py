"""The same database by CasADi and IPOPT: what the convex method is measured against.

The full transcription (states, rates, final time) as one nonlinear program, expanded to SX, with exact
Hessians, MUMPS with pivot_order=0, and a primal-dual warm start from the neighbour that is one grid step
nearer to the centre: the same nodes, the same grid, the same order, the same processes. Both barrier
strategies are tried on a sample and the faster one builds the grid.
"""

from __future__ import annotations

import cProfile
import pstats
import tempfile
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from joblib import Parallel, delayed
from joblib.externals.loky import get_reusable_executor
from numpy.typing import NDArray

import ampi
import database
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.pseudospectral.lagrange import barycentric_weights, interpolation_matrix
from ampi.trajectory import Trajectory
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

SCALE = np.array([1e4, 1.0, 1.0, 1e3, 1.0, 1.0, 1.0])
SECONDS = 100.0
BARRIERS: dict[str, dict[str, Any]] = {
    "monotone": {"mu_strategy": "monotone", "mu_init": 1e-5},
    "adaptive": {"mu_strategy": "adaptive"},
}
WARM: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-6,
    "max_iter": 300,
    "linear_solver": "mumps",
    "mumps_pivot_order": 0,
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-9,
    "warm_start_mult_bound_push": 1e-9,
    "warm_start_slack_bound_push": 1e-9,
}


@dataclass(frozen=True)
class Point:
    """A primal-dual point of the program."""

    x: Array
    on_x: Array
    on_g: Array
    cost: float
    iterations: int
    seconds: float
    ok: bool


class Program:
    """One nonlinear program for every entry state of a mission."""

    def __init__(self, mission: Mission, barrier: str) -> None:
        mesh, limits, objective = mission.pseudospectral_mesh, mission.limits, mission.objective
        self.mission, self.n = mission, mesh.n_nodes
        f, g = _physics(mission)
        n = self.n
        x, u = ca.MX.sym("x", 7, n), ca.MX.sym("u", 1, n - 1)
        period = ca.MX.sym("t_f")
        final_time = SECONDS * period
        fixed, free = mesh.node_time
        times = ca.DM(fixed).T + ca.DM(free).T * final_time
        rates = f.map(n - 1)(x[:, 1:], u, times[1:])
        collocation, effort = [], 0.0
        for s in mesh.segments:
            half = s.half_length[0] + s.half_length[1] * final_time
            points = slice(s.collocation.start, s.collocation.stop)
            nodal = x[:, s.nodes.start : s.nodes.stop]
            collocation.append(ca.vec(nodal @ ca.DM(s.rule.derivative).T - half * rates[:, points]))
            effort += half * ca.sum2(ca.DM(s.rule.weights).T * u[0, points] ** 2)
        inner = mesh.segments[0].rule.nodes[1:]
        entry_rate = interpolation_matrix(inner, barycentric_weights(inner), [-1.0])
        first_rate = u[0, : len(inner)] @ ca.DM(entry_rate).T
        path = ca.vec(g.map(n)(x, times))
        target = mission.target
        reference = ca.DM([target.altitude, target.longitude, target.latitude, target.speed])
        weights = ca.DM(
            [
                objective.altitude_weight or 0.0,
                objective.longitude_weight or 0.0,
                objective.latitude_weight or 0.0,
                objective.speed_weight or 0.0,
            ]
        )
        error = x[:4, n - 1] * SCALE[:4] - reference
        cost = ca.dot(weights, error**2) / objective.bank_rate_effort
        cost += np.degrees(limits.bank_rate) ** 2 * effort
        self.solver = ca.nlpsol(
            "program",
            "ipopt",
            {
                "x": ca.vertcat(ca.vec(x), u.T, period),
                "f": cost,
                "g": ca.vertcat(*collocation, first_rate, path),
            },
            {"print_time": False, "expand": True, "ipopt": {**WARM, **BARRIERS[barrier]}},
        )
        self.low, self.high = np.full((n, 7), -np.inf), np.full((n, 7), np.inf)
        self.low[:, 6], self.high[:, 6] = -limits.bank_angle, limits.bank_angle
        equations = np.zeros(7 * (n - 1))
        self.g_low = np.concatenate([equations, [-1.0], np.full(3 * n, -np.inf)])
        self.g_high = np.concatenate([equations, [1.0], np.ones(3 * n)])

    def solve(self, entry_state: Array, start: Point) -> Point:
        """From a neighbour's primal-dual point."""
        n = self.n
        low, high = self.low.copy(), self.high.copy()
        low[0, :6] = high[0, :6] = entry_state / SCALE[:6]
        began = time.perf_counter()
        found = self.solver(
            x0=start.x,
            lam_x0=start.on_x,
            lam_g0=start.on_g,
            lbx=np.concatenate([low.ravel(), np.full(n - 1, -1.0), [0.0]]),
            ubx=np.concatenate([high.ravel(), np.full(n - 1, 1.0), [np.inf]]),
            lbg=self.g_low,
            ubg=self.g_high,
        )
        seconds, stats = time.perf_counter() - began, self.solver.stats()
        return Point(
            x=np.array(found["x"]).ravel(),
            on_x=np.array(found["lam_x"]).ravel(),
            on_g=np.array(found["lam_g"]).ravel(),
            cost=float(found["f"]) * self.mission.objective.bank_rate_effort,
            iterations=int(stats["iter_count"]),
            seconds=seconds,
            ok=bool(stats["success"]),
        )

    def from_trajectory(self, optimum: Trajectory) -> Point:
        """A primal start without multipliers."""
        x = np.concatenate(
            [
                (optimum.states.T / SCALE).ravel(),
                optimum.bank_rate[1:] / self.mission.limits.bank_rate,
                [optimum.final_time / SECONDS],
            ]
        )
        return Point(x, np.zeros(len(x)), np.zeros(len(self.g_low)), np.nan, 0, 0.0, True)


def _physics(mission: Mission) -> tuple[ca.Function, ca.Function]:
    limits, model = mission.limits, mission.flight_model
    x, u, t = ca.SX.sym("x", 7), ca.SX.sym("u"), ca.SX.sym("t")
    mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)
    f = ca.vertcat(*equations_of_motion(model, x * SCALE, u * limits.bank_rate, t)) / SCALE
    g = ca.vertcat(*path_constraints(model, x * SCALE, t))
    ca.GlobalOptions.setNumpyMode(mode)
    over = ca.DM([limits.dynamic_pressure, limits.heat_flux, limits.load_factor])
    return ca.Function("f", [x, u, t], [f]), ca.Function("g", [x, t], [g / over])


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
        mission.entry_state, centre.from_trajectory(ampi.solve(mission))
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
