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

from ampi.physics.planet import great_circle_distance
from ampi.scp.problem.problem_numbers import ProblemNumbers

DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True, eq=False)
class Objective:
    """Scaled weights of Eq. (1), numbers or arrays over cases; those of L are inside it."""

    cost_scale: Any  # J = cost_scale · scaled cost
    reference_effort: Any  # weight of ∫ û² dt that is worth the whole objective
    effort: Any  # w_u
    final_time: Any  # w_t, per s
    variation: Any  # w_a
    descent: Any  # w_D, per m

    @classmethod
    def of(cls, numbers: ProblemNumbers) -> Objective:
        """Divide the mission's weights by the scale described above."""
        given, rate = numbers.section("objective"), numbers.designed("bank_rate") / DEGREE
        scale = _exchange_rate(numbers)
        return cls(
            cost_scale=scale,
            reference_effort=rate**2,
            effort=given("bank_rate_effort") / scale * rate**2,
            final_time=given("flight_time") / scale,
            variation=given("bank_rate_variation") / scale * rate,
            descent=given("descent_rate") / scale,
        )


def _exchange_rate(numbers: ProblemNumbers) -> Any:
    given, entry, target = (numbers.section(name) for name in ("objective", "entry", "target"))
    limits = numbers.section("limits")
    radius = numbers.model.planet.equatorial_radius
    there = (target("longitude"), target("latitude"))
    distance = great_circle_distance(entry("longitude"), entry("latitude"), *there, radius)
    mean_speed = 0.5 * (entry("speed") + target("speed"))
    duration = np.maximum(distance, entry("altitude")) / mean_speed
    sweep = 2.0 * limits("bank_angle") / DEGREE
    effort = sweep**2 / duration
    others = (
        given("bank_rate_variation") * sweep
        + np.abs(given("flight_time")) * duration
        + given("heat_load") * 0.5e-6 * limits("heat_flux") * duration
        + np.abs(given("ground_range")) * 1e-3 * distance
        + given("descent_rate") * np.abs(entry("altitude") - target("altitude"))
    )
    return given("bank_rate_effort") + others / effort
