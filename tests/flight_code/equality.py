"""The flight code beside numpy over 10,000 parameters: `python -m tests.flight_code.equality`.

Inside, at corners, faces and grid points, outside, on another turn, and no numbers at all: cells, flags
and low-density rows to the bit, high-density rows to 1e-14 of the largest of each.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.flight_code.inputs import guidance_of
from tests.support.flight_blobs import blob_of, some_parameters
from tests.support.flight_code import FlightCode, compiled

N, MOST = 10_000, 1e-14
NAMES = ("linear", "nominal", "shuttle", "sliding")  # of float64


def main() -> int:
    """A line for people, a line of JSON; 1 if anything differs by more."""
    worst, differing = 0.0, 0
    with tempfile.TemporaryDirectory() as folder:
        code = compiled(Path(folder))
        for name in NAMES:
            guidance = guidance_of(name)
            flight, d = FlightCode(code, blob_of(guidance)), len(guidance.table.axes)
            shape = (len(guidance.table.layout), *guidance.table.conversion.shape)
            for p in some_parameters(guidance, np.random.default_rng(1), N // len(NAMES)):
                ours, told = guidance.reference(p), flight.reference(p, shape)
                same = (told.cell[:d], told.clipped[:d], told.excess[:d], told.hole, told.health) == (
                    ours.cell, ours.clipped, ours.excess, ours.hole, ours.health
                )  # fmt: skip
                same &= (
                    np.array_equal(told.nodal, ours.nodal) and told.final_time == ours.final_time
                )
                differing += not (same and np.array_equal(told.times, ours.times))
                sizes = np.abs(ours.rows).max(axis=1, keepdims=True)
                worst = max(worst, float((np.abs(told.rows - ours.rows) / sizes).max()))
    print(
        f"{N} parameters: {differing} with a cell, flag or low-density bit of their own; "
        f"high-density rows within {worst:.1e} of their largest value"
    )
    print(json.dumps({"checked": True, "parameters": N, "differing": differing, "worst": worst}))
    return int(differing > 0 or not worst <= MOST)


if __name__ == "__main__":
    sys.exit(main())
