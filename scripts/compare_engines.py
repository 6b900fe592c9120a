"""Fly the same draws by the native engine and by numpy, in every shipped world: how far do they differ?

python scripts/compare_engines.py FILE.h5                 300 flights a world, printed
python scripts/compare_engines.py FILE.h5 --flights 1000 --law drag_sliding_mode --json
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

import ampi
from ampi.cli.progress import progress
from ampi.dataset import read_dataset
from ampi.loading import LAWS

WORLDS = ("entry", "hexeract", "everything", "arctic", "arctic_january")
ENGINES = ("native", "numpy")


def compared(path: Path, world: str, law: str, n: int, jobs: int) -> dict[str, Any]:
    """Greatest differences over all flights, and whether what is counted is the same."""
    mission, guidance = read_dataset(path).mission, ampi.load_guidance(path, law=law)
    flown, seconds = {}, {}
    with progress(f"flying {world}", 2 * n) as advance:
        for engine in ENGINES:
            began = time.perf_counter()
            flown[engine] = ampi.fly(
                mission, guidance, world, n, engine=engine, n_jobs=jobs, advance=advance
            )
            seconds[engine] = time.perf_counter() - began
    one, other = (flown[engine] for engine in ENGINES)
    radius = mission.flight_model.planet.equatorial_radius
    off = np.abs(one.final_states - other.final_states)
    metres = np.max([off[:, 0], radius * off[:, 1], radius * off[:, 2]], axis=0)
    return {
        "flights": n,
        "greatest_difference_m": float(np.nanmax(metres)),
        "greatest_difference_m_per_s": float(np.nanmax(off[:, 3])),
        "same_bits": bool(one.final_states.tobytes() == other.final_states.tobytes()),
        "same_status": bool(np.array_equal(one.status, other.status)),
        "same_saturation": bool(np.array_equal(one.saturation, other.saturation)),
        "seconds": seconds,
    }


def main() -> None:
    """Parse, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path, help="trajectory database")
    parser.add_argument("--flights", type=int, default=300, help="per world")
    parser.add_argument("--law", choices=list(LAWS), default="linear_quadratic")
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    arguments = parser.parse_args()
    found = {
        world: compared(arguments.path, world, arguments.law, arguments.flights, arguments.jobs)
        for world in arguments.worlds
    }
    if arguments.json:
        print(json.dumps(found, indent=1))
        return
    for world, one in found.items():
        native, numpy = (one["seconds"][engine] for engine in ENGINES)
        print(
            f"{world}: {one['flights']} flights end within {one['greatest_difference_m']:.1g} m and "
            f"{one['greatest_difference_m_per_s']:.1g} m/s of each other"
            f"{', to the bit' if one['same_bits'] else ''}; status "
            f"{'the same' if one['same_status'] else 'DIFFERS'}; {native:.1f} s against {numpy:.1f} s"
        )


if __name__ == "__main__":
    main()
