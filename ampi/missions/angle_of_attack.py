"""The angle of attack as a control: its bounds, its rate and its acceleration.

A vehicle follows a schedule (`[vehicle.angle_of_attack]`), or it is steered by a second control:

    [angle_of_attack]
    lower_deg = [10.0, 15.0]
    upper_deg = [20.0, 40.0]
    over = "speed"
    at = [2000.0, 4000.0]
    rate_deg_per_s = 5.0
    acceleration_deg_per_s2 = 4.0

Bounds are numbers, or lists over speed (m/s) or Mach number: lines between their points, held outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from ampi.missions import units as u
from ampi.missions.units import Dimension, Number, Section
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.state import ALTITUDE, ANGLE_OF_ATTACK, SPEED

Angles = Annotated[tuple[float, ...], Dimension("angle", is_list=True)]


class AngleOfAttackControlSection(Section):
    """Bounds of the angle of attack, fixed or over speed or Mach number, and of its rate (±)."""

    lower: Angles = Field(description="Least angle of attack: a number, or one for each of `at`")
    upper: Angles = Field(description="Greatest angle of attack: a number, or one for each of `at`")
    over: Literal["speed", "mach"] | None = Field(
        default=None, description="What bounds that are lists go by: speed (m/s) or mach"
    )
    at: tuple[Number, ...] | None = Field(
        default=None, description="Where lists have their values: m/s or Mach numbers, increasing"
    )
    rate: u.AngularRate = Field(gt=0, description="Greatest size of its rate")
    acceleration: u.AngularAcceleration = Field(
        gt=0,
        description="Greatest size of its acceleration; of what guidance asks for, as the bank's",
    )

    @field_validator("lower", "upper", mode="before")
    @classmethod
    def _number_is_a_list(cls, value: Any) -> Any:
        return (value,) if isinstance(value, float) else value

    @field_validator("lower", "upper")
    @classmethod
    def _angles_are_flown(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not value or max(abs(angle) for angle in value) > np.pi:
            raise ValueError("expected angles from -180 to 180 degrees")
        return value

    @model_validator(mode="after")
    def _bounds_fit(self) -> AngleOfAttackControlSection:
        found = []
        if (self.over is None) != (self.at is None):
            found.append("over and at: expected both or neither")
        points = 1 if self.at is None else len(self.at)
        for name in ("lower", "upper"):
            count = len(getattr(self, name))
            if count not in (1, points):
                found.append(
                    f"{name}: expected one angle, or one for each of `at` ({points}), got {count}"
                )
        if self.at is not None and (points < 2 or np.any(np.diff(self.at) <= 0.0)):
            found.append("at: expected two or more numbers that increase strictly")
        if found:
            raise ValueError("\n".join(found))
        for low, high in zip(*self.points, strict=True):
            if not low < high:
                raise ValueError(
                    f"lower, upper: expected a lower bound below the upper one, "
                    f"got {low / u.DEGREE:.6g}° and {high / u.DEGREE:.6g}°"
                )
        return self

    @property
    def points(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lower and upper bound (rad) at every point of `at`, or once."""
        count = 1 if self.at is None else len(self.at)
        low, high = (b if len(b) == count else b * count for b in (self.lower, self.upper))
        return low, high


@dataclass(frozen=True)
class AngleBounds:
    """Bounds of the angle of attack (rad) and of its rate (rad/s), of a mission or of a family."""

    lower: tuple[Any, ...]
    upper: tuple[Any, ...]
    rate: Any
    at: tuple[Any, ...] = ()  # m/s or Mach numbers; none: the bounds are fixed
    over: str = "speed"

    @classmethod
    def of(cls, control: AngleOfAttackControlSection | None) -> Self | None:
        """Those of a mission; None where it follows a schedule."""
        if control is None:
            return None
        at, over = control.at or (), control.over or "speed"
        return cls(*control.points, rate=control.rate, at=at, over=over)

    @property
    def are_fixed(self) -> bool:
        """Whether they are numbers: then the optimiser holds them as it holds the bank angle's."""
        return not self.at

    @property
    def controls(self) -> tuple[str, ...]:
        """Names of the limits that are of kind control."""
        return ("angle_of_attack", "angle_of_attack_rate")[0 if self.are_fixed else 1 :]

    @property
    def middle(self) -> Any:
        """Of fixed bounds (rad)."""
        return 0.5 * (self.lower[0] + self.upper[0])

    @property
    def half_width(self) -> Any:
        """Half of the widest distance between the bounds (rad)."""
        widths = [high - low for low, high in zip(self.lower, self.upper, strict=True)]
        widest = widths[0]
        for width in widths[1:]:
            widest = np.maximum(widest, width)
        return 0.5 * widest

    def at_state(self, model: FlightModel, state: Any) -> tuple[Any, Any]:
        """Lower and upper bound (rad) at a state (SI, rad): floats, arrays or symbols."""
        if self.are_fixed:
            return self.lower[0], self.upper[0]
        variable = state[SPEED]
        if self.over == "mach":
            variable = variable / model.atmosphere.speed_of_sound(state[ALTITUDE])
        return _along(self.at, self.lower, variable), _along(self.at, self.upper, variable)

    def use(self, model: FlightModel, state: Any) -> list[Any]:
        """Use of the lower and of the upper bound at a state: 1 on a bound."""
        low, high = self.at_state(model, state)
        angle, width = state[ANGLE_OF_ATTACK], self.half_width
        return [1.0 + (low - angle) / width, 1.0 + (angle - high) / width]

    def control_use(self, angle: Any, rate: Any) -> list[Any]:
        """Use of fixed bounds, if they are, and of the rate's."""
        of_rate = np.abs(rate) / self.rate
        if not self.are_fixed:
            return [of_rate]
        return [np.abs(angle - self.middle) / self.half_width, of_rate]


def _along(points: tuple[Any, ...], values: tuple[Any, ...], x: Any) -> Any:
    """Lines between the values, held outside: ufuncs alone, so that it can be traced."""
    found = values[0]
    for k in range(len(points) - 1):
        length = points[k + 1] - points[k]
        share = np.minimum(np.maximum((x - points[k]) / length, 0.0), 1.0)
        found = found + (values[k + 1] - values[k]) * share
    return found
