"""How the angle of attack may leave its schedule or its reference: size, rate and acceleration.

A tracking law and a plan ask for a change δα; what is commanded moves there as fast as its limits allow
and stops in time. The rate asked is the greatest from which it still stops at the change that is wanted,
and it passes the limiter of the bank angle: the same law, of another angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ampi.tracking.bank_limiter import AngleLimits, limited_rate, stopping_rate


class ModulationLimits(AngleLimits):
    """Of δα."""

    of = "modulation"


@dataclass(frozen=True)
class AngleRange:
    """Of the angle of attack of a vehicle without a schedule, and how fast it is steered."""

    least: float  # rad
    greatest: float  # rad
    rate: float  # rad/s, ±

    def __post_init__(self) -> None:
        if not (self.least < self.greatest and 0.0 < self.rate < np.inf):
            raise ValueError(
                "angles: expected a least angle below the greatest (rad), and a positive rate (rad/s), "
                f"got {self.least}, {self.greatest}, {self.rate}"
            )

    def followed(self, wanted: Any, last: Any, cycle: float) -> Any:
        """The angle (rad) nearest to `wanted` after a cycle (s) from the `last` one; NaN: any."""
        inside = np.minimum(np.maximum(wanted, self.least), self.greatest)
        last, most = np.where(np.isnan(last), inside, last), self.rate * cycle
        return np.minimum(np.maximum(inside, last - most), last + most)


ANY_ANGLE = AngleRange(-np.pi, np.pi, 1e6)


def modulation_rate(
    limits: AngleLimits, change: Any, rate: Any, wanted: Any, cycle: float, shortest: float
) -> Any:
    """Rate of δα (rad/s) at the end of a cycle of `shortest` to `cycle` seconds.

    `change` (rad) and `rate` (rad/s) are those at its begin, as they were commanded; `wanted` (rad) is
    what is asked for. Numbers of one flight or arrays (n,).
    """
    a = limits.acceleration * (shortest / cycle)
    inside = np.minimum(np.maximum(wanted, -limits.angle), limits.angle)
    room = inside - (change + 0.5 * rate * cycle)
    asked = np.copysign(stopping_rate(np.abs(room), a, cycle), room)
    return limited_rate(limits, change, rate, asked, cycle, shortest)
