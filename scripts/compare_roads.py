"""Roads to the target when the model is wrong, on the same draws: one table.

python scripts/compare_roads.py FOLDER [--flights 1000] [--json roads.json] [--page docs/results.md]

A fixed reference {nominal, AMPI, quadratic}, tracked; and plans that begin as AMPI's, corrected in
flight by bank alone, by bank and angle of attack. The databases are built into FOLDER.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from page_section import write_section

import ampi
import database
from ampi.correction.corrector import CorrectionOutcome
from ampi.export.blob import table_blob
from ampi.export.model_blob import model_blob
from ampi.simulation.closed_loop import plant_of
from ampi.simulation.physical_reach import Authority, nearest_misses

JOBS = 2
US76, JANUARY = "shefex3", "shefex3_january"
PLACES = [  # world, mission of the table, title
    ("entry", US76, "entry"),
    ("hexeract", US76, "hexeract"),
    ("factors", US76, "constant factors"),
    ("everything", US76, "everything"),
    ("arctic_january", US76, "Arctic January, US76's table"),
    ("arctic_january", JANUARY, "Arctic January, its own table"),
    ("arctic", US76, "Arctic, all seasons, US76's table"),
]
FIXED = ("nominal", "ampi", "quadratic")
CORRECTED = {"bank": "corrected by bank", "bank_and_angle": "by bank and α"}
SECTION = "roads"
NEAR = 1e3  # m: a flight that ends farther away is asked whether its target was in reach
CYCLE = 0.1  # s


@dataclass(frozen=True)
class Row:
    """One road in one world."""

    place: str
    road: str
    numbers: dict[str, Any]


def rows(folder: Path, n: int, seed: int, worlds: list[str]) -> Iterator[Row]:
    """Every road in every world, as they are flown."""
    for world, name, title in PLACES:
        if worlds and world not in worlds:
            continue
        mission, path = ampi.load_mission(name), folder / f"{name}.h5"
        folder.mkdir(exist_ok=True)
        database.build(mission, path, n_jobs=JOBS)
        roads = {mode: ampi.load_guidance(path, mode=mode, cycle=CYCLE) for mode in FIXED}
        for how, label in CORRECTED.items():
            roads[label] = ampi.load_guidance(path, correction=how, cycle=CYCLE)
        for road, guidance in roads.items():
            began = time.perf_counter()
            flights = ampi.fly(mission, guidance, world, n, seed=seed, n_jobs=JOBS, cycle=CYCLE)
            passed = time.perf_counter() - began
            numbers = measured(flights) | on_board(guidance)
            numbers |= out_of_reach(mission, guidance, world, flights, seed)
            numbers["ms_per_flight_and_core"] = 1e3 * passed * JOBS / n
            yield Row(title, road, numbers)


def measured(flights: ampi.Flights) -> dict[str, Any]:
    """Of one campaign."""
    miss = np.where(flights.reached, flights.miss, np.inf)
    altitude = np.where(flights.reached, np.abs(flights.altitude_error), np.inf)
    peaks = flights.peak[:, :3].max(axis=1)  # dynamic pressure, heat flux, load factor
    counts = flights.corrections.sum(axis=0)
    return {
        "flights": flights.n,
        "within": {f"{radius:g}": float(np.mean(miss < radius)) for radius in RADII},
        "median": float(np.median(miss)),
        "percentile_95": float(np.percentile(miss, 95)),
        "percentile_99": float(np.percentile(miss, 99)),
        "worst": float(miss.max()),
        "altitude_within_300": float(np.mean(altitude < 300.0)),
        "altitude_99": float(np.percentile(altitude, 99)),
        "limits_kept_to_2_percent": float(np.mean(peaks <= 1.02)),
        "activity_deg": float(np.degrees(flights.activity.mean())),
        "saturation": float(flights.saturation.mean()),
        "corrections": {own.name: int(c) for own, c in zip(CorrectionOutcome, counts, strict=True)},
    }


RADII = (100.0, 500.0, 1000.0, 5000.0)


def on_board(guidance: ampi.Guidance) -> dict[str, Any]:
    """Bytes that fly: the table as int16, and the model where plans are corrected."""
    own = guidance.correction
    blob = table_blob(
        guidance.table, guidance.law, guidance.limits, mode=guidance.mode, kind="int16"
    )
    return {"table_bytes": len(blob), "model_bytes": 0 if own is None else len(model_blob(own))}


def out_of_reach(
    mission: ampi.Mission, guidance: ampi.Guidance, world: str, flights: ampi.Flights, seed: int
) -> dict[str, Any]:
    """Flights that ended farther than `NEAR`: whether one who knew everything would have come nearer."""
    miss = np.where(flights.reached, flights.miss, np.inf)
    far = np.flatnonzero(~(miss < NEAR))
    own = guidance.correction
    if own is None or not len(far):
        return {"far": len(far), "out_of_reach": 0 if not len(far) else None}
    truth = ampi.load_world(world).draw(mission, flights.n, seed).take(far)
    guidance.begin(truth.parameters)
    limits = mission.limits
    authority = Authority(
        bank_angle=limits.bank_angle,
        bank_rate=limits.bank_rate,
        angle=own.corrector.change,
        angle_rate=own.corrector.change_rate,
    )
    plant = plant_of(mission.family(truth.parameters), guidance, truth)
    missed = nearest_misses(plant, authority, np.zeros(len(far)))
    nearest = np.hypot(missed[0], missed[1])
    gone = ~(nearest < NEAR)
    in_reach = np.setdiff1d(np.arange(flights.n), far[gone])
    return {
        "far": len(far),
        "out_of_reach": int(gone.sum()),
        "within_of_those_in_reach": {
            f"{radius:g}": float(np.mean(miss[in_reach] < radius)) for radius in RADII
        },
        "farther_than_the_nearest_found_by_km": [
            round(float(d), 2) for d in np.sort((miss[far] - nearest) / 1e3)[-5:]
        ],
    }


def table(found: list[Row]) -> str:
    """As Markdown."""
    lines = [
        "| world | road | flights | within 100 m | 500 m | 1 km | 5 km | median | 99 % | "
        "altitude, 99 % | limits kept (2 %) | bank activity | ms a flight |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in found:
        own = row.numbers
        shares = " | ".join(f"{100 * share:.1f} %" for share in own["within"].values())
        lines.append(
            f"| {row.place} | {row.road} | {own['flights']} | {shares} | {metres(own['median'])} | "
            f"{metres(own['percentile_99'])} | {metres(own['altitude_99'])} | "
            f"{100 * own['limits_kept_to_2_percent']:.1f} % | {own['activity_deg']:.0f}° | "
            f"{own['ms_per_flight_and_core']:.0f} |"
        )
    return "\n".join([*lines, "", *reach_lines(found)])


def reach_lines(found: list[Row]) -> list[str]:
    """What is said of flights that ended far from their targets, a line a road."""
    lines = []
    for row in found:
        own = row.numbers
        if own.get("out_of_reach"):
            within = [100 * own["within_of_those_in_reach"][radius] for radius in ("1000", "5000")]
            lines.append(
                f"- {row.place}, {row.road}: of {own['far']} flights beyond 1 km "
                f"{own['out_of_reach']} had their target out of physical reach; of all others "
                f"{within[0]:.1f} % end within 1 km, {within[1]:.1f} % within 5 km."
            )
    return lines


def metres(value: float) -> str:
    """A length in m or km."""
    return f"{value:.0f} m" if value < 1e3 else f"{value / 1e3:.1f} km"


def main() -> None:
    """Fly all of them, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2016)
    parser.add_argument("--worlds", nargs="*", default=[])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path, help="replace the table in this file")
    asked = parser.parse_args()
    found = []
    for row in rows(asked.folder, asked.flights, asked.seed, asked.worlds):
        found.append(row)
        print(table([row]).splitlines()[2], flush=True)
        if asked.json:
            told = [vars(own) for own in found]
            asked.json.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")
    print(table(found))
    if asked.page:
        write_section(asked.page, SECTION, table(found))


if __name__ == "__main__":
    main()
