"""What the flight-control system can follow: bank angle, rate and acceleration limits (Table 2).

The commanded rate is clipped to the rate limit, slowed so that the vehicle can still stop at the bank
limit, and approached with the acceleration limit. Over one guidance cycle the rate is linear in time,
so the bank angle is a parabola that meets all three limits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = float | NDArray[np.float64]


@dataclass(frozen=True)
class BankLimits:
    """±, rad, rad/s, rad/s²; of one vehicle, or an array (n,) each of n."""

    angle: Values
    rate: Values
    acceleration: Values


def limited_rate(limits: BankLimits, bank: Any, rate: Any, command: Any, cycle: float) -> Any:
    """Bank rate (rad/s) at the end of a guidance cycle of `cycle` seconds.

    `bank` (rad) and `rate` (rad/s) are those at its begin; `command` (rad/s) is what is asked.
    """
    a = limits.acceleration
    change = a * cycle
    # Having reached rate r at the end of the cycle, the vehicle stands at bank + (rate + r) cycle/2
    # and must still be able to stop, braking by a · cycle in each cycle from then on.
    up = _stopping_rate(limits.angle - bank - 0.5 * rate * cycle, a, cycle)
    down = -_stopping_rate(limits.angle + bank + 0.5 * rate * cycle, a, cycle)
    wanted = np.minimum(np.maximum(command, -limits.rate), limits.rate)
    wanted = np.minimum(np.maximum(wanted, down), up)
    return np.minimum(np.maximum(wanted, rate - change), rate + change)


def _stopping_rate(room: Any, acceleration: Any, cycle: float) -> Any:
    """Greatest rate r at the cycle's end that stops within `room`; a rate back if there is none.

    Braking from r = a c (k + f), 0 ≤ f < 1, in steps of a c per cycle c, and the cycle that reaches r,
    need a c² (k (k + 1)/2 + f (k + 1)) of room. With continuous braking (r²/2a) in its place the bank
    angle would overshoot between cycles and chatter at the limit.
    """
    cycles = np.maximum(room, 0.0) / (acceleration * cycle**2)
    k = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * cycles) - 1.0))
    positive = acceleration * cycle * (k + (cycles - 0.5 * k * (k + 1.0)) / (k + 1.0))
    return np.where(room >= 0.0, positive, 2.0 * np.minimum(room, 0.0) / cycle)
