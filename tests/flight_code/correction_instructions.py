"""Instructions of an update of the estimator and of a step of a prediction:
`python -m tests.flight_code.correction_instructions PROGRAM MODEL…` of correction_instructions.c.

Those of the core may differ by 2 % over the inputs; with those of the library none may exceed the bound
of the interface document.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from ampi.export.c_correction import correction_bounds
from tests.flight_code.instructions import counts

MOST = 1.02  # max/min of the core's instructions
STEPS = 50  # of two predictions


def main(program: str, *models: str) -> int:
    """A line for people, a line of JSON; 1 if something takes more than it may."""
    figures, right = {}, True
    for path in models:
        update, step, _ = correction_bounds(Path(path).read_bytes())
        for what, bound, n in (("update", update, 1), ("steps", step, STEPS)):
            pairs = counts(program, path, what)
            core, whole = [c for c, _ in pairs], max(c + library for c, library in pairs) / n
            ratio = max(core) / min(core)
            right &= whole <= bound and ratio <= MOST
            figures[f"{what} of {Path(path).stem}"] = {
                "greatest": whole, "bound": bound, "ratio": ratio,
            }  # fmt: skip
    told = ", ".join(f"{what} {of['greatest']:,.0f}" for what, of in figures.items())
    print(f"with the library at the most: {told}")
    print(json.dumps(figures))
    return int(not right)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
