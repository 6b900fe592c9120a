"""Check certificates of references against flights: random entries of a database, inside and outside.

python scripts/check_certificate.py demo/shefex3.h5                        print
python scripts/check_certificate.py demo/shefex3.h5 --figure checked.png   and draw
python scripts/check_certificate.py demo/shefex3.h5 --json                 print the numbers
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

import ampi
from ampi.dataset import read_dataset
from ampi.onboard.certificate import Verdict
from ampi.report.figures.certificates import certificate_figure
from ampi.report.figures.style import save_figure
from ampi.simulation.certificate_truth import (
    CheckedCertificates,
    check_certificates,
    random_entries,
)

QUANTILES = (0.5, 0.9, 0.99, 1.0)


def numbers(checked: CheckedCertificates) -> dict[str, Any]:
    """What is printed of one mode."""
    shares = {"all": np.ones_like(checked.inside), "inside": checked.inside}
    shares["outside"] = ~checked.inside
    return {
        "entries": len(checked.flown),
        "rank_correlation": checked.rank_correlation,
        "defect_rank_correlation": checked.defect_correlation,
        "right_verdicts": checked.right,
        "one_certificate_ms": 1e3 * checked.seconds,
        "verdicts": {v.name: int(np.sum(checked.verdict == v)) for v in Verdict},
        "least_margins": dict(
            zip(checked.certificate.limits, checked.certificate.margins.min(axis=0), strict=True)
        ),
        "quantiles": {
            name: {
                f"{q:g}": {
                    "flown_m": np.quantile(checked.flown[chosen], q),
                    "error_m": np.quantile(checked.error[chosen], q),
                    "relative_error": np.quantile(checked.relative_error[chosen], q),
                }
                for q in QUANTILES
            }
            for name, chosen in shares.items()
            if chosen.any()
        },
    }


def told(mode: str, found: dict[str, Any]) -> str:
    """The same for people."""
    verdicts = ", ".join(f"{count} {name}" for name, count in found["verdicts"].items() if count)
    lines = [
        f"{mode}: {found['entries']} entries, rank correlation {found['rank_correlation']:.5f} "
        f"(inside, by the defect at the nodes alone: {found['defect_rank_correlation']:.2f}), "
        f"{100 * found['right_verdicts']:.1f} % of the verdicts right ({verdicts}), "
        f"{found['one_certificate_ms']:.1f} ms a certificate",
        "  flown miss, error (m) and error over the miss:",
    ]
    for name, quantiles in found["quantiles"].items():
        cells = [
            f"{100 * float(q):g} %: {own['flown_m']:.0f}, {own['error_m']:.2f}, "
            f"{own['relative_error']:.1e}"
            for q, own in quantiles.items()
        ]
        lines.append(f"  {name:8}" + "   ".join(cells))
    return "\n".join(lines)


def main() -> None:
    """Parse, check, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("database", type=Path)
    parser.add_argument("--entries", type=int, default=500, help="per mode, half of them inside")
    parser.add_argument("--modes", nargs="+", default=["ampi", "quadratic"])
    parser.add_argument("--seed", type=int, default=17)
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.add_argument("--figure", type=Path, help="draw predicted against flown misses")
    arguments = parser.parse_args()
    mission = read_dataset(arguments.database).mission
    entries = random_entries(mission, arguments.entries, arguments.seed)
    checked = {}
    for name in arguments.modes:
        guidance = ampi.load_guidance(arguments.database, mode=name)
        checked[guidance.mode] = check_certificates(mission, guidance, entries)
    found = {mode.value: numbers(own) for mode, own in checked.items()}
    if arguments.json:
        print(json.dumps(found, indent=1, default=float))
    else:
        print("\n".join(told(mode, own) for mode, own in found.items()))
    if arguments.figure:
        made_by = f"scripts/check_certificate.py --entries {arguments.entries}"
        save_figure(arguments.figure, certificate_figure(checked), made_by)


if __name__ == "__main__":
    main()
