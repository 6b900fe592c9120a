"""Measure what the results page claims, and write its table.

python scripts/benchmark.py                      print the table
python scripts/benchmark.py --page docs/results.md   replace the table between its two markers
python scripts/benchmark.py --json               print the numbers
python scripts/benchmark.py --fresh              also time `make demo` in a clean clone
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
from ipopt_baseline import compare
from page_section import write_section

import ampi
from ampi.dataset import read_dataset
from ampi.physics.planet import great_circle_distance
from ampi.propagation.reintegration import reintegrate
from database.audit.audit import audit

JOBS = 2
MODES = ("nominal", "mpi", "ampi", "quadratic")
STARTS = 11  # of each process whose start is measured
ROOT = Path(__file__).resolve().parent.parent

# 90th percentiles that a prototype of the same method reached: the floor, not the goal.
FLOOR = {
    "mpi": (405.0, 14.6, 3.9, 0.71, 19.0),
    "ampi": (103.0, 3.8, 0.66, 0.11, 3.7),
}


def nominal_solution() -> dict[str, Any]:
    """The nominal optimum from the mission's constant bank angle."""
    mission = ampi.load_mission("shefex3")
    optimum = ampi.solve(mission)
    seconds = [ampi.solve(mission).statistics.solve_seconds for _ in range(5)]
    check = reintegrate(mission, optimum)
    end = check.states[0, :, -1] - optimum.states[:6, -1]
    there = check.states[0, 1:3, -1]
    radius = mission.flight_model.planet.equatorial_radius
    horizontal = great_circle_distance(*optimum.states[1:3, -1], *there, radius)
    return {
        "status": optimum.status.name,
        "iterations": optimum.statistics.iterations,
        "nodes": optimum.mesh.n_nodes,
        "final_position_error_m": float(np.hypot(horizontal, end[0])),
        "final_altitude_error_m": float(abs(end[0])),
        "final_speed_error_m_per_s": float(abs(end[3])),
        "greatest_position_error_m": float(check.position_error[0]),
        "greatest_altitude_error_m": float(check.altitude_error[0]),
        "greatest_speed_error_m_per_s": float(check.speed_error[0]),
        "median_seconds": float(np.median(seconds)),
    }


def build_database(path: Path) -> dict[str, Any]:
    """The full 3^6 build, in a process of its own so that its memory is its own."""
    began = time.perf_counter()
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "ampi.cli",
            "build",
            "shefex3",
            str(path),
            "--jobs",
            str(JOBS),
            "--json",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    report = json.loads(done.stdout)
    report["command_seconds"] = time.perf_counter() - began
    # Largest single process; the driver and every worker are at most that large.
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    report["peak_memory_bound_MiB"] = (JOBS + 1) * largest / 2**20
    report["file_MB"] = path.stat().st_size / 1e6
    return report


TYPER_ALONE = """
import rich, typer
app = typer.Typer()
@app.command()
def one(number: int = 1): "One command."
@app.command()
def two(): "Another."
app(["--help"])
"""


def start_up(path: Path) -> dict[str, float]:
    """Median CPU time of whole processes that start, do little and end, in ms; all in turn."""
    python, command = [sys.executable], [sys.executable, "-m", "ampi.cli"]
    processes = {
        "typer_and_rich": [*python, "-c", TYPER_ALONE],
        "help": [*command, "--help"],
        "guide_help": [*command, "guide", "--help"],
        "import_guidance": [*python, "-c", "import ampi.guidance"],
        "guide": [*command, "guide", str(path)],
    }
    seconds: dict[str, list[float]] = {name: [] for name in processes}
    for _ in range(STARTS):
        for name, words in processes.items():
            before = _children_seconds()
            subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
            seconds[name].append(_children_seconds() - before)
    return {name: 1e3 * float(np.median(times)) for name, times in seconds.items()}


def _children_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def online_latency(path: Path) -> dict[str, float]:
    """Median time of one reference (cell, interpolation, LD→HD to 601 points), in µs."""
    mission = read_dataset(path).mission
    entries = ampi.load_world("entry").draw(mission, 500, seed=1).parameters
    found = {}
    for mode in MODES:
        guidance = ampi.load_guidance(path, mode=mode)
        samples = []
        for entry in entries:
            began = time.perf_counter()
            guidance.reference(entry)
            samples.append(time.perf_counter() - began)
        found[mode] = 1e6 * float(np.median(samples))
    return found


def campaigns(path: Path) -> dict[str, Any]:
    """1000 closed-loop flights per mode on the same draws, at 2 Hz."""
    mission = read_dataset(path).mission
    guidance = ampi.load_guidance(path)
    found: dict[str, Any] = {}
    for mode in MODES:
        began = time.perf_counter()
        flights = ampi.fly(mission, guidance.in_mode(mode), n=1000, n_jobs=JOBS, cycle=0.5)
        verdict = ampi.judge(flights)
        found[mode] = {**verdict.as_dict(), "seconds": time.perf_counter() - began}
    return found


