"""What a mission asks of a flight, judged in one place: the one meaning of "passed" in a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.flight_sections import TargetSection
from ampi.missions.path_limits import KEPT
from ampi.simulation.plant import FlightStatus

ENDS = ("target_speed_not_reached", "position", "altitude", "speed")  # faults of where it ended


@dataclass(frozen=True)
class Tolerances:
    """How far from its target a flight may end."""

    position: float  # m; infinite where the position is free
    altitude: float  # m; infinite where it is free
    speed: float  # m/s

    @classmethod
    def of(cls, target: TargetSection) -> Tolerances:
        """Those of a mission."""
        position = target.position_tolerance if not target.place_is_free else np.inf
        altitude = np.inf if "altitude" in target.free_states else target.altitude_tolerance
        return cls(position, altitude, target.speed_tolerance)

    def faults(
        self, flights: Mapping[str, NDArray[Any]], limits: Sequence[str]
    ) -> dict[str, NDArray[np.bool_]]:
        """What n flights have not passed by: reason → (n,). One may have several; NaN is no pass.

        `flights` are arrays by their names in a file of flights, `limits` (l,) names the columns of
        their peak (n, l).
        """
        return {
            "target_speed_not_reached": flights["status"] != int(FlightStatus.REACHED_SPEED),
            "position": ~(flights["miss"] <= self.position),
            "altitude": ~(np.abs(flights["altitude_error"]) <= self.altitude),
            "speed": ~(np.abs(flights["speed_error"]) <= self.speed),
            **{name: ~(flights["peak"][:, i] <= 1.0 + KEPT) for i, name in enumerate(limits)},
        }
