"""Every limit of a mission, and how much of it a flight uses. The one meaning of "kept".

    q / q_max,  Q̇ / Q̇_max,  n / n_max               Sagliano et al. 2016, Eq. (4)
    2 − D / D_min  where V ≤ V_floor, else 0           drag floor, Liu 2015, Eq. (73)
    2 − hav d / hav ρ                                  each no-fly zone, physics/path_constraints.py
    1 + (α_lo − α)/w,  1 + (α − α_up)/w                angle of attack, bounds over speed or Mach number
    |σ| / σ_max,  |σ̇| / σ̇_max,  |α − α_m| / w,  |α̇| / α̇_max

in this order, for one mission or for the missions of a family; α_m is the middle of fixed bounds of the
angle of attack, w half of their widest distance. A limit is kept where its use is at most 1 + `KEPT`, at
the nodes as between them, for the optimiser, a database, an audit and a closed-loop flight.

A mission may ask for a margin m of a limit: then its optimum is to use at most 1 − m of it, so that the
flight between the nodes, or a dispersed one, still keeps the limit itself. Verdicts judge by the limit.

The least bank angle of Liu 2015 is no limit in this sense: a flight passes through it at each reversal.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from ampi.missions.angle_of_attack import AngleBounds
from ampi.missions.sections import MissionSections
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.path_constraints import no_fly_zone, path_constraints
from ampi.physics.state import ANGLE_OF_ATTACK, BANK, LATITUDE, LOADS, LONGITUDE, SPEED
from ampi.physics.vehicle import AirLoads

KEPT = 1e-3  # of a limit: the excess that still counts as kept
CONTROL_LIMITS = ("bank_angle", "bank_rate")
ANGLE_LIMITS = ("angle_of_attack lower", "angle_of_attack upper")


class LimitKind(Enum):
    """What a limit bounds."""

    LOAD = "load"
    DRAG_FLOOR = "drag floor"
    NO_FLY_ZONE = "no-fly zone"
    ANGLE_OF_ATTACK = "angle of attack"
    CONTROL = "control"


@dataclass(frozen=True)
class PathLimits:
    """Limits of a mission, or of a family: then a number that differs is an array over its cases."""

    loads: tuple[Any, Any, Any] = (1.0, 1.0, 1.0)  # Pa, W/m², g
    drag_floor: tuple[Any, Any] | None = None  # m/s², where the speed (m/s) is at most the second
    no_fly_zones: tuple[tuple[Any, Any, Any], ...] = ()  # θ_c, φ_c, radius / R₀ (rad)
    bank_angle: Any = 1.0  # rad
    bank_rate: Any = 1.0  # rad/s
    angle_of_attack: AngleBounds | None = None  # where it is a control

    @classmethod
    def of(cls, mission: MissionSections) -> PathLimits:
        """Those of one mission."""
        limits, planet = mission.limits, mission.flight_model.planet
        floor = None
        if limits.drag_floor is not None and limits.drag_floor_speed is not None:
            floor = (limits.drag_floor * planet.load_factor_gravity, limits.drag_floor_speed)
        return cls(
            loads=(limits.dynamic_pressure, limits.heat_flux, limits.load_factor),
            drag_floor=floor,
            no_fly_zones=tuple(
                (zone.longitude, zone.latitude, zone.radius / planet.equatorial_radius)
                for zone in mission.no_fly_zone
            ),
            bank_angle=limits.bank_angle,
            bank_rate=limits.bank_rate,
            angle_of_attack=AngleBounds.of(mission.angle_of_attack),
        )

    @property
    def kinds(self) -> dict[str, LimitKind]:
        """Every limit by its name, in order."""
        floor = () if self.drag_floor is None else ("drag_floor",)
        zones = (f"no_fly_zone {k}" for k in range(1, len(self.no_fly_zones) + 1))
        angle = self.angle_of_attack
        on_path = () if angle is None or angle.are_fixed else ANGLE_LIMITS
        controls = CONTROL_LIMITS if angle is None else (*CONTROL_LIMITS, *angle.controls)
        return {
            **dict.fromkeys(LOADS, LimitKind.LOAD),
            **dict.fromkeys(floor, LimitKind.DRAG_FLOOR),
            **dict.fromkeys(zones, LimitKind.NO_FLY_ZONE),
            **dict.fromkeys(on_path, LimitKind.ANGLE_OF_ATTACK),
            **dict.fromkeys(controls, LimitKind.CONTROL),
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all limits, in order."""
        return tuple(self.kinds)

    @property
    def on_the_path(self) -> tuple[str, ...]:
        """Names of the limits on what the flight meets, in order: all but those of the control."""
        return tuple(n for n, kind in self.kinds.items() if kind is not LimitKind.CONTROL)

    def path(
        self, model: FlightModel, state: Any, time: Any, air: AirLoads | None = None
    ) -> list[Any]:
        """Use of each limit `on_the_path` at `state` (h, θ, φ, V, γ, ψ, σ; SI, rad) and `time` (s).

        States may be arrays or symbols; of a family, their shape is that of its model's numbers. `air`
        are the model's air loads there, if they are known.
        """
        values = path_constraints(model, state, time, air)
        use = [value / limit for value, limit in zip(values, self.loads, strict=True)]
        if self.drag_floor is not None:
            use.append((state[SPEED] <= self.drag_floor[1]) * self.floor_use(model, state, time))
        use += self.zones(state[LONGITUDE], state[LATITUDE])
        if self.angle_of_attack is not None and not self.angle_of_attack.are_fixed:
            use += self.angle_of_attack.use(model, state)
        return use

    def floor_use(self, model: FlightModel, state: Any, time: Any) -> Any:
        """Use of the drag floor where it holds."""
        least, _ = self.drag_floor or (np.inf, 0.0)
        return 2.0 - model.air_loads(state, time).drag / least

    def zones(self, longitude: Any, latitude: Any) -> list[Any]:
        """Use of each no-fly zone at a point (rad)."""
        return [no_fly_zone(longitude, latitude, zone) for zone in self.no_fly_zones]

    def use(
        self,
        model: FlightModel,
        state: Any,
        bank_rate: Any,
        time: Any,
        air: AirLoads | None = None,
        *,
        angle_of_attack_rate: Any = 0.0,
    ) -> list[Any]:
        """Use of every limit, in the order of `names`; rates in rad/s, `air` as of `path`."""
        control = [np.abs(state[BANK]) / self.bank_angle, np.abs(bank_rate) / self.bank_rate]
        if self.angle_of_attack is not None:
            control += self.angle_of_attack.control_use(
                state[ANGLE_OF_ATTACK], angle_of_attack_rate
            )
        return [*self.path(model, state, time, air), *control]