def fresh_demo() -> float:
    """Seconds of `git clone` and `make demo`, installation included, in an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {k: v for k, v in os.environ.items() if k != "VIRTUAL_ENV"}
        began = time.perf_counter()
        subprocess.run(["git", "clone", "--quiet", str(ROOT), f"{folder}/ampi"], check=True)
        subprocess.run(
            ["make", "demo"],
            cwd=f"{folder}/ampi",
            check=True,
            env=environment,
            stdout=subprocess.DEVNULL,
        )
        return time.perf_counter() - began


def measure(*, fresh: bool, probes: int) -> dict[str, Any]:
    """Everything, in one run."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shefex3.h5"
        found: dict[str, Any] = {"nominal": nominal_solution(), "build": build_database(path)}
        found["audit"] = audit(read_dataset(path), probes=probes, n_jobs=JOBS).as_dict()
        found["latency_us"] = online_latency(path)
        found["start_up_ms"] = start_up(path)
        found["flights"] = campaigns(path)
    found["grid"] = compare(ampi.load_mission("shefex3"), JOBS)
    if fresh:
        found["fresh_demo_seconds"] = fresh_demo()
    found["machine"] = f"{os.cpu_count()} cores, Python {platform.python_version()}"
    return found


Row = tuple[str, str, str]


