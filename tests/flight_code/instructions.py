"""Instruction counts: `python -m tests.flight_code.instructions PROGRAM BLOB…` of instructions.c.

Callgrind counts each call of `measured` by itself. Those of the core may differ by 1 % over all inputs;
those of the mathematical library (exp, sin, acos, …) are the library's and are told beside. None may
exceed the bound that the interface document states.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from ampi.export.instruction_bounds import InstructionBounds

IDLE = 1.25  # times a count: a bound above says nothing
MOST = 1.01  # max/min of the core's instructions over the inputs


def counts(program: str, blob: str, what: str) -> list[tuple[int, int]]:
    """Instructions of (core, libraries) for each input."""
    with tempfile.TemporaryDirectory() as folder:
        tool = ["valgrind", "--tool=callgrind", "--compress-strings=no", "--compress-pos=no"]
        tool += ["--toggle-collect=measured", "--dump-after=measured"]
        tool += [f"--callgrind-out-file={folder}/out", program, blob, what]
        subprocess.run(tool, check=True, capture_output=True)
        dumps = sorted(Path(folder).glob("out.*"), key=lambda path: int(path.suffix[1:]))
        told = [_of_objects(path.read_text(), Path(program).name) for path in dumps]
    return [each for each in told if sum(each) > 0]


def _of_objects(dump: str, program: str) -> tuple[int, int]:
    core = library = 0
    is_core, is_callee = False, False
    for line in dump.splitlines():
        if line.startswith("ob="):
            is_core = line.endswith(program)
        elif line.startswith("calls="):
            is_callee = True  # the next line is what was called, counted where it is
        elif line[:1].isdigit():
            cost = 0 if is_callee else int(line.split()[1])
            core, library = core + cost * is_core, library + cost * (not is_core)
            is_callee = False
    return core, library


def main(program: str, *blobs: str) -> int:
    """A line for people, a line of JSON; 1 if something varies more than it may."""
    figures: dict[str, dict[str, Any]] = {}
    right = True
    for blob in blobs:
        bounds = InstructionBounds.of(Path(blob).read_bytes())
        for what in ("reference", "step"):
            pairs = counts(program, blob, what)
            core, whole = [c for c, _ in pairs], [c + library for c, library in pairs]
            bound = getattr(bounds, what)
            right &= max(core) <= bound <= IDLE * max(core)
            figures[f"{what} of {Path(blob).stem}"] = {
                "inputs": len(pairs),
                "least": min(core),
                "greatest": max(core),
                "bound": bound,
                "ratio": max(core) / min(core),
                "with_library": [min(whole), max(whole)],
            }
    worst = max(figure["ratio"] for figure in figures.values())
    told = ", ".join(f"{what} {figure['greatest']:,}" for what, figure in figures.items())
    print(f"max/min {worst:.4f} over {len(pairs)} inputs each: {told}")
    print(json.dumps({"checked": True, "worst_ratio": worst, **figures}))
    return int(worst > MOST or not right)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
