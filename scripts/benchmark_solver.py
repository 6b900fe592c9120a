"""Measure the optimiser: one solve beside a solved neighbour, two controls, and a family's iteration.

python scripts/benchmark_solver.py            print all of it; some minutes
python scripts/benchmark_solver.py --quick    without the grid of 6,561 cases

A share "by the family's iteration" is that of the cases that `solve_family` has solved in company; what
it leaves is tried alone, by the whole method in the end. Times are of the processor, medians, and
compare within a run.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from ipopt_program import Program
from numpy.typing import NDArray

import ampi
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.papers.betts2010 import CASES, betts2010_case
from ampi.propagation.reintegration import flight_checks
from ampi.scp.guess import ConstantBank, constant_bank_guess, default_guess
from ampi.scp.solve import optimum
from ampi.trajectory import Trajectory
from ampi.workers.engines import LocalEngine, Tell
from database.factory.jobs import MODULE, AssembleBlock, Job, Kept, SolveCase
from database.factory.schedule import run_jobs
from database.factory.tasks import planned_tasks
from database.records.campaign import Campaign
from database.records.reader import RecordReader
from database.records.record_files import nowhere

JOBS = 2
TOGETHER = 200  # flown again at once


def milliseconds(work: Callable[[], object], runs: int = 25) -> float:
    """Median processor time of `work`."""
    work()
    found = []
    for _ in range(runs):
        began = time.process_time()
        work()
        found.append(time.process_time() - began)
    return 1e3 * float(np.median(found))


def beside(mission: Mission, name: str) -> NDArray[np.float64]:
    """The grid point next to the nominal one along one axis."""
    place = [parameter.name for parameter in mission.parameters].index(name)
    values = mission.nominal_parameters.copy()
    values[place] = mission.grid_axes[place][-1]
    return values


def one_solve() -> None:
    """Cold from a constant bank angle, and warm from the nominal case to its neighbour on the grid."""
    mission = ampi.load_mission("shefex3")
    nominal = ampi.solve(mission)
    near = mission.with_parameters(beside(mission, "speed"))
    rows: list[tuple[str, Callable[[], Trajectory]]] = [
        ("cold: ampi.solve(mission)", lambda: ampi.solve(mission)),
        ("warm: ampi.solve(neighbour, guess=nominal)", lambda: ampi.solve(near, guess=nominal)),
        ("… without flying it again", lambda: optimum(near, guess=nominal)),
    ]
    for name, work in rows:
        found = work()
        iterations = found.statistics.iterations
        print(f"{name}: {milliseconds(work):.2f} ms, {iterations} iterations, {found.status}")


def two_controls() -> None:
    """The Space Shuttle's two optima, cold, from the mission's guess: ours and IPOPT's."""
    for case in CASES:
        mission = betts2010_case(case)
        begin = default_guess(mission)
        assert isinstance(begin, ConstantBank)
        flown = constant_bank_guess(mission, begin)
        assert flown is not None
        program = Program(mission, "cold")
        began = time.process_time()
        found = optimum(mission)
        seconds = time.process_time() - began
        began = time.process_time()
        other = program.solve(mission.entry_state, program.start(flown))
        others = time.process_time() - began
        print(
            f"shuttle_betts2010, {case}: {found.statistics.iterations} iterations, {seconds:.2f} s; "
            f"IPOPT {other.iterations} iterations, {others:.2f} s; "
            f"costs differ by {abs(found.cost / other.cost - 1.0):.1e}"
        )


@dataclass
class _Counting:
    """The workers of this machine; counts the cases that are tried alone."""

    engine: LocalEngine
    alone: int = 0
    room: int = field(init=False)
    width: int = field(init=False)
    workers: int = field(init=False)

    def __post_init__(self) -> None:
        engine = self.engine
        self.room, self.width, self.workers = engine.room, engine.width, engine.workers

    def submit(self, job: Job, tell: Tell[Kept]) -> None:
        """Run a job when a worker is free."""
        self.alone += isinstance(job, SolveCase)
        self.engine.submit(job, tell)

    def look(self) -> None:
        """As the workers do."""
        self.engine.look()

    def close(self) -> None:
        """End the workers."""
        self.engine.close()


def family(name: str) -> dict[str, Any]:
    """Solve the grid of a mission as a build does, and fly every optimum again."""
    mission = ampi.load_mission(name)
    with tempfile.TemporaryDirectory() as folder:
        campaign = Campaign(mission.toml, Path(folder))
        engine = _Counting(LocalEngine(MODULE, JOBS))
        files = nowhere(campaign.grid.size)
        tasks = planned_tasks(campaign, files, engine.width)
        solving = (task for task in tasks if not isinstance(task.job, AssembleBlock))
        began = time.perf_counter()
        run_jobs(solving, files, engine, lambda cases: None)
        seconds = time.perf_counter() - began
        engine.close()
        records = RecordReader(campaign, dict(enumerate(files.tolist()))).read(range(len(files)))
        solved = [case for case, record in records.items() if record.trajectory.status.ok]
        optima = [records[case].trajectory for case in solved]
        points = np.array([campaign.grid.point(case) for case in solved])
    limits, worst, on_a_limit = PathLimits.of(mission), 0.0, 0
    shares = np.array([mission.limits.share(name) for name in limits.names])
    for k in range(0, len(solved), TOGETHER):
        part, some = mission.family(points[k : k + TOGETHER]), optima[k : k + TOGETHER]
        states = np.stack([flown.states for flown in some])
        final_time = np.array([flown.final_time for flown in some])
        flights = flight_checks(part, some[0].mesh, states, final_time)
        worst = max(worst, *(flight.position_error for flight in flights))
        for case, flown in enumerate(some):
            member = part.member(case)
            use = limits.use(member.flight_model, flown.states, flown.bank_rate, flown.times)
            greatest = np.array([float(np.max(of_limit)) for of_limit in use])
            on_a_limit += bool(np.any(greatest > shares * (1.0 - 1e-5)))
    cases = len(records)
    together = 1.0 - engine.alone / cases
    print(
        f"{name}: {len(solved)} of {cases} solved in {seconds:.1f} s by {JOBS} processes, "
        f"{1e3 * seconds / cases:.2f} ms a case; {100 * together:.1f} % by the family's iteration; "
        f"{on_a_limit} optima on a limit; re-integrated within {worst:.2f} m"
    )
    return {"milliseconds": 1e3 * seconds / cases}


def main() -> None:
    """Print what the module says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="without the grid of 6,561 cases")
    arguments = parser.parse_args()
    one_solve()
    two_controls()
    family("lifting_orbital")
    six = family("shefex3")
    if not arguments.quick:
        eight = family("shefex3_factors")
        ratio = eight["milliseconds"] / six["milliseconds"]
        print(f"a case of shefex3_factors takes {ratio:.2f} times as long as one of shefex3")


if __name__ == "__main__":
    main()