def table(found: dict[str, Any]) -> str:
    """The results table of the page."""
    rows = [*_optima(found), *_build(found["build"]), *_online(found)]
    rows += _flown(found["flights"]["ampi"])
    if "fresh_demo_seconds" in found:
        rows.append(
            ("`make demo` in a clean clone", "6 min", f"{found['fresh_demo_seconds'] / 60:.1f} min")
        )
    lines = ["| what | asked | measured |", "|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    sections = [_interpolation(found["audit"]), _flights(found["flights"])]
    sections.append(_against_ipopt(found["grid"]))
    return "\n".join([*lines, *(line for section in sections for line in ("", *section))])


def _optima(found: dict[str, Any]) -> list[Row]:
    nominal, build, checks = found["nominal"], found["build"], found["audit"]
    limit = max(checks["limits"].values())
    return [
        (
            "nominal solution from a constant bank angle",
            "≤ 25 iterations, ≤ 64 nodes",
            f"{nominal['iterations']} iterations, {nominal['nodes']} nodes, "
            f"{1e3 * nominal['median_seconds']:.0f} ms",
        ),
        (
            "… re-integrated (DOP853), at the end",
            "10 m, altitude 2 m, 0.05 m/s",
            f"{nominal['final_position_error_m']:.2f} m, {nominal['final_altitude_error_m']:.2f} m, "
            f"{nominal['final_speed_error_m_per_s']:.4f} m/s",
        ),
        (
            "… greatest along the flight",
            "–",
            f"{nominal['greatest_position_error_m']:.1f} m, "
            f"{nominal['greatest_altitude_error_m']:.1f} m, "
            f"{nominal['greatest_speed_error_m_per_s']:.2f} m/s",
        ),
        ("database: cases solved", "729 of 729", f"{build['solved']} of {build['cases']}"),
        (
            "… re-integrated position error, worst case",
            "50 m",
            f"{checks['position_error']['worst']:.1f} m",
        ),
        (
            "… limits between the nodes, greatest use",
            "≤ 100.5 %",
            f"{100 * limit:.1f} %",
        ),
    ]


def _build(build: dict[str, Any]) -> list[Row]:
    return [
        ("build, 2 processes", "60 s", f"{build['command_seconds']:.1f} s"),
        (
            "… memory of all processes, upper bound",
            "1024 MiB",
            f"{build['peak_memory_bound_MiB']:.0f} MiB",
        ),
        (
            "… iterations from a neighbour, median (worst)",
            "6",
            f"{build['median_iterations']:.0f} ({build['worst_iterations']})",
        ),
    ]


def _online(found: dict[str, Any]) -> list[Row]:
    return [
        (
            "one reference online, AMPI, 601 points",
            "200 µs",
            f"{found['latency_us']['ampi']:.0f} µs "
            f"(quadratic: {found['latency_us']['quadratic']:.0f} µs)",
        ),
        *_start_up(found["start_up_ms"]),
    ]


def _flown(flights: dict[str, Any]) -> list[Row]:
    within_25, within_3 = flights["within"]["25000.0"], flights["within"]["3000.0"]
    return [
        ("1000 closed-loop flights at 2 Hz, 2 processes", "30 s", f"{flights['seconds']:.1f} s"),
        ("AMPI within 25 km", "1000", f"{within_25['count']} of {within_25['n']}"),
        (
            "AMPI within 3 km",
            "99 %",
            f"{100 * within_3['count'] / within_3['n']:.1f} % "
            f"[{100 * within_3['low']:.1f}, {100 * within_3['high']:.1f}]",
        ),
        ("AMPI altitude error, worst", "500 m", f"{flights['altitude']['worst']:.0f} m"),
    ]


def _start_up(cpu: dict[str, float]) -> list[tuple[str, str, str]]:
    alone = cpu["typer_and_rich"]
    return [
        ("CPU time of a process: typer and rich alone, their help", "–", f"{alone:.0f} ms"),
        (
            "… `ampi --help`",
            "≤ twice that",
            f"{cpu['help']:.0f} ms ({cpu['help'] / alone:.2f} times that)",
        ),
        ("… `ampi guide --help`", "–", f"{cpu['guide_help']:.0f} ms"),
        ("… `import ampi.guidance`", "–", f"{cpu['import_guidance']:.0f} ms"),
        ("… `ampi guide` on this database", "–", f"{cpu['guide']:.0f} ms"),
    ]


def _interpolation(checks: dict[str, Any]) -> list[str]:
    lines = [
        f"Interpolation error against the problem solved there, 90th percentile of "
        f"{checks['probes']} random points (in brackets: a prototype of the same method):",
        "",
        "| reference | altitude | speed | bank | t_f | miss, flown open loop |",
        "|---|---|---|---|---|---|",
    ]
    units = ("m", "m/s", "°", "s", "km")
    for mode, columns in checks["interpolation"].items():
        cells = []
        for i, (quantity, unit) in enumerate(zip(columns.values(), units, strict=True)):
            floor = f" ({FLOOR[mode][i]:g})" if mode in FLOOR else ""
            cells.append(f"{quantity['percentile_90']:.3g} {unit}{floor}")
        lines.append(f"| {mode} | {' | '.join(cells)} |")
    return lines


def _against_ipopt(grid: dict[str, Any]) -> list[str]:
    ours, theirs = grid["ours"], grid["ipopt"]
    return [
        f"All {grid['cases']} problems of the grid, solved by this method and by CasADi + IPOPT "
        f"({theirs['barrier']} barrier, primal-dual warm starts), same nodes, order and processes:",
        "",
        "| | whole grid | one problem, median | iterations, median | solved |",
        "|---|---|---|---|---|",
        *(
            f"| {name} | {r['seconds']:.1f} s | {1e3 * r['median_solve_seconds']:.1f} ms | "
            f"{r['median_iterations']:.0f} | {r['solved']} |"
            for name, r in (("this method", ours), ("IPOPT", theirs))
        ),
        f"| the whole build: also gains, re-integration, the file | "
        f"{grid['whole_build']['seconds']:.1f} s | – | – | {grid['whole_build']['solved']} |",
        "",
        f"IPOPT takes {grid['ratio']:.1f} times as long as this method (asked: 3), and "
        f"{grid['whole_build_ratio']:.1f} times as long as the whole build; costs agree to "
        f"{grid['greatest_cost_difference']:.0e} (relative, greatest of all). Where our time goes: "
        + ", ".join(f"{name} {100 * share:.0f} %" for name, share in grid["phases"].items())
        + ".",
    ]


def _flights(flights: dict[str, Any]) -> list[str]:
    lines = [
        "Closed loop at 2 Hz, 1000 flights in the model's own world (Eq. (34)), the same draws for all:",
        "",
        "| reference | reached | miss: median | 99 % | worst | altitude error, worst |",
        "|---|---|---|---|---|---|",
    ]
    for mode, verdict in flights.items():
        miss, altitude = verdict["miss"], verdict["altitude"]
        lines.append(
            f"| {mode} | {verdict['reached']['count']} | {miss['median'] / 1e3:.2f} km | "
            f"{miss['percentile_99'] / 1e3:.2f} km | {miss['worst'] / 1e3:.2f} km | "
            f"{altitude['worst']:.0f} m |"
        )
    return lines


def main() -> None:
    """Parse, measure, print or write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.add_argument("--page", type=Path, help="replace the results in this file")
    parser.add_argument("--fresh", action="store_true", help="time `make demo` in a clean clone")
    parser.add_argument("--probes", type=int, default=200, help="random points of the audit")
    arguments = parser.parse_args()
    found = measure(fresh=arguments.fresh, probes=arguments.probes)
    if arguments.json:
        print(json.dumps(found, indent=1, default=float))
        return
    text = table(found)
    print(text)
    if arguments.page:
        machine = f"Measured by `make benchmark` on a shared machine: {found['machine']}."
        write_section(arguments.page, "results", f"{machine}\n\n{text}")


if __name__ == "__main__":
    main()
