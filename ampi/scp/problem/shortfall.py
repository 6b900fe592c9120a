"""The verdict on a flight in words, with what it leaves open: limits exceeded, target missed."""

from __future__ import annotations

import numpy as np

from ampi.missions.final_states import ANGLE_TOLERANCE, HORIZONTAL_TOLERANCE, TargetMiss
from ampi.missions.mission import Mission
from ampi.missions.path_limits import KEPT, LimitKind, PathLimits
from ampi.trajectory import POSITION_TOLERANCE, FlightCheck, Status, Trajectory


def outcome_sentence(mission: Mission, trajectory: Trajectory) -> str:
    """The status's sentence, and for a flight that is not a solution what is open about it."""
    status, flight = trajectory.status, trajectory.statistics.flight
    sentences, phrases = [status.sentence], [] if status.ok else shortfall(mission, trajectory)
    if phrases:
        sentences.append(f"Open: {'; '.join(phrases)}.")
    if flight is not None:
        sentences.append(_flown(flight, doubted=status is Status.INACCURATE))
    return " ".join(sentences)


def _flown(flight: FlightCheck, *, doubted: bool) -> str:
    """What the flight found, and what may help where it is not the optimum."""
    if not np.isfinite(flight.position_error):
        return "Its flight cannot be integrated; refine the mesh (ampi solve --refine)."
    name = max(flight.use, key=lambda limit: flight.use[limit])
    found = (
        f"Flown again, it lies at most {_short(flight.position_error)} m from its nodes and uses "
        f"{_percent(flight.use[name])} % of {name}"
    )
    if not doubted:
        return f"{found}, its nearest limit."
    ways = ["ampi solve --refine"]
    if list(flight.exceeded) == ["bank_rate"] and flight.position_error <= POSITION_TOLERANCE:
        ways = []  # beside a switch a polynomial overshoots on any mesh
    own = (limit for limit in flight.exceeded if not limit.startswith("angle_of_attack"))
    ways += [f"[limits] {limit.partition(' ')[0]}_margin" for limit in own]
    tolerances = f"{POSITION_TOLERANCE:g} m and {100.0 * (1.0 + KEPT):g} % are tolerated"
    return f"{found}, where {tolerances}; try: {', '.join(ways)}."


def shortfall(mission: Mission, trajectory: Trajectory) -> list[str]:
    """One phrase for each limit exceeded at the nodes and each final state that is off.

    Empty for a flight that leaves nothing open, and where there is no flight (NaN).
    """
    if not np.all(np.isfinite(trajectory.states)):
        return []
    return [*_exceeded(mission, trajectory), *_missed(mission, trajectory)]


def _exceeded(mission: Mission, trajectory: Trajectory) -> list[str]:
    limits = PathLimits.of(mission)
    rate, times = trajectory.bank_rate, trajectory.times
    found = []
    with np.errstate(invalid="ignore"):  # at a negative speed there is no heat flux
        uses = limits.use(mission.flight_model, trajectory.states, rate, times)
    for (name, kind), use in zip(limits.kinds.items(), uses, strict=True):
        excess = float(np.max(use)) - 1.0
        if not excess > KEPT:
            continue
        if kind is LimitKind.NO_FLY_ZONE:  # g = 2 − share², but for the sphere's curvature
            share = np.sqrt(max(0.0, 1.0 - excess))
            found.append(f"{name} is entered, as near to its centre as {share:.2f} of its radius")
        elif kind is LimitKind.DRAG_FLOOR:
            found.append(f"drag is {_short(100.0 * excess)} % below the drag_floor")
        else:
            found.append(f"{name} is {_short(100.0 * excess)} % above its limit")
    return found


def _missed(mission: Mission, trajectory: Trajectory) -> list[str]:
    target, miss = mission.target, TargetMiss.of(mission, trajectory.states[:, -1])
    found, height, speed = [], miss.altitude, miss.speed
    if miss.horizontal > HORIZONTAL_TOLERANCE:
        found.append(f"the flight ends {_short(miss.horizontal / 1e3)} km from the target")
    if abs(height) > target.altitude_tolerance:
        found.append(f"{_short(abs(height) / 1e3)} km too {'high' if height > 0.0 else 'low'}")
    if abs(speed) > target.speed_tolerance:
        found.append(f"{_short(abs(speed))} m/s too {'fast' if speed > 0.0 else 'slow'}")
    for name, off in miss.angles.items():
        if off > ANGLE_TOLERANCE:
            found.append(f"the final {name} is {_short(float(np.degrees(off)))}° off")
    return found


def _percent(share: float) -> str:
    """Four figures, and no exponent where there are more."""
    return f"{100.0 * share:,.0f}" if share >= 10.0 else f"{100.0 * share:.4g}"


def _short(value: float) -> str:
    """Three figures, and no exponent where there are more."""
    return f"{value:,.0f}" if value >= 100.0 else f"{value:.3g}"
