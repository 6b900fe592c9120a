"""Fly the flight software in worlds that differ from its model, and write the tables of that.

python scripts/benchmark_worlds.py demo                        build and fly in the folder `demo`, print
python scripts/benchmark_worlds.py demo --page docs/results.md   replace its tables
python scripts/benchmark_worlds.py demo --json                 print the numbers
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from page_section import write_section

import ampi
import database
from ampi.cli.progress import progress
from ampi.simulation.engines import fly_batch
from ampi.simulation.estimates.proportions import Fraction
from ampi.simulation.statistics import ellipse_area, ratio_to_nominal

LAWS = ("linear_quadratic", "drag_sliding_mode", "drag_shuttle")
MODES = ("nominal", "ampi", "quadratic")
WORLDS = ("everything", "arctic", "hexeract", "entry")  # the wrong ones first
JANUARY = "arctic_january"
PAPER_LAW = "drag_sliding_mode"  # of the kind of the paper's tracker
RADII = (5e3, 25e3)  # m
PAPER_RADII = (6.5e3, 13e3, 25e3)  # m, Sagliano et al. 2016, Section V.A
PAPER_FLIGHTS = 1000
PAPER = {"nominal": (163, 400, 746), "ampi": (740, 985, 1000)}  # of 1000
JOBS = 2


def campaigns(folder: Path, n: int) -> dict[str, ampi.Flights]:
    """All laws, references and worlds on the same draws, in one file."""
    path = _database("shefex3", folder)
    mission = ampi.load_mission("shefex3")
    guides = {law: ampi.load_guidance(path, law=law) for law in LAWS}
    schemes = {
        f"{world} {law} {mode}": ampi.Scheme(guides[law].in_mode(mode), world)
        for world in WORLDS
        for law in LAWS
        for mode in MODES
    }
    with progress("flying", n * len(schemes)) as advance:
        return ampi.fly_schemes(
            mission, schemes, n, output=folder / "worlds.h5", n_jobs=JOBS, advance=advance
        )


def paper(folder: Path, n: int) -> dict[str, ampi.Flights]:
    """The paper's comparison: its kind of tracker, its dispersions, its number of flights."""
    guidance = ampi.load_guidance(_database("shefex3", folder), law=PAPER_LAW, modulate=True)
    schemes = {mode: ampi.Scheme(guidance.in_mode(mode), "entry") for mode in PAPER}
    mission, output = ampi.load_mission("shefex3"), folder / "paper.h5"
    return ampi.fly_schemes(mission, schemes, n, output=output, n_jobs=JOBS)


def january(folder: Path, n: int) -> dict[str, ampi.Flights]:
    """January at 70° N, by a table made in US76 and by one made in January's own air."""
    found = {}
    for name in ("shefex3", "shefex3_january"):
        guidance = ampi.load_guidance(_database(name, folder))
        schemes = {f"{name} {mode}": ampi.Scheme(guidance.in_mode(mode), JANUARY) for mode in MODES}
        found |= ampi.fly_schemes(
            ampi.load_mission(name),
            schemes,
            n,
            output=folder / f"january_{name}.h5",
            n_jobs=JOBS,
        )
    return found


def cost(folder: Path, rounds: int = 3) -> dict[str, float]:
    """CPU time of one update of 100 flights at 10 Hz (µs), the worlds in turn: the least of some."""
    mission = ampi.load_mission("shefex3")
    guidance = ampi.load_guidance(_database("shefex3", folder), cycle=0.1)
    found = dict.fromkeys(("entry", "everything", "arctic"), np.inf)
    for _ in range(rounds):
        for name in found:
            truth = ampi.load_world(name).draw(mission, 100, seed=1, pool="tuning")
            began = time.process_time()
            flown = fly_batch(mission.family(truth.parameters), guidance, truth)
            updates = float(np.nanmax(flown.final_time)) / guidance.cycle
            found[name] = min(found[name], 1e6 * (time.process_time() - began) / updates)
    return found


def _database(name: str, folder: Path) -> Path:
    path = folder / f"{name}.h5"
    folder.mkdir(exist_ok=True)
    database.build(ampi.load_mission(name), path, n_jobs=JOBS)
    return path


