"""What is steered: the bank angle and, where it is a control, the angle of attack.

Each is a state whose rate is a control,

    y_lo ≤ y ≤ y_up,  |u| ≤ u_max,  ẏ = u;  y₀ and u at the first node are free, or given.          (1)

Bounds of the angle of attack over speed or Mach number are limits on the path (missions/path_limits.py):
here it is unbounded then. A number is one, or an array over the cases of a family.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ampi.missions.angle_of_attack import AngleBounds
from ampi.physics.angles import on_turn_of
from ampi.physics.state import ANGLE_OF_ATTACK, BANK
from ampi.scp.problem.problem_numbers import ProblemNumbers


@dataclass(frozen=True, eq=False)
class SteeredAngle:
    """Eq. (1) for one of them; rad, rad/s."""

    state: int
    lower: Any
    upper: Any
    rate_limit: Any
    entry: Any = None  # y₀; None where it is free
    entry_rate: Any = None  # at the first node; None where it is free

    @property
    def is_bounded(self) -> bool:
        """Whether it has bounds of its own."""
        return bool(np.all(np.isfinite(self.upper)))

    @property
    def middle(self) -> Any:
        """Of the bounds; 0 where it has none."""
        return 0.5 * (self.lower + self.upper) if self.is_bounded else 0.0

    @property
    def half_width(self) -> Any:
        """From the middle to a bound."""
        return 0.5 * (self.upper - self.lower)

    @property
    def scaled_entry_rate(self) -> Any:
        """û at the first node, None where it is free."""
        return None if self.entry_rate is None else self.entry_rate / self.rate_limit

    @property
    def numbers(self) -> tuple[Any, ...]:
        """All that may differ between the cases of a family."""
        return self.lower, self.upper, self.rate_limit, self.entry, self.entry_rate

    def at(self, cases: Any) -> Self:
        """That of some cases of a family."""
        return type(self)(self.state, *(n[cases] if np.ndim(n) == 1 else n for n in self.numbers))


def steered_angles(numbers: ProblemNumbers) -> tuple[SteeredAngle, ...]:
    """Those of a mission or a family, in the order of their states."""
    entry = numbers.section("entry")
    bank, limit = entry("bank_angle"), numbers.designed("bank_angle")
    angles = [
        SteeredAngle(
            BANK,
            lower=-limit,
            upper=limit,
            rate_limit=numbers.designed("bank_rate"),
            entry=None if bank is None else on_turn_of(bank, 0.0),
            entry_rate=entry("bank_rate"),
        )
    ]
    if numbers.limits.angle_of_attack is not None:
        angles.append(_angle_of_attack(numbers, numbers.limits.angle_of_attack))
    return tuple(angles)


def _angle_of_attack(numbers: ProblemNumbers, bounds: AngleBounds) -> SteeredAngle:
    entry = numbers.section("entry")
    fixed = bounds.are_fixed
    return SteeredAngle(
        ANGLE_OF_ATTACK,
        lower=bounds.lower[0] if fixed else -np.inf,
        upper=bounds.upper[0] if fixed else np.inf,
        rate_limit=bounds.rate,
        entry=entry("angle_of_attack"),
        entry_rate=entry("angle_of_attack_rate"),
    )
