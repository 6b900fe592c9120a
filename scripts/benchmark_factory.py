"""Measure the database factory: its limits without the optimiser, a real build, its efficiency.

python scripts/benchmark_factory.py                 print the table
python scripts/benchmark_factory.py --json          print the numbers
python scripts/benchmark_factory.py --repeats 5     medians over more runs
python scripts/benchmark_factory.py --once 5 6 2 stand-in 2      one build: points, axes, workers, cores

The split of a build, in processor time per case: d of the driver, which no worker can take from it, and
w of the workers. If nothing that the driver does overlaps with what they do, n workers take d + w/n a
case, and a single one d + w. So the efficiency is, ideal time over the time that it takes,

    E(n) = ((d + w) / n) / (d + w / n) = (d + w) / (n d + w).

Start-up and nominal case, in which one worker alone is busy, are in d and w, but nobody waits for them
in E: `nominal_seconds` says how long they take.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import ampi
import database
from ampi.missions.loading import parse_mission
from ampi.scp.solve import solve
from database.factory.stand_in import neighbour_moved

SPANS = {
    "altitude_m": 250.0,
    "longitude_deg": 0.5,
    "latitude_deg": 0.5,
    "speed_m_per_s": 70.0,
    "flight_path_angle_deg": 0.5,
    "azimuth_deg": 0.5,
}
SOLVERS = {"optimiser": solve, "stand-in": neighbour_moved}


def mission_with_grid(points: int, dimensions: int) -> ampi.Mission:
    """SHEFEX-3 with `points` per axis on the last `dimensions` axes of the hexeract."""
    text = ampi.load_mission("shefex3").toml
    axes = list(SPANS.items())[len(SPANS) - dimensions :]
    lines = [f"{name} = {np.linspace(-span, span, points).tolist()}" for name, span in axes]
    return parse_mission(text[: text.index("[grid]")] + "\n".join(["[grid]", *lines, ""]))


def confine(cores: int) -> None:
    """Leave this process and its workers so many cores, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])


def build_once(points: int, dimensions: int, jobs: int, solver: str, cores: int) -> dict[str, Any]:
    """One build in this process, with its memory; meant to be the only thing the process does."""
    mission = mission_with_grid(points, dimensions)
    confine(cores)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grid.h5"
        began, before, nominal = time.perf_counter(), processor_times(), list[float]()

        def advance(count: int) -> None:
            if count and not nominal:
                nominal.append(time.perf_counter() - began)

        report = database.build(mission, path, n_jobs=jobs, solver=SOLVERS[solver], advance=advance)
        seconds = time.perf_counter() - began
        driver, workers = (b - a for a, b in zip(before, processor_times(), strict=True))
        return {
            "grid": f"{points}^{dimensions}",
            "cases": report.cases,
            "solved": report.solved,
            "solver": solver,
            "processes": jobs,
            "seconds": seconds,
            "merge_seconds": report.seconds - report.solve_seconds,
            "nominal_seconds": nominal[0],
            "driver_seconds": driver,
            "worker_seconds": workers,
            "driver_ms_per_case": 1e3 * driver / report.cases,
            "worker_ms_per_case": 1e3 * workers / report.cases,
            "efficiency_of_16": split_efficiency(driver, workers, 16),
            "cases_per_second": report.cases / seconds,
            "driver_peak_MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            "largest_worker_peak_MiB": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
            / 1024,
            "file_MB": path.stat().st_size / 1e6,
            "worst_position_error_m": report.worst_position_error,
        }


def processor_times() -> tuple[float, float]:
    """Of this process, and of its children that have ended and theirs (s)."""
    used = os.times()
    return used.user + used.system, used.children_user + used.children_system


def split_efficiency(driver: float, workers: float, count: int) -> float:
    """E(n) of the head of this file."""
    return (driver + workers) / (count * driver + workers)


def in_a_process(
    points: int, dimensions: int, jobs: int, solver: str, cores: int = 2
) -> dict[str, Any]:
    """`build_once` in a process of its own."""
    arguments = [str(points), str(dimensions), str(jobs), solver, str(cores)]
    done = subprocess.run(
        [sys.executable, __file__, "--once", *arguments], stdout=subprocess.PIPE, check=True
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def efficiency(points: int, dimensions: int, repeats: int) -> dict[str, Any]:
    """One worker against two, in turn, so that what else the machine does falls on all.

    Two workers have two cores. One worker has one core, or two: then its driver and its flushes run on
    the second, which two workers have to share.
    """
    runs = {"one_on_one": (1, 1), "one_on_two": (1, 2), "two_on_two": (2, 2)}
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, (jobs, cores) in runs.items():
            found = in_a_process(points, dimensions, jobs, "optimiser", cores)
            seconds[name].append(found["seconds"])
    median = {name: float(np.median(found)) for name, found in seconds.items()}
    return {
        "grid": f"{points}^{dimensions}",
        "repeats": repeats,
        "seconds": seconds,
        "median_seconds": median,
        "efficiency": median["one_on_one"] / (2.0 * median["two_on_two"]),
        "efficiency_with_two_cores_for_one": median["one_on_two"] / (2.0 * median["two_on_two"]),
    }


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Everything, in one run."""
    return {
        "runner": in_a_process(arguments.points, 6, 2, "stand-in"),
        "real": in_a_process(arguments.points, 6, 2, "optimiser"),
        "parallel": [efficiency(*grid, arguments.repeats) for grid in ((3, 6), (5, 5), (5, 6))],
        "machine": f"{os.cpu_count()} cores, Python {platform.python_version()}",
    }


def table(found: dict[str, Any]) -> str:
    """For people."""
    lines = [
        "| grid | optimiser | cases/s | driver, peak | largest worker, peak | file | merge "
        "| driver, a case | workers, a case | 16 workers: efficiency |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for b in (found["runner"], found["real"]):
        lines.append(
            f"| {b['grid']} = {b['cases']} | {b['solver']} | {b['cases_per_second']:.0f} | "
            f"{b['driver_peak_MiB']:.0f} MiB | {b['largest_worker_peak_MiB']:.0f} MiB | "
            f"{b['file_MB']:.1f} MB | {b['merge_seconds']:.1f} s | "
            f"{b['driver_ms_per_case']:.3f} ms | {b['worker_ms_per_case']:.2f} ms | "
            f"{b['efficiency_of_16']:.2f} |"
        )
    lines += [
        "",
        "| grid | one worker, one core | one, two cores | two, two | efficiency: cores | workers |",
        "|---|---|---|---|---|---|",
    ]
    for p in found["parallel"]:
        times = " | ".join(f"{seconds:.1f} s" for seconds in p["median_seconds"].values())
        of_workers = p["efficiency_with_two_cores_for_one"]
        lines.append(f"| {p['grid']} | {times} | {p['efficiency']:.3f} | {of_workers:.3f} |")
    repeats = found["parallel"][0]["repeats"]
    note = f"Medians of {repeats}; a second of each build is start-up, nominal solution and merge"
    return "\n".join([*lines, "", f"{note} ({found['machine']})."])


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.add_argument("--repeats", type=int, default=3, help="of the builds that are compared")
    parser.add_argument("--points", type=int, default=5, help="per axis, of the runner's six")
    parser.add_argument("--once", nargs=5, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.once:
        points, dimensions, jobs, solver, cores = arguments.once
        found = build_once(int(points), int(dimensions), int(jobs), solver, int(cores))
        print(json.dumps(found))
        return
    found = measure(arguments)
    print(json.dumps(found, indent=1) if arguments.json else table(found))


if __name__ == "__main__":
    main()