def measured(flights: ampi.Flights) -> dict[str, Any]:
    """Numbers of one campaign."""
    verdict = ampi.judge(flights)
    miss = np.where(flights.reached, flights.miss, np.inf)
    altitude = np.where(flights.reached, np.abs(flights.altitude_error), np.inf)
    return {
        "flights": flights.n,
        "within": {radius: vars(Fraction.of(miss < radius)) for radius in RADII},
        "miss": {name: vars(e) for name, e in vars(verdict.misses).items() if hasattr(e, "low")},
        "altitude_99": float(np.percentile(altitude, 99)),
        "altitude_worst": float(altitude.max()),
        "speed_worst": float(np.abs(flights.speed_error[flights.reached]).max()),
        "saturation": float(flights.saturation.mean()),
        "activity_deg": float(np.degrees(flights.activity.mean())),
        "peak_angle_change_deg": float(np.degrees(np.nanmax(np.abs(flights.angle_of_attack[()])))),
    }


def inside_the_hypercube(flown: Mapping[str, ampi.Flights]) -> dict[str, float]:
    """AMPI's flights whose entry lies inside, and its area over that of the same nominal flights."""
    own, nominal = flown["ampi"], flown["nominal"]
    inside = ~own.clipped
    areas = [ellipse_area(f.along[inside], f.across[inside]) for f in (own, nominal)]
    return {
        "flights": int(inside.sum()),
        "worst_miss_km": float(own.miss[inside].max()) / 1e3,
        "worst_altitude_km": float(np.abs(own.altitude_error[inside]).max()) / 1e3,
        "area_ratio": areas[0] / areas[1],
        "beyond_25_km_and_outside": int(np.sum(~(own.miss < PAPER_RADII[-1]) & ~inside)),
    }


def measure(folder: Path, n: int) -> dict[str, Any]:
    """Everything that the results page's tables say."""
    flown = campaigns(folder, n)
    found: dict[str, Any] = {name: measured(flights) for name, flights in flown.items()}
    own = paper(folder, PAPER_FLIGHTS)
    ratio = ratio_to_nominal(own["ampi"], own)
    return {
        "worlds": found,
        "paper": {
            mode: [int(np.sum(f.reached & (f.miss < radius))) for radius in PAPER_RADII]
            for mode, f in own.items()
        },
        "paper_inside": inside_the_hypercube(own),
        "against_nominal": {
            f"{world}, {law}": [
                {"radius": radius, **vars(found.difference)}
                for radius, found in ampi.compare(
                    flown[f"{world} {law} ampi"], flown[f"{world} {law} nominal"], RADII
                ).within.items()
            ]
            for world in WORLDS[:2]
            for law in LAWS
        },
        "paper_altitude_worst": {m: measured(f)["altitude_worst"] for m, f in own.items()},
        "areas_km2": {m: ampi.judge(f).footprint_area / 1e6 for m, f in own.items()},
        "area_ratio": None if ratio is None else vars(ratio),
        "january": {name: measured(f) for name, f in january(folder, n).items()},
        "cost_us": cost(folder),
    }


def _row(name: str, one: Mapping[str, Any]) -> str:
    shares = [
        f"{100 * w['count'] / w['n']:.0f} % [{100 * w['low']:.0f}, {100 * w['high']:.0f}]"
        for w in one["within"].values()
    ]
    median, far, worst = (one["miss"][k] for k in ("median", "percentile_99", "worst_mean"))
    cells = [
        *shares,
        f"{median['value'] / 1e3:.2f} [{median['low'] / 1e3:.2f}, {median['high'] / 1e3:.2f}]",
        f"{far['value'] / 1e3:.1f}",
        f"{worst['value'] / 1e3:.1f}",
        f"{one['altitude_99'] / 1e3:.2f}",
        f"{100 * one['saturation']:.1f} %",
    ]
    return f"| {name} | {' | '.join(cells)} |"


HEAD = [
    "within 5 km",
    "within 25 km",
    "median miss (km)",
    "99 % (km)",
    "CVaR 5 % (km)",
    "altitude, 99 % (km)",
    "saturated",
]


