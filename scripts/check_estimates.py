"""Is the estimator consistent? Its errors against its own covariance, over flights in a world.

python scripts/check_estimates.py demo/shefex3.h5                              the world `everything`
python scripts/check_estimates.py demo/shefex3.h5 --world arctic_january       another one
python scripts/check_estimates.py demo/shefex3.h5 --pool tuning --set angle=1e-4   with other settings
python scripts/check_estimates.py demo/shefex3.h5 --json                       print the numbers
python scripts/check_estimates.py demo/shefex3.h5 --figure flight.png --flight 3   and draw a flight

The reported flights are those of the pool "reported"; settings are tuned on the pool "tuning".
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

import ampi
from ampi.dataset import read_dataset
from ampi.estimation.estimate import ESTIMATED
from ampi.estimation.settings import EstimatorSettings
from ampi.report.figures.estimates import estimates_figure
from ampi.report.figures.style import save_figure
from ampi.simulation.estimate_truth import (
    MEASURED,
    TOTALS,
    CheckedEstimates,
    check_estimates,
)

TIMES = (60.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0)  # s
FEWEST = 0.5  # of the flights: later times are left out


def numbers(checked: CheckedEstimates) -> dict[str, Any]:
    """What is printed of one world."""
    kept = checked.flying.mean(axis=1) >= FEWEST
    judged = {
        "nees_of_6": (checked.nees, len(ESTIMATED)),
        "nees_of_4_totals": (checked.total_nees, len(TOTALS)),
        "nis_of_3": (checked.nis, MEASURED),
    }
    within = checked.within()
    at_times = {}
    for instant in TIMES:
        (row,) = np.flatnonzero(np.isclose(checked.times, instant) & kept)[:1] or (None,)
        if row is not None:
            at_times[f"{instant:g}"] = at_time(checked, int(row), within[row], judged)
    return {
        "flights": checked.altitude.shape[1],
        **{name: over_time(checked, values[kept], n) for name, (values, n) in judged.items()},
        "within_3_sigma": dict(zip(TOTALS, within[kept].mean(axis=0), strict=True)),
        "least_within_3_sigma": dict(zip(TOTALS, within[kept].min(axis=0), strict=True)),
        "counts_per_flight": {name: float(c.mean()) for name, c in checked.counts.items()},
        "most_in_a_flight": {name: int(c.max()) for name, c in checked.counts.items()},
        "at": at_times,
    }


def over_time(checked: CheckedEstimates, values: np.ndarray, degrees: int) -> dict[str, Any]:
    """Of the means over the flights at each time."""
    known = np.isfinite(values)  # in the first seconds the air is too thin for any measurement
    means = np.where(known, values, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return {
        "mean": float(np.nanmean(values)),
        "greatest": float(means.max()),
        "greatest_at_s": float(checked.times[int(means.argmax())]),
        "degrees_of_freedom": degrees,
        "share_of_times_above_95": float(np.mean(means > checked.bounds(degrees)[: len(means), 1])),
    }


def at_time(
    checked: CheckedEstimates, row: int, within: np.ndarray, judged: dict[str, Any]
) -> dict[str, Any]:
    """At one time: NEES and NIS with their 95 % bounds, root mean squares of the errors."""
    flying = checked.flying[row]
    errors = {
        **dict(zip(ESTIMATED, checked.error[row], strict=True)),
        **{f"total_{n}": e for n, e in zip(TOTALS, checked.total_error[row], strict=True)},
    }
    return {
        "flights": int(flying.sum()),
        **{
            name: {
                "mean": float(np.nanmean(values[row])),
                "bounds_95": checked.bounds(degrees)[row].tolist(),
            }
            for name, (values, degrees) in judged.items()
        },
        "within_3_sigma": dict(zip(TOTALS, within, strict=True)),
        "rms": {name: float(np.sqrt(np.mean(e[flying] ** 2))) for name, e in errors.items()},
        "sigma": {
            name: float(np.mean(own[flying]))
            for name, own in zip(ESTIMATED, checked.deviation[row], strict=True)
        },
    }


def told(found: dict[str, Any]) -> str:
    """The same for people."""
    lines = [
        f"{found['flights']} flights; the truth is on the model's air at the told altitude, its noise "
        "left out",
    ]
    for name in ("nees_of_6", "nees_of_4_totals", "nis_of_3"):
        own = found[name]
        lines.append(
            f"  {name}: mean {own['mean']:.2f}, greatest {own['greatest']:.2f} at "
            f"{own['greatest_at_s']:.0f} s, above the 95 % bound at "
            f"{100 * own['share_of_times_above_95']:.0f} % of the times"
        )
    shares = (f"{n} {100 * s:.2f} %" for n, s in found["within_3_sigma"].items())
    lines.append(f"  within 3 sigma: {', '.join(shares)}")
    counts = (
        f"{name} {mean:.1f} (most {found['most_in_a_flight'][name]})"
        for name, mean in found["counts_per_flight"].items()
    )
    lines.append(f"  a flight: {', '.join(counts)}")
    lines.append(
        "  time    NEES 6 (bounds)       NEES 4 (bounds)      NIS   "
        "rms of ln k_D, ln k_L, their difference, winds (m/s), angle (deg)"
    )
    lines += [f"  {instant:>4}  {told_at(own)}" for instant, own in found["at"].items()]
    return "\n".join(lines)


def told_at(own: dict[str, Any]) -> str:
    """A line of one time."""
    cells = [
        f"{q['mean']:6.2f} ({q['bounds_95'][0]:.2f}, {q['bounds_95'][1]:.2f})"
        for q in (own["nees_of_6"], own["nees_of_4_totals"])
    ]
    rms = own["rms"]
    logarithms = [rms[n] for n in ("total_log_drag", "total_log_lift", "log_lift_to_drag")]
    return (
        f"{'  '.join(cells)}  {own['nis_of_3']['mean']:5.2f}   "
        f"{'  '.join(f'{value:.5f}' for value in logarithms)}   "
        f"{rms['wind_east']:5.1f} {rms['wind_north']:5.1f}   {np.degrees(rms['angle']):.4f}"
    )


def settings_of(changes: list[str]) -> EstimatorSettings:
    """The settings with some of them changed: `name=value`."""
    pairs = (change.partition("=") for change in changes)
    return EstimatorSettings(**{name: float(value) for name, _, value in pairs})


def main() -> None:
    """Parse, check, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("database", type=Path)
    parser.add_argument("--world", default="everything")
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2016)
    parser.add_argument("--pool", choices=("reported", "tuning"), default="reported")
    parser.add_argument("--law", default="linear_quadratic")
    parser.add_argument(
        "--set", nargs="*", default=[], metavar="NAME=VALUE", help="of the estimator"
    )
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.add_argument("--figure", type=Path, help="draw the estimates of one flight")
    parser.add_argument("--flight", type=int, default=0)
    arguments = parser.parse_args()
    mission = read_dataset(arguments.database).mission
    guidance = ampi.load_guidance(arguments.database, law=arguments.law, cycle=0.1)
    world = ampi.load_world(arguments.world)
    truth = world.draw(mission, arguments.flights, arguments.seed, arguments.pool)
    began = time.perf_counter()
    checked = check_estimates(mission, guidance, truth, settings_of(arguments.set))
    found = {"world": world.name, "pool": arguments.pool, **numbers(checked)}
    found["seconds"] = time.perf_counter() - began
    print(json.dumps(found, indent=1, default=float) if arguments.json else told(found))
    if arguments.figure:
        made_by = f"scripts/check_estimates.py --world {world.name} --flight {arguments.flight}"
        save_figure(arguments.figure, estimates_figure(checked.along(arguments.flight)), made_by)


if __name__ == "__main__":
    main()
