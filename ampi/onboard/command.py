"""What is commanded for one cycle, and by what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ampi.onboard.health import Health, Steering


@dataclass(frozen=True)
class Command:
    """For one cycle; numbers of one flight, or arrays (n,)."""

    bank_rate: Any  # rad/s, to be reached at the end of the cycle
    bank_angle: Any  # rad, there
    angle_of_attack: Any  # rad, to be added to the schedule's; itself, where there is none
    steering: Any  # Steering, by what; of n flights their numbers
    health: Any  # Health; of n flights their numbers

    def of_one(self) -> Command:
        """As numbers, of one flight."""
        return Command(
            float(self.bank_rate[0]),
            float(self.bank_angle[0]),
            float(self.angle_of_attack[0]),
            Steering(int(self.steering[0])),
            Health(int(self.health[0])),
        )
