"""A vehicle: mass, reference area, aerodynamics and its angle-of-attack schedule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ampi.physics.aerodynamics import Aerodynamics
from ampi.physics.atmosphere import Atmosphere


@dataclass(frozen=True, kw_only=True)
class AngleOfAttackSchedule:
    """Two constant angles (rad) joined over `start` … `end` of time (s) or speed (m/s).

    The joint is a line, or a parabola with its vertex at `end` (Lu 1997). Over time the kinks stand
    at fixed instants: give the mesh a phase boundary at each (see `Mission.mesh`). Over speed they
    move with the trajectory and cannot sit on a node: there `smoothing` rounds them,

        clip(f, 0, 1) ≈ ½ [1 + √(f² + s²) − √((f − 1)² + s²)],                (1)

    with f the fraction of the way and s the smoothing over the way's length.
    """

    variable: str  # "time" or "speed"
    start: float
    end: float
    start_angle: float  # rad, for variable ≤ start
    end_angle: float  # rad, for variable ≥ end
    shape: str = "line"  # or "parabola"
    smoothing: float = 0.0  # in the unit of the variable

    def __post_init__(self) -> None:
        if self.variable not in ("time", "speed"):
            raise ValueError(
                f"angle_of_attack.variable: expected 'time' or 'speed', got {self.variable!r}"
            )
        if self.shape not in ("line", "parabola"):
            raise ValueError(
                f"angle_of_attack.shape: expected 'line' or 'parabola', got {self.shape!r}"
            )
        if not np.all(self.end > self.start):
            raise ValueError(
                f"angle_of_attack: end ({self.end}) must lie after start ({self.start})"
            )

    def __call__(self, time: Any, speed: Any) -> Any:
        """Angle of attack (rad) at `time` (s) and `speed` (m/s)."""
        variable = time if self.variable == "time" else speed
        fraction = (variable - self.start) / (self.end - self.start)
        # a number that is zero is a term that is not there: symbols have no truth value
        if not (isinstance(self.smoothing, float) and self.smoothing == 0.0):
            width = self.smoothing / (self.end - self.start)
            s2 = width * width
            before, after = np.sqrt(fraction**2 + s2), np.sqrt((fraction - 1.0) ** 2 + s2)
            fraction = 0.5 * (1.0 + before - after)
        else:
            fraction = np.minimum(np.maximum(fraction, 0.0), 1.0)
        if self.shape == "parabola":
            fraction = fraction * (2.0 - fraction)
        return self.start_angle + (self.end_angle - self.start_angle) * fraction


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """What the air acts on. Mass in kg, reference area in m², heat-flux model per Eq. (4)."""

    mass: float
    reference_area: float
    aerodynamics: Aerodynamics
    angle_of_attack: AngleOfAttackSchedule | None  # None: it is a state, steered by its rate
    heat_flux_constant: float  # k_q; W/m² per (kg/m³)^½ (m/s)^exponent
    heat_flux_speed_exponent: float = 3.0
    load_factor: str = "normal"  # what the load factor measures; or "total"
    lift_factor: float = 1.0  # on the lift coefficient of `aerodynamics`
    drag_factor: float = 1.0  # on its drag coefficient

    def __post_init__(self) -> None:
        positive = ("mass", "reference_area", "heat_flux_constant", "lift_factor", "drag_factor")
        for name in positive:
            if np.any(getattr(self, name) <= 0):
                raise ValueError(f"vehicle.{name}: must be positive, got {getattr(self, name)}")
        if self.load_factor not in ("normal", "total"):
            raise ValueError(
                f"vehicle.load_factor: expected 'normal' or 'total', got {self.load_factor!r}"
            )


class AirLoads(NamedTuple):
    """Specific aerodynamic loads at a flight condition: lift and drag (m/s²), ρ, α, speed in the air."""

    lift: Any
    drag: Any
    density: Any
    angle_of_attack: Any
    speed: Any


def air_loads(
    vehicle: Vehicle, atmosphere: Atmosphere, altitude: Any, speed: Any, time: Any
) -> AirLoads:
    """Lift and drag accelerations (m/s²) at `altitude` (m), `speed` (m/s) and `time` (s).

    Of a vehicle with a schedule of the angle of attack.
    """
    assert vehicle.angle_of_attack is not None
    angle_of_attack = vehicle.angle_of_attack(time, speed)
    return air_loads_at_angle(vehicle, atmosphere, altitude, speed, angle_of_attack)


def air_loads_at_angle(
    vehicle: Vehicle, atmosphere: Atmosphere, altitude: Any, speed: Any, angle_of_attack: Any
) -> AirLoads:
    """The same at an `angle_of_attack` (rad) of one's own; `speed` is through the air."""
    density = atmosphere.density(altitude)
    aerodynamics = vehicle.aerodynamics
    mach = speed / atmosphere.speed_of_sound(altitude) if aerodynamics.needs_mach else None
    lift_coefficient, drag_coefficient = aerodynamics.coefficients(angle_of_attack, mach)
    specific_pressure = 0.5 * density * speed * speed * (vehicle.reference_area / vehicle.mass)
    return AirLoads(
        lift=specific_pressure * (vehicle.lift_factor * lift_coefficient),
        drag=specific_pressure * (vehicle.drag_factor * drag_coefficient),
        density=density,
        angle_of_attack=angle_of_attack,
        speed=speed,
    )
