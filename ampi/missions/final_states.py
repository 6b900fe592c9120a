"""The target as final states: which of them a mission holds, and when an optimum meets them.

Altitude, position and speed are held unless they are free, the angles where they are given. A weight of
zero in the objective frees a state that has no range. What a *flight* may miss is the mission's
tolerance; an optimum is to end within `HORIZONTAL_TOLERANCE` and, of angles, `ANGLE_TOLERANCE`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.missions.flight_sections import TargetSection
from ampi.missions.sections import TARGET_WEIGHTS, MissionSections
from ampi.physics.angles import on_turn_of
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    AZIMUTH,
    BANK,
    CIRCULAR_STATES,
    FLIGHT_PATH_ANGLE,
    LATITUDE,
    LONGITUDE,
    SPEED,
    STEERED_STATES,
)

Array = NDArray[np.float64]

HORIZONTAL_TOLERANCE = 1e3  # m
ANGLE_TOLERANCE = float(np.radians(0.1))
GIVEN = (ALTITUDE, LONGITUDE, LATITUDE, SPEED)
ANGLES = (FLIGHT_PATH_ANGLE, AZIMUTH, BANK, ANGLE_OF_ATTACK)  # held only where they are given


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

    def nearest(self, final: float) -> float:
        """What lies in the range, and nearest to `final`."""
        least, greatest = self.change(final)
        return self.lower if least > 0.0 else self.upper if greatest < 0.0 else final

    def beyond(self, final: float) -> float:
        """How far `final` lies outside the range."""
        least, greatest = self.change(final)
        return max(least, -greatest, 0.0)

    def over(self, unit: float) -> FinalState:
        """Its bounds over a unit."""
        return replace(self, lower=self.lower / unit, upper=self.upper / unit)


def held_by(target: TargetSection, state: int) -> str | None:
    """The target's field that holds a state, a number or a range; None where it is free."""
    return target.held_by(STEERED_STATES[state])


def held_states(mission: MissionSections) -> tuple[int, ...]:
    """Which final states the mission holds: those that are given, then the angles."""
    target, objective = mission.target, mission.objective
    weights = dict(zip(GIVEN, TARGET_WEIGHTS, strict=True))
    found = []
    for state in (*GIVEN, *ANGLES):
        field = held_by(target, state)
        without = state in weights and getattr(objective, weights[state]) == 0.0
        if field is not None and not (without and field == STEERED_STATES[state]):
            found.append(state)
    return tuple(found)


def final_states(mission: MissionSections) -> tuple[FinalState, ...]:
    """The final states that the mission holds (SI, rad)."""
    found = []
    for state in held_states(mission):
        value = getattr(mission.target, held_by(mission.target, state) or "")
        low, high = value if isinstance(value, tuple) else (value, value)
        found.append(FinalState(state, low, high, state in CIRCULAR_STATES))
    return tuple(found)


@dataclass(frozen=True)
class TargetMiss:
    """How far a final state lies from the target, or from its range: 0 where it is not held."""

    horizontal: float  # m
    altitude: float  # m, above it
    speed: float  # m/s, above it
    angles: dict[str, float]  # rad, beyond the range, of each that is given
    is_met: bool  # within the mission's tolerances of altitude and speed, and the horizontal one

    @classmethod
    def of(cls, mission: MissionSections, final: Array) -> TargetMiss:
        """Of a final state (7 or 8,), SI and rad."""
        target, radius = mission.target, mission.flight_model.planet.equatorial_radius
        held = {one.state: one for one in final_states(mission)}
        here = {state: float(final[state]) for state in held}
        there = {state: one.nearest(here[state]) for state, one in held.items()}
        place = (float(final[LONGITUDE]), float(final[LATITUDE]))
        goal = (there.get(LONGITUDE, place[0]), there.get(LATITUDE, place[1]))
        horizontal = float(great_circle_distance(*place, *goal, radius))
        altitude, speed = (here[s] - there[s] if s in held else 0.0 for s in (ALTITUDE, SPEED))
        angles = {
            STEERED_STATES[state]: held[state].beyond(here[state])
            for state in ANGLES
            if state in held
        }
        met = (
            horizontal <= HORIZONTAL_TOLERANCE
            and abs(altitude) <= target.altitude_tolerance
            and abs(speed) <= target.speed_tolerance
        )
        return cls(horizontal, altitude, speed, angles, met)
