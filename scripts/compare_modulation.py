"""What the angle of attack buys: every law by bank alone, and with it, on the same draws: one table.

python scripts/compare_modulation.py FOLDER [--flights 300] [--pool reported] [--page docs/results.md]

The database is built into FOLDER, if it is not there; flights are kept: a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from page_section import write_section

import ampi
import database
from ampi.simulation.estimates.paired import ShareDifference

MISSION = "shefex3"
WORLDS = ("everything", "arctic_january", "hexeract", "entry")  # the wrong ones first
LAWS = ("linear_quadratic", "drag_sliding_mode", "drag_shuttle")
MODES = ("nominal", "ampi")
NEAR, FAR = 1e3, 5e3  # m
KEPT = 1.02  # of a limit of the path
JOBS = 2
SECTION = "modulation"
HEAD = (
    "world, law, reference",
    "within 1 km: bank alone",
    "and α",
    "within 5 km: bank alone",
    "and α",
    "difference [95 %]",
    "p",
    "median: bank alone",
    "and α",
    "99 %: bank alone",
    "and α",
    "limits kept: bank alone",
    "and α",
    "bank activity: bank alone",
    "and α",
)


def pairs(folder: Path, n: int, pool: str) -> Iterator[tuple[str, ampi.Flights, ampi.Flights]]:
    """Campaigns by bank alone and with the angle of attack, as they are flown."""
    mission, path = ampi.load_mission(MISSION), folder / f"{MISSION}.h5"
    folder.mkdir(exist_ok=True)
    if not path.exists():
        database.build(mission, path, n_jobs=JOBS)
    for world in WORLDS:
        for law in LAWS:
            guides = [ampi.load_guidance(path, law=law, modulate=own) for own in (False, True)]
            schemes = {
                f"{mode} {own}": ampi.Scheme(guide.in_mode(mode), world)
                for mode in MODES
                for own, guide in enumerate(guides)
            }
            output = folder / f"modulation_{world}_{law}_{pool}.h5"
            flown = ampi.fly_schemes(mission, schemes, n, output=output, n_jobs=JOBS, pool=pool)
            for mode in MODES:
                yield f"{world}, {law}, {mode}", flown[f"{mode} 0"], flown[f"{mode} 1"]


def row(name: str, alone: ampi.Flights, steered: ampi.Flights) -> str:
    """One line of the table."""
    both = (alone, steered)
    misses = [np.where(own.reached, own.miss, np.inf) for own in both]
    within = ampi.compare(steered, alone, (NEAR, FAR)).within
    peaks = [own.peak[:, :3].max(axis=1) for own in both]  # of the three loads
    far: ShareDifference = within[FAR]
    found = far.difference
    cells = [
        *(percent(np.mean(miss < NEAR)) for miss in misses),
        *(percent(np.mean(miss < FAR)) for miss in misses),
        f"{100 * found.value:+.0f} [{100 * found.low:.0f}, {100 * found.high:.0f}]",
        f"{far.p_value:.1g}",
        *(kilometres(np.median(miss)) for miss in misses),
        *(kilometres(np.percentile(miss, 99)) for miss in misses),
        *(percent(np.mean(peak <= KEPT)) for peak in peaks),
        *(f"{np.degrees(own.activity.mean()):.0f}°" for own in both),
    ]
    return f"| {name} | {' | '.join(cells)} |"


def percent(share: float) -> str:
    """A share."""
    return f"{100 * share:.0f} %"


def kilometres(length: float) -> str:
    """A length (m)."""
    return f"{length / 1e3:.2f} km" if length < 1e4 else f"{length / 1e3:.0f} km"


def main() -> None:
    """Fly all of them, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--flights", type=int, default=300, help="of each scheme")
    parser.add_argument("--pool", default="reported")
    parser.add_argument("--page", type=Path, help="replace the table in this file")
    asked = parser.parse_args()
    lines = [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
    for name, alone, steered in pairs(asked.folder, asked.flights, asked.pool):
        lines.append(row(name, alone, steered))
        print(lines[-1], flush=True)
    text = "\n".join(
        [
            f"{asked.flights} flights a row at 10 Hz, the same draws in a world; the difference is "
            "that of flights within 5 km in percentage points, by pairs (Newcombe), p by McNemar's "
            "exact test:",
            "",
            *lines,
        ]
    )
    print(text)
    if asked.page:
        write_section(asked.page, SECTION, text)


if __name__ == "__main__":
    main()
