"""Flights on a table that is re-selected in flight, the factors known and estimated.

python scripts/check_reselection.py DATABASE [--worlds everything …] [--flights 100] [--json FILE]

DATABASE has axes of density and lift: `ampi build shefex3_air DATABASE`.
"""

from __future__ import annotations

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import ampi
from ampi.export.blob import table_blob
from ampi.reselection.optimum_field import MatchWeights, OptimumField
from ampi.reselection.reselecting import Reselection
from ampi.reselection.settings import ReselectionSettings
from ampi.reselection_loading import load_reselecting
from ampi.simulation.reselected_flights import ReselectedFlights, fly_reselecting

AT_ONCE = 50
WORLDS = ("entry", "hexeract", "everything")
KINDS = ("float64", "float32", "int16")


def measured(mission: ampi.Mission, parts: list[ReselectedFlights]) -> dict[str, Any]:
    """Of one row."""
    final = np.concatenate([part.batch.final_states for part in parts])
    radius, target = mission.flight_model.planet.equatorial_radius, mission.target
    east = radius * np.cos(target.latitude) * (final[:, 1] - target.longitude)
    miss = np.hypot(east, radius * (final[:, 2] - target.latitude))
    altitude = np.abs(final[:, 0] - target.altitude)
    counts = np.concatenate([part.outcomes for part in parts]).sum(axis=0)
    saturation = np.concatenate([part.batch.saturation for part in parts])
    return {
        "flights": len(miss),
        "within": {f"{r:g}": float(np.mean(miss < r)) for r in (100.0, 500.0, 1000.0, 5000.0)},
        "median": float(np.median(miss)),
        "percentile_99": float(np.percentile(miss, 99)),
        "altitude_99": float(np.percentile(altitude, 99)),
        "saturation": float(saturation.mean()),
        "outcomes": {own.name: int(c) for own, c in zip(Reselection, counts, strict=True)},
    }


def costs(path: Path, mission: ampi.Mission, mode: str) -> dict[str, Any]:
    """Bytes of the table, and how long a re-selection takes (ms, one flight, median of 50)."""
    road = load_reselecting(path, mission, mode=mode)
    table, times = road.table, []
    guidance = ampi.load_guidance(path, mode=mode, holes="fly")
    sizes = {
        kind: len(table_blob(table, road.law, guidance.limits, mode=guidance.mode, kind=kind))
        for kind in KINDS
    }
    field = OptimumField(table, (road.plan.density, road.plan.lift))
    p = np.array([a[i] for a, i in zip(table.axes, table.centre, strict=True)])
    scale = np.array([500.0, 4e-4, 2e-4, 20.0, 3e-3, 3e-3])
    state = table.values[table.centre][:6, [table.segments.n_nodes // 2]]
    for _ in range(50):
        began = time.perf_counter()
        found = field.matched(300.0, state, p[None], MatchWeights(scale, 0.3, 4))
        guidance.follow(guidance.reference(found[0]))
        times.append(1e3 * (time.perf_counter() - began))
    solved = table.solved
    holes = 0 if solved is None else int(np.count_nonzero(~solved))
    cases = table.final_time.size
    return {
        "bytes": sizes,
        "reselection_ms": float(np.median(times)),
        "cases": cases,
        "holes": holes,
    }


def settings_of(given: list[str]) -> ReselectionSettings:
    """Defaults with NAME=VALUE."""
    types = {field.name: type(field.default) for field in fields(ReselectionSettings)}
    asked = dict(one.split("=", 1) for one in given)
    return replace(ReselectionSettings(), **{k: types[k](float(v)) for k, v in asked.items()})


def main() -> None:
    """Read the command line and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("database", type=Path)
    parser.add_argument("--worlds", nargs="+", default=WORLDS)
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--pool", choices=("reported", "tuning"), default="reported")
    parser.add_argument("--mode", default="ampi")
    parser.add_argument("--air", nargs="+", choices=("known", "estimated"), default=["estimated"])
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    mission, settings = ampi.load_mission("shefex3"), settings_of(given.set)
    found: dict[str, Any] = {"on_board": costs(given.database, mission, given.mode), "rows": []}
    print(found["on_board"], flush=True)
    firsts = range(0, given.flights, AT_ONCE)
    for name in given.worlds:
        for air in given.air:
            began, world = time.perf_counter(), ampi.load_world(name)
            fly = partial(
                fly_part, mission, given.database, world, given.flights, given.seed, given.pool
            )
            fly = partial(fly, given.mode, air == "known", settings)
            with ProcessPoolExecutor(2) as pool:
                row = measured(mission, list(pool.map(fly, firsts)))
            row |= {"world": name, "air": air, "s": time.perf_counter() - began}
            found["rows"].append(row)
            print(json.dumps(row), flush=True)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def fly_part(
    mission: ampi.Mission,
    path: Path,
    world: Any,
    n: int,
    seed: int,
    pool: str,
    mode: str,
    known: bool,
    settings: ReselectionSettings,
    first: int,
) -> ReselectedFlights:
    """Flights from `first` on, in one process."""
    count = min(AT_ONCE, n - first)
    options: dict[str, Any] = {"seed": seed, "pool": pool, "first": first, "mode": mode}
    return fly_reselecting(mission, path, world, count, known=known, settings=settings, **options)


if __name__ == "__main__":
    main()
