"""Fly dispersed closed-loop entries from a database: the public API in a campaign script.

python scripts/run_monte_carlo.py shefex3.h5 --flights 1000
"""

from __future__ import annotations

import argparse

import ampi
from ampi.cli.progress import progress
from ampi.dataset import read_dataset
from ampi.report.text import verdict_text

MODES = ("nominal", "mpi", "ampi", "quadratic")


def main() -> None:
    """Parse, fly every mode on the same draws, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", help="trajectory database")
    parser.add_argument("--flights", type=int, default=1000, help="flights per mode")
    parser.add_argument("--world", default="entry", help="a shipped world, or a .toml file")
    parser.add_argument("--seed", type=int, default=2016)
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    arguments = parser.parse_args()
    mission = read_dataset(arguments.path).mission
    guidance = ampi.load_guidance(arguments.path)
    with progress("flying", arguments.flights * len(MODES)) as advance:
        flown = ampi.fly_schemes(
            mission,
            {m: ampi.Scheme(guidance.in_mode(m), arguments.world) for m in MODES},
            arguments.flights,
            seed=arguments.seed,
            n_jobs=arguments.jobs,
            advance=advance,
        )
    print(verdict_text(mission, flown))


if __name__ == "__main__":
    main()
