"""How long one correction takes, in flight, on one core: compiled, and in numpy.

python scripts/benchmark_corrections.py DATABASE.h5 [--flights 20] [--json corrections.json]

Flights of the `everything` world are flown one by one by `Guidance.step`, and every call in which a plan
is corrected is timed, the rest of the cycle included; in numpy once alone and once 64 abreast.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

import ampi
from ampi.guidance import NATIVE, NUMPY
from ampi.simulation.closed_loop import fly_batch

CYCLE = 0.1  # s
ABREAST = 64


class Timed:
    """A guidance whose steps are timed."""

    def __init__(self, guidance: ampi.Guidance) -> None:
        self._own = guidance
        self.milliseconds: list[float] = []  # of each correction
        self.propagations: list[float] = []
        self._counted = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._own, name)

    def step(self, *told: Any) -> Any:
        """As `Guidance.step`."""
        began = time.process_time()
        command = self._own.step(*told)
        passed = time.process_time() - began
        state = self._own.correction_state
        corrected = int(state.counts.sum()) - self._counted
        if corrected > 0:
            self._counted += corrected
            self.milliseconds += [1e3 * passed / corrected] * corrected
            self.propagations.append(float(state.propagations.mean()))
        return command


def timed(path: Path, engine: str, n: int, abreast: int) -> dict[str, float]:
    """n flights, `abreast` at a time."""
    guidance = ampi.load_guidance(path, correction="bank_and_angle", engine=engine, cycle=CYCLE)
    mission, world = ampi.load_mission("shefex3"), ampi.load_world("everything")
    taken, propagated = [], []
    for first in range(0, n, abreast):
        truth = world.draw(mission, abreast, 1, "tuning", first)
        own = Timed(guidance)
        fly_batch(mission.family(truth.parameters), own, truth)  # type: ignore[arg-type]
        taken += own.milliseconds
        propagated += own.propagations
    told = np.array(taken)
    return {
        "flights": n,
        "abreast": abreast,
        "corrections": len(told),
        "median_ms": float(np.median(told)),
        "percentile_99_ms": float(np.percentile(told, 99)),
        "percentile_99.9_ms": float(np.percentile(told, 99.9)),
        "worst_ms": float(told.max()),
        "propagations_median": float(np.median(propagated)),
    }


def main() -> None:
    """Time them, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("database", type=Path)
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    found = {
        "compiled": timed(asked.database, NATIVE, asked.flights, 1),
        "numpy, alone": timed(asked.database, NUMPY, 1, 1),
        f"numpy, {ABREAST} abreast": timed(asked.database, NUMPY, ABREAST, ABREAST),
    }
    for name, own in found.items():
        print(
            f"{name:18} {own['corrections']:6} corrections: median {own['median_ms']:.2f} ms, 99 % "
            f"{own['percentile_99_ms']:.2f}, 99.9 % {own['percentile_99.9_ms']:.2f}, worst "
            f"{own['worst_ms']:.2f}; {own['propagations_median']:.0f} flights predicted (median)"
        )
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
