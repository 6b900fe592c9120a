"""Build a trajectory database: the public API in a campaign script.

python scripts/build_database.py shefex3 shefex3.h5 --jobs 2
"""

from __future__ import annotations

import argparse

import ampi
import database
from ampi.cli.progress import progress
from database.plan.grid import Grid


def main() -> None:
    """Parse, build, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mission", help="name of a shipped mission, or a .toml file")
    parser.add_argument("path", help="HDF5 file to write")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    arguments = parser.parse_args()
    mission = ampi.load_mission(arguments.mission)
    with progress("solving", Grid.from_mission(mission).size) as advance:
        report = database.build(mission, arguments.path, n_jobs=arguments.jobs, advance=advance)
    for name, value in vars(report).items():
        print(f"{name:22} {value}")


if __name__ == "__main__":
    main()
