"""The target as final states: which of them a mission holds, and when an optimum meets them.

Altitude and speed are held, the position unless it is free, path angle and azimuth where they are given;
a weight of zero in the objective frees a state. What a *flight* may miss is the mission's tolerance; an
optimum is to end within `HORIZONTAL_TOLERANCE` and, of angles, `ANGLE_TOLERANCE`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.missions.sections import TARGET_WEIGHTS, MissionSections
from ampi.physics.angles import on_turn_of
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import (
    ALTITUDE,
    AZIMUTH,
    CIRCULAR_STATES,
    FLIGHT_PATH_ANGLE,
    LATITUDE,
    LONGITUDE,
    SPEED,
    STATES,
)

Array = NDArray[np.float64]

HORIZONTAL_TOLERANCE = 1e3  # m
ANGLE_TOLERANCE = float(np.radians(0.1))
RANGES = (FLIGHT_PATH_ANGLE, AZIMUTH)  # held in a range, and only where they are given


@dataclass(frozen=True)
class FinalState:
    """A final state that is held in a range; equal bounds hold it to a value.

    A circular angle (rad) is the same modulo a turn.
    """

    state: int
    lower: float
    upper: float
    is_circular: bool = False

    @property
    def middle(self) -> float:
        """Of the range."""
        return 0.5 * (self.lower + self.upper)

    def change(self, final: float) -> tuple[float, float]:
        """Least and greatest change that takes `final` into the range: of an angle, the short way."""
        if self.is_circular:
            final += self.middle - on_turn_of(self.middle, final)
        return self.lower - final, self.upper - final

    def over(self, unit: float) -> FinalState:
        """Its bounds over a unit."""
        return replace(self, lower=self.lower / unit, upper=self.upper / unit)


def held_states(mission: MissionSections) -> tuple[int, ...]:
    """Which final states the mission holds, in their order."""
    target, objective = mission.target, mission.objective
    weights = dict(zip((ALTITUDE, LONGITUDE, LATITUDE, SPEED), TARGET_WEIGHTS, strict=True))
    free = {state for state, name in weights.items() if getattr(objective, name) == 0.0}
    free |= {LONGITUDE, LATITUDE} if target.position == "free" else set()
    free |= {state for state in RANGES if getattr(target, STATES[state]) is None}
    return tuple(state for state in (*weights, *RANGES) if state not in free)


def final_states(mission: MissionSections) -> tuple[FinalState, ...]:
    """The final states that the mission holds (SI, rad)."""
    found = []
    for state in held_states(mission):
        value = getattr(mission.target, STATES[state])
        low, high = value if state in RANGES else (value, value)
        found.append(FinalState(state, low, high, state in CIRCULAR_STATES))
    return tuple(found)


@dataclass(frozen=True)
class TargetMiss:
    """How far a final state lies from the target: 0 where it is not held."""

    horizontal: float  # m
    altitude: float  # m, above it
    speed: float  # m/s, above it
    angles: dict[str, float]  # rad, beyond the range, of each that is given
    is_met: bool  # within the mission's tolerances of altitude and speed, and the horizontal one

    @classmethod
    def of(cls, mission: MissionSections, final: Array) -> TargetMiss:
        """Of a final state (7,), SI and rad."""
        target, radius = mission.target, mission.flight_model.planet.equatorial_radius
        horizontal = 0.0
        if target.position == "fixed":
            there = (target.longitude, target.latitude)
            here = (final[LONGITUDE], final[LATITUDE])
            horizontal = float(great_circle_distance(*here, *there, radius))
        altitude = float(final[ALTITUDE]) - target.altitude
        speed = float(final[SPEED]) - target.speed
        angles = {}
        for held in final_states(mission):
            if held.state in RANGES:
                least, greatest = held.change(float(final[held.state]))
                angles[STATES[held.state]] = max(least, -greatest, 0.0)
        met = (
            horizontal <= HORIZONTAL_TOLERANCE
            and abs(altitude) <= target.altitude_tolerance
            and abs(speed) <= target.speed_tolerance
        )
        return cls(horizontal, altitude, speed, angles, met)
