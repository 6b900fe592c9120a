"""What re-planning by the optimiser is worth: its flights, its time, and the corrector beside it.

python scripts/check_replanning.py demo/shefex3.h5 polish          references before the entry, polished
python scripts/check_replanning.py demo/shefex3.h5 rolling         plans every 5 s, each from the last
python scripts/check_replanning.py demo/shefex3.h5 flights         along flights that a corrector flies
python scripts/check_replanning.py demo/shefex3.h5 states          optimiser and corrector, side by side
python scripts/check_replanning.py demo/shefex3.h5 polish --json   print the numbers

Times are those of the processor, one core: others may share the machine. The least of three is taken.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ampi
from ampi.dataset import read_dataset
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.flight_model import Factors, FlightModelData
from ampi.onboard_model import flight_model_of
from ampi.physics.state import BANK, SPEED
from ampi.replanning.iteration import ReplanSettings
from ampi.replanning.outcome import Replan
from ampi.simulation.certificate_truth import TOGETHER, flown_miss, random_entries
from ampi.simulation.replan_truth import compared_states, planned, told_states
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

REPEATS = 3
# rolling: true factors of density, lift and drag (σ), how an estimate wanders about them, navigation
DRAWN, WANDERS = np.array([0.03, 0.01, 0.01]), np.array([0.003, 0.001, 0.001])
NOISE = np.array([33.0, 5e-6, 5e-6, 0.17, 1.2e-4, 1.2e-4, 1.2e-4, 0.0])  # m, rad, m/s, rad/s
START, PERIOD, STEPS = 40.0, 5.0, 20  # s, s, of the flight in between
LEFT = 100.0  # m/s above the target's speed: below, nothing is planned any more


def timed(*given: Any, **named: Any) -> tuple[Replan, float]:
    """A re-planning and its time on the processor (s)."""
    seconds = []
    for _ in range(REPEATS):
        began = time.process_time()
        found = ampi.replan(*given, **named)
        seconds.append(time.process_time() - began)
    return found, min(seconds)


def budget(arguments: argparse.Namespace) -> dict[str, Any]:
    """Of a re-planning."""
    settings = ReplanSettings(step=arguments.step)
    return {"iterations": arguments.iterations, "settings": settings}


def flown(family: MissionFamily[Mission], plans: Sequence[tuple[Array, float]]) -> Array:
    """Misses (n,), m, of nodal bank angles and final times where they pass the target's speed."""
    bank, final_time = np.stack([plan[0] for plan in plans]), np.array([plan[1] for plan in plans])
    starts = range(0, len(plans), TOGETHER)
    blocks = [np.arange(len(plans))[i : i + TOGETHER] for i in starts]
    parts = [flown_miss(family.take(b), bank[b], final_time[b]) for b in blocks]
    return np.asarray(np.linalg.norm(np.concatenate(parts), axis=1))


def quantiles(values: Sequence[float] | Array) -> dict[str, float]:
    """Of what is printed."""
    if len(values) == 0:
        return {}
    named = {"median": 0.5, "90 %": 0.9, "99 %": 0.99, "worst": 1.0}
    return {name: float(np.quantile(values, q, method="lower")) for name, q in named.items()}


def polish(arguments: argparse.Namespace) -> dict[str, Any]:
    """References of random entries, before and after."""
    mission = read_dataset(arguments.database).mission
    guidance = ampi.load_guidance(arguments.database, mode=arguments.mode)
    n, before, after = arguments.entries, [], []
    parameters = random_entries(mission, 2 * n, arguments.seed)
    rows: list[dict[str, Any]] = []
    for values in parameters:
        reference, own = guidance.reference(values).copy(), mission.with_parameters(values)
        given = (own, own.entry_state, reference)
        found, seconds = timed(*given, time=0.0, **budget(arguments))
        plan = found.trajectory
        before.append((reference.nodal[BANK].copy(), reference.final_time))
        after.append(before[-1] if plan is None else (plan.states[BANK], plan.final_time))
        rows.append({"seconds": seconds, "status": found.status.name})
        rows[-1]["iterations"] = found.statistics.iterations
    family = mission.family(parameters)
    misses = zip(flown(family, before), flown(family, after), strict=True)
    for row, (first, second) in zip(rows, misses, strict=True):
        row["before"], row["after"] = first, second
    return {"inside": polished(rows[:n]), "to 20 % outside": polished(rows[n:])}