def table(found: Mapping[str, Any]) -> str:
    """The results page's tables."""
    head = f"| world, law, reference | {' | '.join(HEAD)} |"
    rule = f"|{'---|' * (len(HEAD) + 1)}"
    lines = [head, rule]
    lines += [_row(name.replace(" ", ", "), one) for name, one in found["worlds"].items()]
    flights = next(iter(found["worlds"].values()))["flights"]
    lines = [
        f"{flights} flights a row at 10 Hz, the same draws in a world [95 % interval]:",
        "",
        *lines,
    ]
    lines += [
        "",
        f"January at 70° N ({JANUARY}), by a table made in US76 and in January's own air:",
        "",
    ]
    lines += [head.replace("world, law, reference", "table, reference"), rule]
    lines += [_row(name.replace(" ", ", "), one) for name, one in found["january"].items()]
    lines += ["", *_against_nominal(found), "", *_paper(found), "", _cost(found["cost_us"])]
    return "\n".join(lines)


def _paper(found: Mapping[str, Any]) -> list[str]:
    lines = [
        f"The paper's comparison (Table 5) with a tracker of its kind, `{PAPER_LAW}`, world `entry`, "
        f"{PAPER_FLIGHTS} flights (the paper's numbers in brackets):",
        "",
        "| reference | within 6.5 km | within 13 km | within 25 km | area (km²) | altitude, worst |",
        "|---|---|---|---|---|---|",
    ]
    areas, altitudes = {"nominal": 5032, "ampi": 214}, {"nominal": "1.5 km", "ampi": "0.2 km"}
    for mode, counts in found["paper"].items():
        cells = [f"{c} ({p})" for c, p in zip(counts, PAPER[mode], strict=True)]
        worst = found["paper_altitude_worst"][mode] / 1e3
        cells += [f"{found['areas_km2'][mode]:,.0f} ({areas[mode]:,})"]
        lines.append(f"| {mode} | {' | '.join(cells)} | {worst:.2f} km ({altitudes[mode]}) |")
    ratio = found["area_ratio"]
    if ratio is not None:
        low, high = 100 * ratio["low"], 100 * ratio["high"]
        value = f"{100 * ratio['ratio']:.2g} % [{low:.2g}, {high:.2g}]"
        lines += ["", f"Ratio of the areas: {value} (4.2 %)."]
    own = found["paper_inside"]
    lines += [
        "",
        f"Of AMPI's flights {own['flights']} enter inside the hypercube; the worst of these ends "
        f"{own['worst_miss_km']:.1f} km from the target, {own['worst_altitude_km']:.2f} km off in "
        f"altitude, all on {100 * own['area_ratio']:.2g} % of the area of the same flights by nominal "
        "tracking. "
        f"{own['beyond_25_km_and_outside']} of those outside end beyond 25 km.",
    ]
    return lines


def _against_nominal(found: Mapping[str, Any]) -> list[str]:
    lines = [
        "AMPI less nominal tracking on the same draws, percentage points [95 % interval]:",
        "",
        "| world, law | within 5 km | within 25 km |",
        "|---|---|---|",
    ]
    for name, shares in found["against_nominal"].items():
        cells = [
            f"{100 * s['value']:+.1f} [{100 * s['low']:.1f}, {100 * s['high']:.1f}]" for s in shares
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def _cost(cost: Mapping[str, float]) -> str:
    plain = cost["entry"]
    told = ", ".join(
        f"`{name}` {value:.0f} µs ({value / plain:.2f} ×)" for name, value in cost.items()
    )
    return (
        f"One update of 100 flights at 10 Hz, plant, sensors, flight software and actuator: {told}."
    )


def main() -> None:
    """Parse, measure, print or write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="for databases and flights; run again to resume")
    parser.add_argument("--flights", type=int, default=300, help="per scheme")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.add_argument("--page", type=Path, help="replace the tables in this file")
    arguments = parser.parse_args()
    found = measure(arguments.folder, arguments.flights)
    if arguments.json:
        print(json.dumps(found, indent=1, default=float))
        return
    text = table(found)
    print(text)
    if arguments.page:
        write_section(arguments.page, "worlds", text)


if __name__ == "__main__":
    main()
