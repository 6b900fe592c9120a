"""The objective's weights in scaled units.

    J = w_u ∫ û² dt + w_t t_f + ∫ L dt + w_a ∫ |û| dt + w_D ∫ |D| dt              (1)

and the target's cost (elastic_target). The weights are divided by `cost_scale`, the weight of a
bank-rate effort that would be worth as much, over a flight with one sweep from bank limit to bank
limit, as all terms together are on a flight of typical duration. So one unit of scaled cost is
1 (deg/s)² s of effort on any mission, and prices, penalties and the floor of the convexification stay
dimensionless, with or without an effort in the objective.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ampi.missions.mission import Mission
from ampi.physics.planet import great_circle_distance

DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True)
class Objective:
    """Scaled weights of Eq. (1); those of L are inside it."""

    cost_scale: float  # J = cost_scale · scaled cost
    reference_effort: float  # weight of ∫ û² dt that is worth the whole objective
    effort: float  # w_u
    final_time: float  # w_t, per s
    variation: float  # w_a
    descent: float  # w_D, per m

    def n_smooth(self, integrand: Any) -> int:
        """How many columns of the integrands (n, k) are of L: none or one."""
        return int(integrand.shape[1]) - int(self.descent > 0.0)

    @classmethod
    def from_mission(cls, mission: Mission) -> Objective:
        """Divide the mission's weights by the scale described above."""
        given, rate = mission.objective, mission.limits.designed("bank_rate") / DEGREE
        scale = _exchange_rate(mission)
        return cls(
            cost_scale=scale,
            reference_effort=rate**2,
            effort=given.bank_rate_effort / scale * rate**2,
            final_time=given.flight_time / scale,
            variation=given.bank_rate_variation / scale * rate,
            descent=given.descent_rate / scale,
        )


def _exchange_rate(mission: Mission) -> float:
    given, entry, target = mission.objective, mission.entry, mission.target
    radius = mission.flight_model.planet.equatorial_radius
    distance = float(
        great_circle_distance(
            entry.longitude, entry.latitude, target.longitude, target.latitude, radius
        )
    )
    duration = max(distance, entry.altitude) / (0.5 * (entry.speed + target.speed))
    sweep = 2.0 * mission.limits.bank_angle / DEGREE
    effort = sweep**2 / duration
    others = (
        given.bank_rate_variation * sweep
        + abs(given.flight_time) * duration
        + given.heat_load * 0.5e-6 * mission.limits.heat_flux * duration
        + abs(given.ground_range) * 1e-3 * distance
        + given.descent_rate * abs(entry.altitude - target.altitude)
    )
    return given.bank_rate_effort + others / effort
