"""What the optimiser reads at every node besides the equations of motion: limits and integrands.

The limits g(x, t) ≤ 1, in this order:

    q / q_max,  Q̇ / Q̇_max,  n / n_max               Sagliano et al. 2016, Eq. (4)
    2 − D / D_min  where V ≤ V_floor, else 0           drag floor, Liu 2015, Eq. (73)
    2 − hav d / hav ρ                                  each no-fly zone, Liu 2015, Eq. (71)
                                                       on the sphere: physics/path_constraints.py

The integrands of the objective: what enters as ∫ L dt, its weights within (heat load, ground range),
then what enters as ∫ |D| dt, D = ḣ − ḣ_desired in m/s.

References
----------
Liu, Shen, Lu (2015), J. Guidance, doi 10.2514/1.G001210. Wang et al. (2020), Eq. (31).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.path_constraints import PATH_CONSTRAINTS, no_fly_zone, path_constraints
from ampi.physics.vehicle import air_loads


@dataclass(frozen=True)
class NodeFunctions:
    """Limits (SI) and integrands of one mission; hashable, so that traces are shared."""

    limits: tuple[float, float, float] = (1.0, 1.0, 1.0)  # Pa, W/m², g
    drag_floor: tuple[float, float] | None = (
        None  # m/s², where the speed (m/s) is at most the second
    )
    no_fly_zones: tuple[tuple[float, float, float], ...] = ()  # θ_c, φ_c, radius / R₀ (rad)
    heat_load: float = 0.0  # weight of ∫ Q̇ dt, per J/m²
    ground_range: float = 0.0  # weight of ∫ V cos γ R₀/r dt, per m
    desired_altitude_rate: float | None = None  # m/s

    @classmethod
    def from_mission(cls, mission: Mission, cost_scale: float = 1.0) -> NodeFunctions:
        """Those of `mission`, its integrands over `cost_scale`."""
        limits, objective = mission.limits, mission.objective
        planet = mission.flight_model.planet
        floor = None
        if limits.drag_floor is not None and limits.drag_floor_speed is not None:
            floor = (limits.drag_floor * planet.load_factor_gravity, limits.drag_floor_speed)
        return cls(
            limits=(limits.dynamic_pressure, limits.heat_flux, limits.load_factor),
            drag_floor=floor,
            no_fly_zones=tuple(
                (zone.longitude, zone.latitude, zone.radius / planet.equatorial_radius)
                for zone in mission.no_fly_zone
            ),
            heat_load=objective.heat_load * 1e-6 / cost_scale,
            ground_range=objective.ground_range * 1e-3 / cost_scale,
            desired_altitude_rate=objective.desired_altitude_rate,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the limits, in order."""
        floor = () if self.drag_floor is None else ("drag_floor",)
        zones = tuple(f"no_fly_zone {k}" for k in range(1, len(self.no_fly_zones) + 1))
        return (*PATH_CONSTRAINTS, *floor, *zones)

    @property
    def n_smooth(self) -> int:
        """Number of integrands that enter as they are."""
        return int(self.heat_load != 0.0 or self.ground_range != 0.0)

    @property
    def n_absolute(self) -> int:
        """Number of integrands that enter by their absolute value."""
        return int(self.desired_altitude_rate is not None)

    def path(self, model: FlightModel, state: Any, time: Any) -> list[Any]:
        """g at `state` (h, θ, φ, V, γ, ψ, σ; SI, rad; arrays or symbols) and `time` (s)."""
        values = path_constraints(model, state, time)
        g = [value / limit for value, limit in zip(values, self.limits, strict=True)]
        if self.drag_floor is not None:
            least, speed = self.drag_floor
            drag = air_loads(model.vehicle, model.atmosphere, state[0], state[3], time).drag
            g.append((state[3] <= speed) * (2.0 - drag / least))
        g += [no_fly_zone(state[1], state[2], zone) for zone in self.no_fly_zones]
        return g

    def integrands(self, model: FlightModel, state: Any, time: Any) -> list[Any]:
        """The smooth integrand, if any, then the one of the absolute value, if any."""
        found = []
        if self.n_smooth:
            heat_flux = path_constraints(model, state, time)[1]
            radius = model.planet.equatorial_radius
            over_ground = state[3] * np.cos(state[4]) * radius / (radius + state[0])
            found.append(self.heat_load * heat_flux + self.ground_range * over_ground)
        if self.desired_altitude_rate is not None:
            found.append(state[3] * np.sin(state[4]) - self.desired_altitude_rate)
        return found
