"""The objective's weights in scaled units.

    J = Σ_k w_k ∫ û_k² dt + w_t t_f + ∫ L dt + w_a ∫ |û_σ| dt + w_D ∫ |D| dt + m(x_f)     (1)

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
    reference_effort: tuple[Any, ...]  # weight of ∫ û_k² dt that is worth the whole objective
    effort: tuple[Any, ...]  # w_k, one for a control
    final_time: Any  # w_t, per s
    variation: Any  # w_a
    descent: Any  # w_D, per m

    @classmethod
    def of(cls, numbers: ProblemNumbers) -> Objective:
        """Divide the mission's weights by the scale described above."""
        given, scale = numbers.section("objective"), _exchange_rate(numbers)
        rates = [numbers.designed("bank_rate") / DEGREE]
        efforts = [given("bank_rate_effort")]
        if numbers.limits.angle_of_attack is not None:
            rates.append(numbers.limits.angle_of_attack.rate / DEGREE)
            efforts.append(given("angle_of_attack_effort"))
        return cls(
            cost_scale=scale,
            reference_effort=tuple(rate**2 for rate in rates),
            effort=tuple(e / scale * r**2 for e, r in zip(efforts, rates, strict=True)),
            final_time=given("flight_time") / scale,
            variation=given("bank_rate_variation") / scale * rates[0],
            descent=given("descent_rate") / scale,
        )

    @property
    def numbers(self) -> tuple[Any, ...]:
        """All that may differ between the cases of a family."""
        return (
            self.cost_scale,
            *self.reference_effort,
            *self.effort,
            self.final_time,
            self.variation,
            self.descent,
        )

    def at(self, cases: Any) -> Objective:
        """That of some cases of a family."""

        def taken(number: Any) -> Any:
            return number[cases] if np.ndim(number) == 1 else number

        return Objective(
            cost_scale=taken(self.cost_scale),
            reference_effort=tuple(taken(number) for number in self.reference_effort),
            effort=tuple(taken(number) for number in self.effort),
            final_time=taken(self.final_time),
            variation=taken(self.variation),
            descent=taken(self.descent),
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
    if numbers.mission.objective.has_terminal:
        others = (
            others
            + np.abs(given("cross_range")) * 1e-3 * distance
            + np.abs(given("final_speed")) * entry("speed")
        )
    return given("bank_rate_effort") + others / effort
