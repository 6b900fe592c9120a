"""What the flight-control system can follow: bank angle, rate and acceleration limits (Table 2).

The commanded rate is clipped to the rate limit, slowed so that the vehicle can still stop at the bank
limit, and approached with the acceleration limit. Over one guidance cycle the rate is linear in time,
so the bank angle is a parabola that meets all three limits.

A cycle that is not known beforehand lies between a shortest and a longest one: the rate changes by what
the shortest allows, and stops in time if every cycle is the longest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Values = float | NDArray[np.float64]

TURN = 2.0 * np.pi
NEAR_INVERTED = np.radians(170.0)  # 10° of overshoot are told from the other side


@dataclass(frozen=True)
class AngleLimits:
    """±, rad, rad/s, rad/s²; of one vehicle, or an array (n,) each of n."""

    of: ClassVar[str] = "angle"

    angle: Values
    rate: Values
    acceleration: Values

    def __post_init__(self) -> None:
        for name in ("angle", "rate", "acceleration"):
            value = np.asarray(getattr(self, name), dtype=float)
            if not ((value > 0.0) & (value < np.inf)).all():
                raise ValueError(
                    f"{self.of} limits: {name}: expected positive numbers (rad, rad/s, rad/s²), "
                    f"got {value}"
                )


class BankLimits(AngleLimits):
    """Of the bank angle."""

    of = "bank"


def bank_on_turn(limits: BankLimits, bank: Any, reference: Any) -> Any:
    """The bank angle (rad) of those that are the same modulo a turn from which to turn back.

    That is the one within ±180°, where the limits lie: the way to the reference leads between them, not
    over the back. Only where a limit lies so near 180° that an overshoot is taken for the other side, it
    is that on the reference's side.
    """
    near = np.maximum(limits.angle - NEAR_INVERTED, 0.0)
    middle = np.minimum(np.maximum(reference, -near), near)
    return bank - TURN * np.rint((bank - middle) / TURN)


def limited_rate(
    limits: AngleLimits,
    bank: Any,
    rate: Any,
    command: Any,
    cycle: float,
    shortest: float | None = None,
) -> Any:
    """Bank rate (rad/s) at the end of a guidance cycle of `cycle` seconds.

    `bank` (rad) and `rate` (rad/s) are those at its begin; `command` (rad/s) is what is asked. If the
    cycle is not known, `cycle` is the longest that it may be, and `shortest` the shortest.
    """
    a = limits.acceleration if shortest is None else limits.acceleration * (shortest / cycle)
    change = a * cycle
    # Having reached rate r at the end of the cycle, the vehicle stands at bank + (rate + r) cycle/2
    # and must still be able to stop, braking by a · cycle in each cycle from then on.
    ahead = bank + 0.5 * rate * cycle
    up, down = stopping_rate(np.array([limits.angle - ahead, limits.angle + ahead]), a, cycle)
    wanted = np.minimum(np.maximum(command, -down), up)
    wanted = np.minimum(np.maximum(wanted, -limits.rate), limits.rate)
    return np.minimum(np.maximum(wanted, rate - change), rate + change)


def stopping_rate(room: Any, acceleration: Any, cycle: float) -> Any:
    """Greatest rate r at the cycle's end that stops within `room`; a rate back if there is none.

    Braking from r = a c (k + f), 0 ≤ f < 1, in steps of a c per cycle c, and the cycle that reaches r,
    need a c² (k (k + 1)/2 + f (k + 1)) of room. With continuous braking (r²/2a) in its place the bank
    angle would overshoot between cycles and chatter at the limit.
    """
    cycles = np.maximum(room, 0.0) / (acceleration * (cycle * cycle))
    k = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * cycles) - 1.0))
    stopping = acceleration * cycle * (k + (cycles - 0.5 * k * (k + 1.0)) / (k + 1.0))
    return stopping + 2.0 * np.minimum(room, 0.0) / cycle  # one of the two is 0
