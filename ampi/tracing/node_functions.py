"""What the optimiser reads at every node besides the equations of motion: limits and integrands.

The limits g(x, t) ≤ 1 are the uses of the limits on the path (missions/path_limits.py), each over the
share of the limit that its design margin leaves.

The integrands of the objective: what enters as ∫ L dt, its weights within (heat load, ground range),
then what enters as ∫ |D| dt, D = ḣ − ḣ_desired in m/s. And m(x_f), a cost of the final state alone.

References
----------
Wang et al. (2020), Eq. (31).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.path_constraints import path_constraints
from ampi.physics.planet import cross_range_angle
from ampi.physics.state import ALTITUDE, FLIGHT_PATH_ANGLE, LATITUDE, LONGITUDE, SPEED
from ampi.tracing.numbers import is_zero


@dataclass(frozen=True)
class TerminalCost:
    """m(x_f): weights of the final speed and of the cross-range from the entry's great circle."""

    final_speed: Any  # per m/s
    cross_range: Any  # per m, to the left
    longitude: Any  # of the entry, rad
    latitude: Any
    azimuth: Any

    def value(self, model: FlightModel, state: Any) -> Any:
        """m at a state (SI, rad; arrays or symbols)."""
        start = (self.longitude, self.latitude, self.azimuth)
        angle = cross_range_angle(*start, state[LONGITUDE], state[LATITUDE])
        across = self.cross_range * (model.planet.equatorial_radius * angle)
        return self.final_speed * state[SPEED] + across


@dataclass(frozen=True)
class NodeFunctions:
    """Limits (SI) and integrands of a mission or a family."""

    limits: PathLimits = field(default_factory=PathLimits)
    shares: tuple[Any, ...] = (1.0, 1.0, 1.0)  # of each limit on the path: 1 − margin
    heat_load: Any = 0.0  # weight of ∫ Q̇ dt, per J/m²
    ground_range: Any = 0.0  # weight of ∫ V cos γ R₀/r dt, per m
    desired_altitude_rate: Any = None  # m/s
    terminal: TerminalCost | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the limits, in order."""
        return self.limits.on_the_path

    @property
    def n_smooth(self) -> int:
        """Number of integrands that enter as they are."""
        return int(not (is_zero(self.heat_load) and is_zero(self.ground_range)))

    @property
    def n_absolute(self) -> int:
        """Number of integrands that enter by their absolute value."""
        return int(self.desired_altitude_rate is not None)

    def path(self, model: FlightModel, state: Any, time: Any) -> list[Any]:
        """g at `state` (h, θ, φ, V, γ, ψ, σ; SI, rad; arrays or symbols) and `time` (s)."""
        use = self.limits.path(model, state, time)
        return [g / share for g, share in zip(use, self.shares, strict=True)]

    def integrands(self, model: FlightModel, state: Any, time: Any) -> list[Any]:
        """The smooth integrand, if any, then the one of the absolute value, if any."""
        found = []
        h, v, gamma = state[ALTITUDE], state[SPEED], state[FLIGHT_PATH_ANGLE]
        if self.n_smooth:
            heat_flux = path_constraints(model, state, time)[1]
            radius = model.planet.equatorial_radius
            over_ground = v * np.cos(gamma) * radius / (radius + h)
            found.append(self.heat_load * heat_flux + self.ground_range * over_ground)
        if self.desired_altitude_rate is not None:
            found.append(v * np.sin(gamma) - self.desired_altitude_rate)
        return found
