"""Print the tables of the optimiser papers beside ours: `ampi reproduce`, as a script.

python scripts/reproduce_papers.py [zhou2021] … [betts2010] [--skip-slow] [--json]
"""

from __future__ import annotations

import sys

from ampi.cli import app

if __name__ == "__main__":
    app(["reproduce", *sys.argv[1:]])