def polished(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What is printed of a half of the entries."""
    column = {name: [row[name] for row in rows] for name in rows[0]}
    return {
        "entries": len(rows),
        "statuses": dict(Counter(column["status"])),
        "iterations": dict(Counter(column["iterations"])),
        "flown_miss_before_m": quantiles(column["before"]),
        "flown_miss_after_m": quantiles(column["after"]),
        "within_150_m": float(np.mean(np.array(column["after"]) < 150.0)),
        "processor_ms": quantiles(1e3 * np.array(column["seconds"])),
    }


def rolling(arguments: argparse.Namespace) -> dict[str, Any]:
    """Plans every 5 s of flights whose estimate wanders, each from the last one, in a true model."""
    mission, draw = read_dataset(arguments.database).mission, np.random.default_rng(arguments.seed)
    guidance = ampi.load_guidance(arguments.database, mode=arguments.mode)
    model, first = flight_model_of(mission), planned(mission, guidance, mission.nominal_parameters)
    rows: list[dict[str, Any]] = []
    for _ in range(arguments.flights):
        true = 1.0 + DRAWN * draw.standard_normal(len(DRAWN))
        plan, here, now = first, at_instant(first, START), START
        while here[SPEED] > mission.target.speed + LEFT:
            known = Factors(*(true * (1.0 + WANDERS * draw.standard_normal(len(DRAWN)))))
            told = here + NOISE * draw.standard_normal(len(NOISE))
            given = (mission, told, plan, known)
            found, seconds = timed(*given, time=now, **budget(arguments))
            rows.append(row_of(found, seconds) | {"first": now == START})
            plan = found.trajectory or plan
            here, now = after(model, here, plan, Factors(*true), now), now + PERIOD
    return {
        "first plans, from the reference": costs([row for row in rows if row["first"]]),
        "plans from the last ones": costs([row for row in rows if not row["first"]]),
    }


def flights(arguments: argparse.Namespace) -> dict[str, Any]:
    """States of `everything` flights that a corrector flies, the true constant factors told.

    Where the vehicle has left its reference, and the optimiser did not plan what is flown.
    """
    mission = read_dataset(arguments.database).mission
    guidance = ampi.load_guidance(arguments.database, mode=arguments.mode, correction="bank")
    truth = ampi.load_world("everything").checked(mission).draw(mission, arguments.flights, seed=1)
    reference = {k: planned(mission, guidance, p) for k, p in enumerate(truth.parameters)}
    last, rows = dict(reference), dict[str, list[dict[str, Any]]]()
    for told in told_states(mission, guidance, truth, every=30.0):
        starts = {"from the reference": reference, "from the optimiser's last plan": last}
        for name, plans in starts.items():
            given = (mission, told.state, plans[told.flight], told.estimate)
            found, seconds = timed(*given, time=told.time, **budget(arguments))
            rows.setdefault(name, []).append(row_of(found, seconds))
        last[told.flight] = found.trajectory or last[told.flight]
    return {name: costs(own) for name, own in rows.items()}


def row_of(found: Replan, seconds: float) -> dict[str, Any]:
    """What `costs` reads of a re-planning."""
    return {
        "seconds": seconds,
        "status": found.status.name,
        "iterations": found.statistics.iterations,
        "steps": found.statistics.simplified_steps,
        "miss": np.hypot(found.horizontal_miss, found.altitude_miss),
    }


def at_instant(plan: Trajectory, instant: float) -> Array:
    """State and bank rate (8,) of a plan."""
    states, rate = plan.at(min(instant, plan.final_time))
    return np.append(states[:, 0], rate)


def after(
    model: FlightModelData, here: Array, plan: Trajectory, true: Factors, now: float
) -> Array:
    """State (8,) a period later: the plan's bank rate flown in the true model, by the midpoint rule."""
    length, state = PERIOD / STEPS, here[: BANK + 1]
    rates = plan.at(np.minimum(now + length * (np.arange(STEPS) + 0.5), plan.final_time))[1]
    for k, rate in enumerate(rates):
        at = now + k * length
        middle = state + 0.5 * length * model.rates(state, rate, at, true)
        state = state + length * model.rates(middle, rate, at + 0.5 * length, true)
    return np.append(state, at_instant(plan, now + PERIOD)[-1])


def costs(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What is printed of plans."""
    column = {name: [row[name] for row in rows] for name in rows[0]}
    return {
        "plans": len(rows),
        "statuses": dict(Counter(column["status"])),
        "iterations": dict(Counter(column["iterations"])),
        "simplified_steps": dict(Counter(column["steps"])),
        "told_miss_m": quantiles(np.array([miss for miss in column["miss"] if np.isfinite(miss)])),
        "processor_ms": quantiles(1e3 * np.array(column["seconds"])),
    }


def states(arguments: argparse.Namespace) -> dict[str, Any]:
    """Where the optimiser and the corrector say that flights of a world end."""
    mission = read_dataset(arguments.database).mission
    guidance = ampi.load_guidance(arguments.database, mode=arguments.mode, correction="bank")
    truth = ampi.load_world("everything").checked(mission).draw(mission, arguments.flights, seed=1)
    rows = list(compared_states(mission, guidance, truth, arguments.states))
    own, other = (np.array([getattr(r, name) for r in rows]) for name in ("corrector", "optimiser"))
    differing = [asdict(row) for row in rows if row.verdict != "agree"]
    return {
        "everything": {
            "states": len(rows),
            "verdicts": dict(Counter(row.verdict for row in rows)),
            "solved_by": dict(Counter(row.solved_by for row in rows)),
            "corrector_miss_m": quantiles(own),
            "optimiser_miss_m": quantiles(other),
            "apart_m": quantiles(np.abs(own - other)[np.isfinite(own - other)]),
            "within_1_km": {"corrector": np.mean(own < 1e3), "optimiser": np.mean(other < 1e3)},
            "differing": {str(k): row for k, row in enumerate(differing)},
        }
    }


def main() -> None:
    """Parse, check, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("database", type=Path)
    parser.add_argument("check", choices=["polish", "rolling", "flights", "states"])
    parser.add_argument(
        "--entries", type=int, default=500, help="inside, and as many to 20 % outside"
    )
    parser.add_argument("--mode", default="ampi", help="of the references that are polished")
    parser.add_argument("--flights", type=int, default=30, help="of rolling, flights and states")
    parser.add_argument("--states", type=int, default=200, help="in all")
    parser.add_argument("--iterations", type=int, default=3)
    parser.add_argument(
        "--step", type=float, default=ReplanSettings().step, help="rad, that ends them"
    )
    parser.add_argument("--seed", type=int, default=17)
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    arguments = parser.parse_args()
    checks = {"polish": polish, "rolling": rolling, "flights": flights, "states": states}
    found = checks[arguments.check](arguments)
    if arguments.json:
        print(json.dumps(found, indent=1, default=float))
    else:
        for name, own in found.items():
            print(name, *(f"  {key}: {told(value)}" for key, value in own.items()), sep="\n")


def told(value: Any) -> str:
    """A number, or several by their names, for people."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {told(own)}" for name, own in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
