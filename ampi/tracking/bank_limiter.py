"""What the flight-control system can follow: bank angle, rate and acceleration limits (Table 2).

The commanded rate is clipped to the rate limit, slowed so that the vehicle can still stop at the bank
limit, and approached with the acceleration limit. Over one guidance cycle the rate is linear in time,
so the bank angle is a parabola that meets all three limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class BankLimits:
    """±, rad, rad/s, rad/s²."""

    angle: float
    rate: float
    acceleration: float


def limited_rate(limits: BankLimits, bank: Any, rate: Any, command: Any, cycle: float) -> Any:
    """Bank rate (rad/s) at the end of a guidance cycle of `cycle` seconds.

    `bank` (rad) and `rate` (rad/s) are those at its begin; `command` (rad/s) is what is asked.
    """
    a = limits.acceleration
    change = a * cycle
    # Having reached rate r at the end of the cycle, the vehicle stands at bank + (rate + r) cycle/2
    # and needs r²/2a to stop: the greatest r that still stops at the limit solves a quadratic.
    up = _stopping_rate(limits.angle - bank - 0.5 * rate * cycle, a, cycle)
    down = -_stopping_rate(limits.angle + bank + 0.5 * rate * cycle, a, cycle)
    wanted = np.minimum(np.maximum(command, -limits.rate), limits.rate)
    wanted = np.minimum(np.maximum(wanted, down), up)
    return np.minimum(np.maximum(wanted, rate - change), rate + change)


def _stopping_rate(room: Any, acceleration: float, cycle: float) -> Any:
    """Greatest r with r cycle/2 + r²/2a ≤ room; where there is no room, a rate that backs off."""
    half = 0.5 * acceleration * cycle
    positive = np.sqrt(half * half + 2.0 * acceleration * np.maximum(room, 0.0)) - half
    return np.where(room >= 0.0, positive, 2.0 * np.minimum(room, 0.0) / cycle)
