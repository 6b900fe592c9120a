"""Draw what corrections in flight do, for the docs.

python scripts/draw_corrections.py FOLDER [--flights 140] [--case 0] [--docs docs]

One flight with every plan that it flew, its estimates against the truth, the ends of flights by four
roads on one map, and misses against the time to go, all in the world `everything`. The database of
SHEFEX-3 is read from FOLDER, or built into it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.figure import Figure

import ampi
import database
from ampi.dataset import read_dataset
from ampi.missions.mission import Mission
from ampi.report.figures.correction import corrections_figure, time_to_go_figure
from ampi.report.figures.estimates import estimates_figure
from ampi.report.figures.road_ends import road_ends
from ampi.report.figures.style import save_figure
from ampi.simulation.correction_log import fly_logged
from ampi.simulation.flights import Flights
from ampi.simulation.monte_carlo import Scheme
from ampi.simulation.predicted_misses import predicted_misses

MISSION, WORLD = "shefex3", "everything"
MADE_BY = "scripts/draw_corrections.py"
ROADS = {  # mode and correction
    "nominal reference, tracked": ("nominal", "none"),
    "AMPI's reference, tracked": ("ampi", "none"),
    "corrected by bank angle": ("ampi", "bank"),
    "corrected by bank angle and angle of attack": ("ampi", "bank_and_angle"),
}


def mission_and_database(folder: Path) -> tuple[Mission, Path]:
    """As it was built, or is now."""
    path = folder / f"{MISSION}.h5"
    if not path.exists():
        folder.mkdir(exist_ok=True)
        database.build(ampi.load_mission(MISSION), path)
    return read_dataset(path).mission, path


def flown_by_roads(mission: Mission, path: Path, n: int) -> dict[str, Flights]:
    """The same draws by each."""
    return {
        road: ampi.fly(
            mission, ampi.load_guidance(path, mode=mode, correction=how), WORLD, n, n_jobs=1
        )
        for road, (mode, how) in ROADS.items()
    }


def figures(folder: Path, case: int, n: int) -> dict[str, Figure]:
    """All four, by their names."""
    mission, path = mission_and_database(folder)
    scheme = Scheme(ampi.load_guidance(path, correction="bank_and_angle"), WORLD)
    log = fly_logged(mission, scheme, case)
    return {
        "flight": corrections_figure(mission, log, f"flight {case}, {WORLD}"),
        "estimates": estimates_figure(log.estimates),
        "time_to_go": time_to_go_figure(predicted_misses(mission, scheme, n)),
        "roads": road_ends(flown_by_roads(mission, path, n)),
    }


def main() -> None:
    """Draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--flights", type=int, default=140)
    parser.add_argument("--case", type=int, default=0)
    parser.add_argument("--docs", type=Path, default=Path(__file__).parents[1] / "docs")
    asked = parser.parse_args()
    for name, figure in figures(asked.folder, asked.case, asked.flights).items():
        path = asked.docs / f"corrections_{name}.png"
        save_figure(path, figure, MADE_BY)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
