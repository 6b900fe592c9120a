"""Statements and branches that a run has reached: `python -m tests.flight_code.coverage GCOV.json.gz…`.

A line for people, with what was not reached, a line of JSON; 1 if it is not all.
"""

from __future__ import annotations

import gzip
import json
import sys
from collections import Counter
from pathlib import Path


def main(*paths: str) -> int:
    """Of the files of the core; a line of a header that several files compile counts once."""
    lines: Counter[str] = Counter()
    branches: Counter[str] = Counter()
    for path in paths:
        with gzip.open(path) as file:
            told = json.load(file)
        for source in told["files"]:
            name = Path(source["file"]).name
            for line in source["lines"] if name.startswith("ampi_") else []:
                at = f"{name}:{line['line_number']}"
                lines[at] += line["count"]
                for i, branch in enumerate(line["branches"]):
                    branches[f"{at}, way {i}"] += branch["count"]
    missed = [at for counts in (lines, branches) for at, n in counts.items() if n == 0]
    of = {"statements": lines, "branches": branches}
    shares = {
        what: sum(n > 0 for n in counts.values()) / len(counts) for what, counts in of.items()
    }
    each = (f"{share:.2%} of {len(of[what])} {what}" for what, share in shares.items())
    print(f"reached {' and '.join(each)} of the core", *missed)
    print(json.dumps({"checked": True, **shares, "missed": missed}))
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
