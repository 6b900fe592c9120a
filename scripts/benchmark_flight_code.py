"""Time the flight code in C, the table that it flies, and the engine that flies it in campaigns.

python scripts/benchmark_flight_code.py demo                        build and fly in the folder `demo`
python scripts/benchmark_flight_code.py demo --page docs/results.md     replace the tables in this page
python scripts/benchmark_flight_code.py demo --json                 print the numbers
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from flight_truth import flown_by_dop853, seconds_of_one_call
from memory_watch import MemoryWatch
from numpy.typing import NDArray
from page_section import write_section
from scipy.interpolate import RegularGridInterpolator

import ampi
import database
from ampi._native.engine import core
from ampi.cli.progress import progress
from ampi.guidance import Guidance
from ampi.simulation import closed_loop
from ampi.simulation.engines import fly_batch

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parent
CORE = Path(str(resources.files("ampi.export"))) / "c"
FLAGS = ("-std=c99", "-O3", "-march=x86-64-v3", "-ffp-contract=off")
KINDS = ("float64", "float32", "int16")
JOBS = 2
ENTRIES, ROUNDS = 50, 5
NUMPY_FLIGHTS, NATIVE_FLIGHTS = 128, 640  # of one batch, an engine each
AGAINST_DOP853 = 3  # flights: a minute of Python


def median_us(call: Callable[[Any], object], arguments: list[Any]) -> float:
    """Median CPU time (µs) of a call."""
    samples = []
    for argument in arguments:
        began = time.process_time_ns()
        call(argument)
        samples.append(time.process_time_ns() - began)
    return 1e-3 * float(np.median(samples))


def references(guidance: Guidance, entries: Array) -> dict[str, Any]:
    """One high-density reference by numpy, by scipy, and in C; one step in C and in Python (µs)."""
    table = guidance.table
    library = RegularGridInterpolator(table.axes, table.values)
    told = list(entries)
    found: dict[str, Any] = {
        "numpy": median_us(guidance.on_engine("numpy").reference, told * ROUNDS),
        "scipy": median_us(lambda p: library(p)[0] @ table.conversion, told[:20]),
        "step_python": step_in_python(guidance),
        "step_numpy": step_in_python(guidance.on_engine("numpy")),
    }
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            found[kind] = in_c(Path(folder), guidance.blob(kind), entries, single=kind != "float64")
    return found


def in_c(folder: Path, blob: bytes, entries: Array, *, single: bool) -> dict[str, float]:
    """What flight_code_timer.c prints (µs), compiled with `FLAGS`."""
    program = folder / "timer"
    subprocess.run(
        [
            "cc",
            *FLAGS,
            *(["-DAMPI_SINGLE"] if single else []),
            f"-I{CORE}",
            str(ROOT / "flight_code_timer.c"),
            *map(str, sorted(CORE.glob("ampi_*.c"))),
            "-lm",
            "-o",
            str(program),
        ],
        check=True,
    )
    (folder / "table.bin").write_bytes(blob)
    (folder / "entries.bin").write_bytes(entries.tobytes())
    command = [str(program), str(folder / "table.bin"), str(folder / "entries.bin"), str(ROUNDS)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return {name: 1e-3 * value for name, value in json.loads(done.stdout).items()}


def step_in_python(guidance: Guidance) -> float:
    """Median CPU time (µs) of `Guidance.step` for one flight."""
    centre = [axis[i] for axis, i in zip(guidance.table.axes, guidance.table.centre, strict=True)]
    guidance.begin(centre)
    reference = guidance.reference(centre)
    rows = reference.rows[:8].T.copy()
    samples = []
    for k in range(500):
        navigation = rows[k]
        began = time.process_time_ns()
        guidance.step(float(reference.times[k]), navigation)
        samples.append(time.process_time_ns() - began)
    return 1e-3 * float(np.median(samples[50:]))


def opened_references(blob: bytes, guidance: Guidance, entries: Array) -> list[Array]:
    """High-density rows (r, m) by the compiled flight code."""
    (nodes, points), rows = guidance.table.conversion.shape, len(guidance.table.layout)
    code, found = core().Guidance(core().Table(blob), 1, None), []
    for p in entries:
        low, times, high = np.empty(rows * nodes + 1), np.empty(points), np.empty((rows, points))
        code.reference(np.ascontiguousarray(p), low, times, high)
        found.append(high)
    return found


def tables(guidance: Guidance, entries: Array) -> dict[str, Any]:
    """Size of the table by kind, its errors against float64, and its share of high-density storage."""
    exact = opened_references(guidance.blob(), guidance, entries)
    cases, points = guidance.table.final_time.size, guidance.table.conversion.shape[1]
    rows = len(guidance.table.layout)
    found: dict[str, Any] = {"traditional_bytes": 8 * cases * rows * points}
    for kind in KINDS:
        own = opened_references(guidance.blob(kind), guidance, entries)
        off = np.max([np.abs(a - b).max(axis=1) for a, b in zip(own, exact, strict=True)], axis=0)
        found[kind] = {
            "bytes": len(guidance.blob(kind)),
            "altitude_m": float(off[0]),
            "speed_m_per_s": float(off[3]),
            "angle_rad": float(off[[1, 2, 4, 5, 6]].max()),
        }
    return found


def flights(guidance: Guidance, world: str) -> dict[str, Any]:
    """CPU time of one closed-loop flight (ms), by engine and by an integrator called every cycle."""
    found: dict[str, Any] = {}
    for cycle in (0.1, 1.0):
        own = guidance.at_cycle(cycle)
        for engine, n in (("native", NATIVE_FLIGHTS), ("numpy", NUMPY_FLIGHTS)):
            found[f"{engine}_{cycle:g}"] = _flown(own.on_engine(engine), world, n)
    return found


def _flown(guidance: Guidance, world: str, n: int) -> dict[str, float]:
    truth = ampi.load_world(world).draw(mission(), n, seed=1, pool="tuning")
    family = mission().family(truth.parameters)
    seconds, updates = [], 0.0
    for _ in range(1 if guidance.engine == "numpy" else 3):
        began = time.process_time()
        batch = fly_batch(family, guidance, truth)
        seconds.append(time.process_time() - began)
        updates = float(np.nansum(batch.final_time)) / guidance.cycle
    return {
        "ms": 1e3 * float(np.median(seconds)) / n,
        "us_per_update": 1e6 * float(np.median(seconds)) / updates,
    }


def one_step_an_update(guidance: Guidance, world: str) -> dict[str, float]:
    """At 1 Hz with one step of the plant in each cycle, where campaigns take two: as others count.

    The error is that of the world `entry`: in it the steering between two records is what was recorded.
    """
    own, settings = guidance.at_cycle(1.0).on_engine("native"), closed_loop.PLANT
    closed_loop.PLANT = replace(settings, step=1.0)
    try:
        found = {
            f"us_{name}": _flown(own, name, NATIVE_FLIGHTS)["us_per_update"]
            for name in (world, "entry")
        }
        truth = ampi.load_world("entry").draw(mission(), AGAINST_DOP853, seed=1, pool="tuning")
        family = mission().family(truth.parameters)
        batch = fly_batch(family, own, truth, record_every=1.0)
        errors = [flown_by_dop853(family, own, truth, batch, i) for i in range(AGAINST_DOP853)]
    finally:
        closed_loop.PLANT = settings
    return {**found, "error_entry_m": float(np.max(errors))}


def against_integrators(guidance: Guidance, world: str) -> dict[str, float]:
    """The plant against DOP853, and solve_ivp called every cycle."""
    own = guidance.at_cycle(0.1).on_engine("native")
    found = {}
    for name in ("entry", world):
        truth = ampi.load_world(name).draw(mission(), AGAINST_DOP853, seed=1, pool="tuning")
        family = mission().family(truth.parameters)
        batch = fly_batch(family, own, truth, record_every=0.1)
        errors = [flown_by_dop853(family, own, truth, batch, i) for i in range(AGAINST_DOP853)]
        found[f"error_{name}_m"] = float(np.max(errors))
    call = seconds_of_one_call(family, own, truth, batch)
    updates = float(np.nanmean(batch.final_time)) / 0.1
    return {**found, "solve_ivp_ms": 1e3 * call * updates}


def campaign(path: Path, folder: Path, n: int, world: str) -> dict[str, float]:
    """`n` flights in a file by two workers: wall-clock seconds, rate, and memory of all processes."""
    output = folder / f"{world}_{n}.h5"
    output.unlink(missing_ok=True)
    began = time.perf_counter()
    with progress(f"flying {n}", n) as advance, MemoryWatch() as watch:
        ampi.fly(
            mission(),
            ampi.load_guidance(path),
            world,
            n,
            output=output,
            n_jobs=JOBS,
            record_every=1e3 if n > 10_000 else 5.0,
            advance=advance,
        )
    seconds = time.perf_counter() - began
    return {
        "flights": n,
        "seconds": seconds,
        "per_second": n / seconds,
        "memory_MiB": watch.greatest,
        "file_MB": output.stat().st_size / 1e6,
    }


def mission() -> ampi.Mission:
    """Of the database."""
    return ampi.load_mission("shefex3")


def measure(folder: Path, many: int) -> dict[str, Any]:
    """Everything, in one run."""
    folder.mkdir(exist_ok=True)
    path = folder / "shefex3.h5"
    database.build(mission(), path, n_jobs=JOBS)
    guidance = ampi.load_guidance(path)
    entries = ampi.load_world("entry").draw(mission(), ENTRIES, seed=1).parameters
    return {
        "cpu": _processor(),
        "flags": " ".join(FLAGS),
        "reference_us": references(guidance, entries),
        "table": tables(guidance, entries),
        "flight": flights(guidance, "everything"),
        "one_step": one_step_an_update(guidance, "everything"),
        "truth": against_integrators(guidance, "everything"),
        "campaign_1000": campaign(path, folder, 1000, "everything"),
        "campaign_many": campaign(path, folder, many, "everything"),
    }


def _processor() -> str:
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    name, clock = (re.search(rf"{key}\s*: (.*)", text) for key in ("model name", "cpu MHz"))
    return f"{name[1] if name else 'unknown'}, {float(clock[1]) / 1e3 if clock else 0:.2f} GHz"


Row = tuple[str, str, str]


def table(found: dict[str, Any]) -> str:
    """The results page's table."""
    rows = [*_reference_rows(found["reference_us"]), *_table_rows(found["table"])]
    rows += [*_flight_rows(found), *_campaign_rows(found)]
    lines = ["| what | asked | measured |", "|---|---|---|"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    lines += ["", f"CPU times on a shared {found['cpu']}; C by `cc {found['flags']}`."]
    return "\n".join(lines)


def _reference_rows(us: dict[str, Any]) -> list[Row]:
    double, single = us["float64"], us["float32"]
    return [
        (
            "one reference, 601 points, C float64",
            "7 × numpy, 25 × scipy",
            f"{double['reference']:.0f} µs: {us['numpy'] / double['reference']:.1f} ×, "
            f"{us['scipy'] / double['reference']:.0f} ×",
        ),
        (
            "… C float32",
            "20 × numpy, 80 × scipy",
            f"{single['reference']:.0f} µs: {us['numpy'] / single['reference']:.1f} ×, "
            f"{us['scipy'] / single['reference']:.0f} ×",
        ),
        (
            "… over reading its cell of the table, float64, float32",
            "2.5 ×",
            f"{double['reference'] / double['cell_read']:.1f} ×, "
            f"{single['reference'] / single['cell_read']:.1f} × "
            f"(without the points {double['low_density'] / double['cell_read']:.1f} ×, "
            f"{single['low_density'] / single['cell_read']:.1f} ×)",
        ),
        ("one guidance step, C", "0.5 µs", f"{double['step']:.2f} µs"),
        (
            "… `Guidance.step` of one flight in Python (numpy alone)",
            "20 µs",
            f"{us['step_python']:.1f} µs ({us['step_numpy']:.0f} µs)",
        ),
    ]


def _table_rows(size: dict[str, Any]) -> list[Row]:
    return [
        *(
            (
                f"table, {kind}",
                "1.5 MiB; 10 cm, 5 mm/s, 2e-5 rad" if kind == "int16" else "–",
                f"{own['bytes'] / 2**20:.2f} MiB, "
                f"{100 * own['bytes'] / size['traditional_bytes']:.1f} % of high-density storage; "
                f"{100 * own['altitude_m']:.2g} cm, {1e3 * own['speed_m_per_s']:.2g} mm/s, "
                f"{own['angle_rad']:.1g} rad",
            )
            for kind, own in ((kind, size[kind]) for kind in KINDS)
        ),
    ]


def _flight_rows(found: dict[str, Any]) -> list[Row]:
    flight, truth, one = found["flight"], found["truth"], found["one_step"]
    native, plain = flight["native_0.1"], flight["numpy_0.1"]
    return [
        (
            "one flight at 10 Hz, `everything`, native engine",
            "25 × numpy; goal 2 ms",
            f"{native['ms']:.2f} ms: {plain['ms'] / native['ms']:.0f} ×",
        ),
        (
            "… against solve_ivp called every cycle",
            "1,000 ×",
            f"{truth['solve_ivp_ms'] / native['ms']:,.0f} ×",
        ),
        (
            "… end against DOP853 (world `entry`, whose air has no kinks)",
            "1 cm",
            f"{1e3 * truth['error_everything_m']:.2g} mm ({1e3 * truth['error_entry_m']:.2g} mm)",
        ),
        (
            "one update at 1 Hz",
            "1 µs (Aerocapture: 1.9)",
            f"{flight['native_1']['us_per_update']:.2f} µs",
        ),
        (
            "… with one step of the plant each, as Aerocapture's (world `entry`: end against DOP853)",
            "1 µs",
            f"{one['us_everything']:.2f} µs ({one['us_entry']:.2f} µs: "
            f"{100 * one['error_entry_m']:.1f} cm)",
        ),
    ]


def _campaign_rows(found: dict[str, Any]) -> list[Row]:
    many, thousand = found["campaign_many"], found["campaign_1000"]
    return [
        (
            "1,000 `everything` flights, two processes",
            "8 s",
            f"{thousand['seconds']:.1f} s",
        ),
        (
            f"{many['flights']:,} flights in a file, two processes",
            "1 GiB",
            f"{many['seconds']:.0f} s, {many['per_second']:.0f} a second, "
            f"{many['memory_MiB']:.0f} MiB at the most, {many['file_MB']:.0f} MB",
        ),
    ]


def main() -> None:
    """Parse, measure, print or write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="for the database and flights")
    parser.add_argument("--many", type=int, default=100_000, help="flights of the long campaign")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.add_argument("--page", type=Path, help="replace the table in this page")
    arguments = parser.parse_args()
    found = measure(arguments.folder, arguments.many)
    if arguments.json:
        print(json.dumps(found, indent=1, default=float))
        return
    text = table(found)
    print(text)
    if arguments.page:
        write_section(arguments.page, "flight code", text)


if __name__ == "__main__":
    main()
