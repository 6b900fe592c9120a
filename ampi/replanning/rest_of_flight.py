"""A mission as it is left to be flown: with estimated numbers, from the present state.

What can be posed are factors of density, lift, drag and mass, and an error of the angle of attack. The
optimiser flies still air: a wind that is estimated is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.estimation.estimate import Estimate
from ampi.missions.mission import Mission
from ampi.missions.parameters import Path, at, with_numbers
from ampi.onboard.flight_model import NOMINAL, Factors
from ampi.physics.angles import on_turn_of, wrapped
from ampi.physics.planet import bearing
from ampi.physics.state import (
    ALTITUDE,
    AZIMUTH,
    BANK,
    FLIGHT_PATH_ANGLE,
    LATITUDE,
    LONGITUDE,
    SPEED,
)
from ampi.replanning.outcome import ReplanOutcome

Array = NDArray[np.float64]

SCALED = (  # a factor, and the number of the mission that it multiplies
    ("density", ("atmosphere", "density_factor")),
    ("lift", ("vehicle", "lift_factor")),
    ("drag", ("vehicle", "drag_factor")),
    ("mass", ("vehicle", "mass")),
)
ANGLES = tuple(("vehicle", "angle_of_attack", f"{end}_angle") for end in ("start", "end"))
LARGEST_FACTOR = 5.0  # no estimate within its bounds is as far from 1
LARGEST_ANGLE = 0.2  # rad
HIGHEST, FASTEST = 130e3, 12e3  # m, m/s: of a state, as of a mission's entry
LATEST = 1e5  # s since the entry interface
SLOWEST = 5.0  # s in which the polynomials of a mesh stop a bank rate
LEAST_PART = 1e-9  # of a limit, kept from a bank angle or rate that is measured on it


def known_factors(estimate: Factors | Estimate | None, altitude: float) -> Factors | None:
    """The factors at `altitude` (m) as numbers; None if they cannot be."""
    found = estimate.at(altitude) if isinstance(estimate, Estimate) else estimate or NOMINAL
    numbers = Factors(*(float(np.reshape(number, -1)[0]) for number in found))
    scaled = np.array([getattr(numbers, name) for name, _ in SCALED])
    sensible = np.all((scaled > 1.0 / LARGEST_FACTOR) & (scaled < LARGEST_FACTOR))
    return numbers if sensible and abs(numbers.angle_of_attack) < LARGEST_ANGLE else None


def estimated(mission: Mission, factors: Factors) -> Mission:
    """The mission with its numbers as they are estimated; itself where they are nominal."""
    moved: list[tuple[Path, float]] = [
        (path, at(mission, path) * getattr(factors, name))
        for name, path in SCALED
        if getattr(factors, name) != 1.0
    ]
    if factors.angle_of_attack != 0.0:
        moved += [(path, at(mission, path) + factors.angle_of_attack) for path in ANGLES]
    return with_numbers(mission, moved)


def hardness(mission: Mission, state: Array, time: float) -> ReplanOutcome | None:
    """Why nothing can be planned from a state; None if it can."""
    target = mission.target
    if not (np.all(np.isfinite(state)) and 0.0 <= time < LATEST):
        return ReplanOutcome.NO_STATE
    upright = max(abs(state[LATITUDE]), abs(state[FLIGHT_PATH_ANGLE])) < 0.5 * np.pi
    if not (upright and 0.0 < state[ALTITUDE] < HIGHEST and 0.0 < state[SPEED] < FASTEST):
        return ReplanOutcome.NO_STATE
    if state[SPEED] <= target.speed:
        return ReplanOutcome.AT_THE_END
    goal = bearing(state[LONGITUDE], state[LATITUDE], target.longitude, target.latitude)
    if not target.place_is_free and abs(wrapped(state[AZIMUTH] - goal)) > 0.5 * np.pi:
        return ReplanOutcome.TARGET_BEHIND
    return None


def from_here(mission: Mission, state: Array, time: float) -> Mission:
    """The mission from `state` (6,), (7,) or (8,) at `time` (s).

    No vehicle banks farther or faster than it can: what is measured beyond a limit counts as the limit,
    and a rate towards the limit of the angle as one that reaches it in `SLOWEST`.
    """
    angle = rate = None
    if len(state) > BANK:
        most = mission.limits.designed("bank_angle") * (1.0 - LEAST_PART)
        angle = float(np.clip(on_turn_of(state[BANK], 0.0), -most, most))
    if angle is not None and len(state) > BANK + 1:
        fastest = mission.limits.designed("bank_rate") * (1.0 - LEAST_PART)
        right, left = ((most - side * angle) / SLOWEST for side in (1.0, -1.0))
        rate = float(np.clip(state[BANK + 1], -min(left, fastest), min(right, fastest)))
    return mission.with_entry(state[:BANK], time=time, bank_angle=angle, bank_rate=rate)
