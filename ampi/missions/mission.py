"""A mission: planet, vehicle, boundary conditions, limits, objective, mesh and parameter grid."""

from __future__ import annotations

import hashlib
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, TypeAdapter, ValidationError, field_validator, model_validator

from ampi.missions import units as u
from ampi.missions.family import MissionFamily
from ampi.missions.parameters import Parameter, moved, parameter_values, resolve
from ampi.missions.units import Dimension, Number, Section
from ampi.physics.aerodynamics import (
    Aerodynamics,
    ModifiedNewtonian,
    PolynomialDragPolar,
    TabulatedAerodynamics,
)
from ampi.physics.angles import TURN, on_turn_of
from ampi.physics.atmosphere import (
    SPECIFIC_HEAT_RATIO,
    Atmosphere,
    ExponentialAtmosphere,
    StandardAtmosphere1976,
)
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.path_constraints import no_fly_zone, path_constraints
from ampi.physics.planet import WGS84, Planet, great_circle_distance
from ampi.physics.state import ENTRY_STATES, LOADS
from ampi.physics.vehicle import AngleOfAttackSchedule, Vehicle, air_loads
from ampi.pseudospectral.mesh import Mesh, Phase

LATE = 1e4  # s: after any angle-of-attack manoeuvre
MODEL_SECTIONS = ("planet", "atmosphere", "vehicle")  # what the flight model is made of


class MissionError(ValueError):
    """A mission file that cannot be used; the message lists every faulty field."""


class PlanetSection(Section):
    """`wgs84`, or a sphere given by radius and surface gravity.

    Load factors (`load_factor_g`, `drag_floor_g`) are counted in g₀ = `load_factor_gravity`: 9.782 m/s²
    of wgs84, of a sphere its own surface gravity, unless the mission gives another (9.80665 for limits
    in the Earth's g on Mars).
    """

    model: Literal["wgs84", "sphere"]
    radius: u.Length | None = Field(default=None, gt=0)
    surface_gravity: Number | None = Field(default=None, gt=0)  # m/s²
    rotation_rate: Number | None = None  # rad/s; a sphere without one stands still
    load_factor_gravity: Number | None = Field(default=None, gt=0)  # m/s², g₀ of the load factor

    @model_validator(mode="after")
    def _sphere_is_complete(self) -> PlanetSection:
        if self.model == "sphere" and (self.radius is None or self.surface_gravity is None):
            raise ValueError("a sphere needs radius_km (or radius_m) and surface_gravity (m/s²)")
        given = self.model_fields_set - {"model"}
        if self.model == "wgs84" and given:
            raise ValueError(f"wgs84 is complete in itself; remove {', '.join(sorted(given))}")
        return self

    def build(self) -> Planet:
        """The physics object."""
        if self.radius is None or self.surface_gravity is None:
            return WGS84
        return Planet(
            equatorial_radius=self.radius,
            gravitational_parameter=self.surface_gravity * self.radius**2,
            j2=0.0,
            rotation_rate=self.rotation_rate or 0.0,
            load_factor_gravity=self.load_factor_gravity or self.surface_gravity,
        )


class AtmosphereSection(Section):
    """`us76`, or `exponential` with surface density (kg/m³) and scale height; a factor on either.

    An exponential atmosphere is isothermal: its speed of sound, √(κ g H), follows from its scale height
    H, the planet's surface gravity g and its `specific_heat_ratio` κ (1.4 of air, 1.29 of CO₂).
    """

    model: Literal["us76", "exponential"]
    density_factor: Number = Field(default=1.0, gt=0)  # on the model's density, nominal 1
    surface_density: Number | None = Field(default=None, gt=0)
    scale_height: u.Length | None = Field(default=None, gt=0)
    specific_heat_ratio: Number | None = Field(default=None, gt=1)

    @model_validator(mode="after")
    def _exponential_is_complete(self) -> AtmosphereSection:
        if self.model == "exponential" and (
            self.surface_density is None or self.scale_height is None
        ):
            raise ValueError("exponential needs surface_density (kg/m³) and scale_height_m")
        given = self.model_fields_set - {"model", "density_factor"}
        if self.model == "us76" and given:
            raise ValueError(f"us76 is complete in itself; remove {', '.join(sorted(given))}")
        return self

    def build(self, surface_gravity: float) -> Atmosphere:
        """The physics object over a planet of `surface_gravity` (m/s²)."""
        if self.surface_density is None or self.scale_height is None:
            return StandardAtmosphere1976(density_factor=self.density_factor)
        return ExponentialAtmosphere(
            surface_density=self.surface_density,
            scale_height=self.scale_height,
            surface_gravity=surface_gravity,
            specific_heat_ratio=self.specific_heat_ratio or SPECIFIC_HEAT_RATIO,
            density_factor=self.density_factor,
        )


class ModifiedNewtonianSection(Section):
    """C_N = normal_quadratic · sin²α + normal_linear · sin α; C_A = axial."""

    model: Literal["modified_newtonian"]
    normal_quadratic: Number
    normal_linear: Number
    axial: Number

    def build(self) -> Aerodynamics:
        """The physics object."""
        return ModifiedNewtonian(**self.model_dump(exclude={"model"}))


class PolynomialSection(Section):
    """C_L = Σ lift[k] α^k (α in degrees), C_D = Σ drag[k] C_L^k."""

    model: Literal["polynomial"]
    lift: tuple[Number, ...]
    drag: tuple[Number, ...]

    def build(self) -> Aerodynamics:
        """The physics object."""
        return PolynomialDragPolar(lift=self.lift, drag=self.drag)


class TableSection(Section):
    """Rows over angle of attack, columns over Mach number."""

    model: Literal["table"]
    angle_of_attack: Annotated[tuple[Number, ...], Dimension("angle")]
    mach: tuple[Number, ...]
    lift: tuple[tuple[Number, ...], ...]
    drag: tuple[tuple[Number, ...], ...]

    def build(self) -> Aerodynamics:
        """The physics object."""
        return TabulatedAerodynamics(**self.model_dump(exclude={"model"}))


class AngleOfAttackSection(Section):
    """Two constant angles joined by a line or a parabola over time (s) or speed (m/s)."""

    variable: Literal["time", "speed"]
    shape: Literal["line", "parabola"] = "line"
    start: Number
    end: Number
    start_angle: u.Angle
    end_angle: u.Angle
    smoothing: Number = Field(default=0.0, ge=0)  # in the variable's unit; rounds the kinks


class VehicleSection(Section):
    """Mass, reference area, heat-flux model, aerodynamics and angle-of-attack schedule."""

    mass: u.Mass = Field(gt=0)
    reference_area: u.Area = Field(gt=0)
    heat_flux_constant: Number = Field(gt=0)
    heat_flux_speed_exponent: Number = Field(default=3.0, ge=1, le=4)
    load_factor: Literal["normal", "total"] = "normal"  # L cos α + D sin α, or √(L² + D²)
    lift_factor: Number = Field(default=1.0, gt=0)  # on the model's lift coefficient, nominal 1
    drag_factor: Number = Field(default=1.0, gt=0)  # on its drag coefficient, nominal 1
    aerodynamics: Annotated[
        ModifiedNewtonianSection | PolynomialSection | TableSection, Field(discriminator="model")
    ]
    angle_of_attack: AngleOfAttackSection

    def build(self) -> Vehicle:
        """The physics object."""
        return Vehicle(
            mass=self.mass,
            reference_area=self.reference_area,
            heat_flux_constant=self.heat_flux_constant,
            heat_flux_speed_exponent=self.heat_flux_speed_exponent,
            load_factor=self.load_factor,
            lift_factor=self.lift_factor,
            drag_factor=self.drag_factor,
            aerodynamics=self.aerodynamics.build(),
            angle_of_attack=AngleOfAttackSchedule(**self.angle_of_attack.model_dump()),
        )


class EntrySection(Section):
    """State at the entry interface, Table 1; the bank angle there is free."""

    altitude: u.Length = Field(ge=0, le=130e3)
    longitude: u.CircularAngle = Field(ge=-2 * TURN, le=2 * TURN)
    latitude: u.Angle = Field(gt=-0.5 * np.pi, lt=0.5 * np.pi)
    speed: u.Speed = Field(ge=10, le=12e3)
    flight_path_angle: u.Angle = Field(gt=-0.5 * np.pi, lt=0.5 * np.pi)
    azimuth: u.CircularAngle = Field(ge=-2 * TURN, le=2 * TURN)


class TargetSection(Section):
    """Where guided flight ends. Tolerances and radii serve the verdict, not the optimiser.

    A flight has passed where it ended within all three tolerances; `radii` are those within which
    flights are counted, by default a quarter, a half, once and twice the position tolerance. A final
    angle is one number or a range [least, greatest]; absent, it is free. With `position = "free"`
    longitude and latitude only serve the reports (maximum range), and no distance is judged.
    """

    altitude: u.Length = Field(ge=0, le=120e3)
    longitude: u.CircularAngle = Field(ge=-2 * TURN, le=2 * TURN)
    latitude: u.Angle = Field(gt=-0.5 * np.pi, lt=0.5 * np.pi)
    speed: u.Speed = Field(ge=10, le=12e3)
    altitude_tolerance: u.Length = Field(gt=0)
    speed_tolerance: u.Speed = Field(gt=0)
    position_tolerance: u.Length = Field(default=10e3, gt=0)
    radii: u.Lengths | None = None
    position: Literal["fixed", "free"] = "fixed"
    flight_path_angle: u.AngleRange | None = None
    azimuth: u.CircularRange | None = None

    @field_validator("radii")
    @classmethod
    def _radii_increase(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and (len(value) == 0 or np.any(np.diff((0.0, *value)) <= 0)):
            raise ValueError("expected one or more positive lengths that increase strictly")
        return value

    @property
    def judged_radii(self) -> tuple[float, ...]:
        """Radii (m) about the target within which the verdict counts flights."""
        if self.radii is not None:
            return self.radii
        return tuple(share * self.position_tolerance for share in (0.25, 0.5, 1.0, 2.0))

    @field_validator("flight_path_angle", "azimuth", mode="before")
    @classmethod
    def _number_is_a_range(cls, value: Any) -> Any:
        return (value, value) if isinstance(value, float) else value

    @field_validator("azimuth")
    @classmethod
    def _range_crosses_south(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        """[170°, −170°] is [170°, 190°]."""
        if value is not None and value[0] - value[1] > 0.5 * TURN:
            return value[0], value[1] + TURN
        return value

    @field_validator("flight_path_angle", "azimuth")
    @classmethod
    def _range_increases(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[1] < value[0]:
            raise ValueError("expected a number or [least, greatest]")
        return value


Margin = Annotated[float, Field(strict=True, ge=0, lt=1)]


class LimitsSection(Section):
    """Bank angle, rate and acceleration (±), the three path constraints of Eq. (4), a drag floor.

    Load factor and drag floor are counted in the planet's g₀ (`PlanetSection`).

    The drag floor (Liu 2015, Eq. 73) holds where the speed is below `drag_floor_speed`. A margin is the
    share of a limit that an optimum leaves unused (path_limits); verdicts judge by the limit itself.
    """

    bank_angle: u.Angle = Field(gt=0, le=np.pi)
    bank_angle_minimum: u.Angle = Field(default=0.0, ge=0, lt=0.5 * np.pi)  # of |σ|
    bank_rate: u.AngularRate = Field(gt=0)
    bank_acceleration: u.AngularAcceleration = Field(gt=0)
    dynamic_pressure: u.Pressure = Field(gt=0)
    heat_flux: u.HeatFlux = Field(gt=0)
    load_factor: u.LoadFactor = Field(gt=0)
    drag_floor: u.LoadFactor | None = Field(default=None, gt=0)
    drag_floor_speed: u.Speed | None = Field(default=None, gt=0)
    bank_angle_margin: Margin = 0.0
    bank_rate_margin: Margin = 0.0
    dynamic_pressure_margin: Margin = 0.0
    heat_flux_margin: Margin = 0.0
    load_factor_margin: Margin = 0.0
    drag_floor_margin: Margin = 0.0
    no_fly_zone_margin: Margin = 0.0  # of every zone

    def share(self, limit: str) -> float:
        """What an optimum may use of a limit (`PathLimits.names`): 1 − its margin."""
        margin: float = getattr(self, f"{limit.partition(' ')[0]}_margin")
        return 1.0 - margin

    def designed(self, limit: str) -> float:
        """A limit less its margin (SI, rad)."""
        value: float = getattr(self, limit)
        return value * self.share(limit)

    @model_validator(mode="after")
    def _floor_is_complete(self) -> LimitsSection:
        found = []
        if (self.drag_floor is None) != (self.drag_floor_speed is None):
            found.append("drag_floor_g and drag_floor_speed_m_per_s: expected both or neither")
        if self.bank_angle_minimum >= self.bank_angle:
            found.append("bank_angle_minimum: expected less than bank_angle")
        if found:
            raise ValueError("\n".join(found))
        return self


class NoFlyZoneSection(Section):
    """A cylinder over a circle on the ground, Liu 2015, Eq. (71) with distances on the sphere."""

    longitude: u.CircularAngle = Field(ge=-2 * TURN, le=2 * TURN)
    latitude: u.Angle = Field(ge=-0.5 * np.pi, le=0.5 * np.pi)
    radius: u.Length = Field(gt=0)


TARGET_WEIGHTS = ("altitude_weight", "longitude_weight", "latitude_weight", "speed_weight")


SMALLEST_WEIGHT = 1e-20  # in SI, and the inverse of the largest


class ObjectiveSection(Section):
    """What is minimised: a weighted sum of the terms that are given.

    With the four target weights (all or none) the target is a quadratic cost, Sagliano 2016,
    Eq. (1); without them it is to be met exactly.
    """

    altitude_weight: u.PerLengthSquared | None = Field(default=None, ge=0)
    longitude_weight: u.PerAngleSquared | None = Field(default=None, ge=0)
    latitude_weight: u.PerAngleSquared | None = Field(default=None, ge=0)
    speed_weight: u.PerSpeedSquared | None = Field(default=None, ge=0)
    bank_rate_effort: Number = Field(default=0.0, ge=0)  # ∫ σ̇² dt, per (deg/s)² s
    bank_rate_variation: Number = Field(default=0.0, ge=0)  # ∫ |σ̇| dt, per deg
    flight_time: Number = 0.0  # t_f, per s; negative: longest flight
    heat_load: Number = Field(default=0.0, ge=0)  # ∫ Q̇ dt, per MJ/m²
    ground_range: Number = 0.0  # ∫ V cos γ R/r dt, per km; negative: farthest flight
    descent_rate: Number = Field(default=0.0, ge=0)  # ∫ |ḣ − desired| dt, per m
    desired_altitude_rate: u.Speed | None = None

    @model_validator(mode="after")
    def _terms_fit(self) -> ObjectiveSection:
        given = [name for name in TARGET_WEIGHTS if getattr(self, name) is not None]
        weights = {name: abs(getattr(self, name) or 0.0) for name in type(self).model_fields}
        found = [
            f"{name}: expected 0 or a size from {SMALLEST_WEIGHT:g} to {1 / SMALLEST_WEIGHT:g} (SI), "
            f"got {weight:g}"
            for name, weight in weights.items()
            if weight and not SMALLEST_WEIGHT <= weight <= 1.0 / SMALLEST_WEIGHT
        ]
        if given and len(given) < len(TARGET_WEIGHTS):
            missing = ", ".join(n for n in TARGET_WEIGHTS if n not in given)
            found.append(f"expected all four target weights or none, missing {missing}")
        if (self.descent_rate > 0) != (self.desired_altitude_rate is not None):
            found.append("descent_rate and desired_altitude_rate: expected both or neither")
        terms = [self.bank_rate_effort, self.bank_rate_variation, self.heat_load, self.descent_rate]
        if not any([*terms, self.flight_time, self.ground_range]):
            found.append("expected at least one term: bank_rate_effort, flight_time, …")
        if found:
            raise ValueError("\n".join(found))
        return self


class GuessSection(Section):
    """Constant bank angle of the first guess. It selects the branch where several optima exist.

    With a heading corridor its sign turns over where the azimuth leaves bearing ± corridor.
    """

    bank_angle: u.CircularAngle = Field(ge=-TURN, le=TURN)
    heading_corridor: u.Angle | None = Field(default=None, gt=0, lt=np.pi)


class PhaseSection(Section):
    """One phase of the mesh; the last has no end."""

    end: u.Time | None = None
    degrees: tuple[Annotated[int, Field(strict=True)], ...]
    fractions: tuple[Number, ...] | None = None


class MeshSection(Section):
    """Phases in order of time."""

    phase: tuple[PhaseSection, ...] = Field(min_length=1)

    def build(self) -> Mesh:
        """The pseudospectral mesh."""
        return Mesh(tuple(Phase(p.degrees, p.end, p.fractions) for p in self.phase))


class GridSection(Section):
    """Offsets from the nominal numbers, one strictly increasing axis per parameter, Eq. (9)."""

    # by key, in the unit of the key
    offsets: dict[str, tuple[float, ...]] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _axes_increase(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        offsets = dict(leaves(data))
        for key, axis in offsets.items():
            if not isinstance(axis, list | tuple):
                raise ValueError(f"{key}: expected a list of offsets, got {axis!r}")
            for value in axis:
                if isinstance(value, bool) or not isinstance(value, int | float):
                    raise ValueError(f"{key}: expected a number, got {value!r}")
                if not abs(value) < sys.float_info.max:  # a TOML integer may be of any size
                    raise ValueError(f"{key}: expected finite offsets, got {value}")
            if len(axis) == 0 or np.any(np.diff(axis) <= 0):
                raise ValueError(f"{key}: expected strictly increasing offsets, got {list(axis)}")
            if 0 not in axis:
                raise ValueError(
                    f"{key}: expected offsets that contain 0, the nominal value, got {list(axis)}"
                )
        return {"offsets": offsets}


def leaves(table: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted path and value of every leaf: `target.longitude_deg` quoted or not, TOML allows both."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value


class Mission(Section):
    """A whole mission, frozen. Everything in SI and radians; load one with `load_mission`."""

    name: str = Field(pattern=r"^[a-z0-9_]+$")
    title: str = Field(pattern=r"^[^\x00-\x1f]*$")  # one line: it is a title in reports
    planet: PlanetSection
    atmosphere: AtmosphereSection
    vehicle: VehicleSection
    entry: EntrySection
    target: TargetSection
    limits: LimitsSection
    objective: ObjectiveSection
    mesh: MeshSection
    guess: GuessSection | None = None
    no_fly_zone: tuple[NoFlyZoneSection, ...] = ()
    grid: GridSection = GridSection()
    toml: str = Field(default="", repr=False)

    @model_validator(mode="after")
    def _parts_fit(self) -> Mission:
        faults = self.disagreements()
        try:
            _ = self.parameters
        except ValueError as error:
            faults.append(str(error))
        faults = faults or self._grid_faults()
        if faults:
            raise ValueError("\n".join(faults))
        return self

    def disagreements(self) -> list[str]:
        """What no section can tell alone, a sentence each, of the sections that are there."""
        found: list[str] = []
        for sections, check in (
            ("vehicle", self._vehicle_stands),
            ("mesh", self._mesh_stands),
            ("entry target", self._flight_slows_down),
            ("planet atmosphere vehicle limits entry", self._entry_keeps_limits),
            ("planet atmosphere vehicle limits target", self._target_keeps_limits),
            ("planet limits entry target no_fly_zone", self._zones_are_clear),
            ("limits guess", self._guess_keeps_its_limit),
        ):
            if not all(hasattr(self, name) for name in sections.split()):
                continue
            try:
                found += check()
            except ValueError as error:
                found.append(str(error))
        return list(dict.fromkeys(found))

    def _vehicle_stands(self) -> Iterator[str]:
        self.vehicle.build()
        yield from ()

    def _mesh_stands(self) -> Iterator[str]:
        _ = self.pseudospectral_mesh.segments
        yield from ()

    def _flight_slows_down(self) -> Iterator[str]:
        if self.target.speed >= self.entry.speed:
            yield (
                f"target.speed ({self.target.speed:g} m/s) must be below entry.speed "
                f"({self.entry.speed:g} m/s)"
            )

    def _entry_keeps_limits(self) -> Iterator[str]:
        yield from self._limits_exceeded_at("entry", [*self.entry_state, 0.0], 0.0)

    def _target_keeps_limits(self) -> Iterator[str]:
        limits, target, model = self.limits, self.target, self.flight_model
        at_target = [target.altitude, 0.0, 0.0, target.speed, 0.0, 0.0, 0.0]
        yield from self._limits_exceeded_at("target", at_target, LATE)
        floor, below = limits.drag_floor, limits.drag_floor_speed
        if floor is None or below is None or target.speed > below:
            return
        air = air_loads(model.vehicle, model.atmosphere, target.altitude, target.speed, LATE)
        drag, unit = (
            float(air.drag) / model.planet.load_factor_gravity,
            model.planet.load_factor_unit,
        )
        margin = limits.drag_floor_margin
        if not drag >= floor * (1.0 + margin):
            less = f" and a margin of {100.0 * margin:g} %" if margin else ""
            yield (
                f"limits.drag_floor: expected at most {drag:.4g} {unit}, the drag at the target; got "
                f"{floor:.4g}{less}; lower the floor or change the target"
            )

    def _limits_exceeded_at(self, place: str, state: list[float], time: float) -> Iterator[str]:
        model = self.flight_model
        printed = (("kPa", 1e-3), ("MW/m²", 1e-6), (model.planet.load_factor_unit, 1.0))
        values = path_constraints(model, state, time)
        for name, (unit, per_si), value in zip(LOADS, printed, values, strict=True):
            if not value <= self.limits.designed(name):  # NaN too
                margin, limit = getattr(self.limits, f"{name}_margin"), getattr(self.limits, name)
                less = f" less its margin of {100.0 * margin:g} %" if margin else ""
                yield (
                    f"limits.{name}: expected at least {float(value) * per_si:.4g} {unit}, its value at "
                    f"the {place}; got {limit * per_si:.4g}{less}; raise the limit or change the {place}"
                )

    def _zones_are_clear(self) -> Iterator[str]:
        sphere = self.planet.build().equatorial_radius
        ends: list[tuple[str, EntrySection | TargetSection]] = [("entry", self.entry)]
        if self.target.position == "fixed":
            ends.append(("target", self.target))
        for number, zone in enumerate(self.no_fly_zone, start=1):
            for place, end in ends:
                centre = (zone.longitude, zone.latitude)
                away = great_circle_distance(end.longitude, end.latitude, *centre, sphere)
                here = no_fly_zone(end.longitude, end.latitude, (*centre, zone.radius / sphere))
                if away < zone.radius or here > self.limits.share("no_fly_zone"):
                    yield (
                        f"no_fly_zone {number}: expected the {place} outside the zone, got it "
                        f"{away / 1e3:.0f} km from the centre of a zone of "
                        f"{zone.radius / 1e3:.0f} km{' and its margin' if away >= zone.radius else ''}; "
                        f"move the zone or the {place}"
                    )

    def _guess_keeps_its_limit(self) -> Iterator[str]:
        bank_angle = 0.0 if self.guess is None else on_turn_of(self.guess.bank_angle, 0.0)
        if abs(bank_angle) > self.limits.bank_angle:
            yield (
                f"guess.bank_angle: expected at most limits.bank_angle "
                f"({self.limits.bank_angle / u.DEGREE:.4g}°) in size, "
                f"got {bank_angle / u.DEGREE:.4g}°"
            )

    def _grid_faults(self) -> list[str]:
        """A sentence for every axis with a point where the mission could not be."""
        found = []
        for parameter in self.parameters:
            number, sentence = parameter.number, None
            if np.any(np.diff(parameter.axis) <= 0):
                sentence = (
                    f"expected offsets that differ beside the nominal value, "
                    f"{number.nominal / number.per_unit:.9g}; got {list(parameter.offsets)}, of which "
                    "some are lost in its rounding"
                )
            for offset in (o for o in parameter.offsets if o != 0.0 and sentence is None):
                there = self._moved([(number.path, number.nominal + offset * number.per_unit)])
                faults = number.faults(there) or there.disagreements()
                if faults:
                    sentence = f"at offset {offset:g}: {faults[0]}"
            if sentence is not None:
                found.append(f"grid.{parameter.key}: {sentence}")
        return found

    @cached_property
    def flight_model(self) -> FlightModel:
        """Planet, atmosphere and vehicle for the equations of motion."""
        planet = self.planet.build()
        return FlightModel(
            planet, self.atmosphere.build(planet.surface_gravity), self.vehicle.build()
        )

    @cached_property
    def pseudospectral_mesh(self) -> Mesh:
        """Phases and segments of the transcription."""
        return self.mesh.build()

    @property
    def entry_state(self) -> NDArray[np.float64]:
        """Nominal (h, θ, φ, V, γ, ψ) at the entry interface (m, rad, m/s)."""
        return np.array([getattr(self.entry, name) for name in ENTRY_STATES])

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """What the grid disperses: the d numbers of p, entry states first."""
        return resolve(self, self.grid.offsets)

    @property
    def grid_axes(self) -> tuple[NDArray[np.float64], ...]:
        """Values (not offsets; SI, rad) along each axis of the parameter space."""
        return tuple(parameter.axis for parameter in self.parameters)

    @property
    def nominal_parameters(self) -> NDArray[np.float64]:
        """The nominal p (d,), SI and radians."""
        return np.array([parameter.number.nominal for parameter in self.parameters])

    def with_parameters(self, values: ArrayLike) -> Mission:
        """The same mission at another p (d,), SI and radians, in the order of `parameters`."""
        given = parameter_values(self.parameters, values)
        paths = [parameter.number.path for parameter in self.parameters]
        return self._moved(list(zip(paths, given.tolist(), strict=True)))

    def family(self, values: ArrayLike) -> MissionFamily:
        """The mission at n vectors p (n, d), of any numbers whatever, for what works on many."""
        rows = np.asarray(values, dtype=float)
        paths = [parameter.number.path for parameter in self.parameters]
        if rows.ndim != 2 or rows.shape[1] != len(paths):
            raise ValueError(f"values: expected shape (n, {len(paths)}), got {rows.shape}")
        return MissionFamily(
            tuple(self._moved(list(zip(paths, row, strict=True))) for row in rows.tolist())
        )

    def with_entry(self, entry_state: ArrayLike) -> Mission:
        """The same mission from another entry state (h, θ, φ, V, γ, ψ; m, rad, m/s)."""
        values = np.asarray(entry_state, dtype=float)
        if values.shape != (6,) or not np.all(np.isfinite(values)):
            raise ValueError(f"entry_state: expected 6 finite numbers {ENTRY_STATES}, got {values}")
        paths = [("entry", name) for name in ENTRY_STATES]
        return self._moved(list(zip(paths, values.tolist(), strict=True)))

    def _moved(self, values: list[tuple[tuple[str, ...], float]]) -> Mission:
        """A copy with other numbers (SI), unchecked: they may stem from a measurement."""
        sections: dict[str, Any] = {}
        for path, value in values:
            section = sections.get(path[0], getattr(self, path[0]))
            sections[path[0]] = moved(section, path[1:], value)
        return self.model_copy(update=sections)

    def with_mesh(self, mesh: Mesh) -> Mission:
        """The same mission on another pseudospectral mesh."""
        phases = [
            PhaseSection.model_construct(end=p.end, degrees=p.degrees, fractions=p.fractions)
            for p in mesh.phases
        ]
        section = MeshSection.model_construct(phase=tuple(phases))
        copied = super().model_copy(update={"mesh": section})  # the model stays
        copied.__dict__["pseudospectral_mesh"] = mesh
        return copied

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other sections; what is derived from those is derived anew."""
        copied = super().model_copy(update=update, deep=deep)
        copied.__dict__.pop("parameters", None)
        if any(getattr(copied, name) is not getattr(self, name) for name in MODEL_SECTIONS):
            copied.__dict__.pop("flight_model", None)
        if copied.mesh is not self.mesh:
            copied.__dict__.pop("pseudospectral_mesh", None)
        return copied


@dataclass(frozen=True)
class _Source:
    label: str
    text: str


def mission_digest(mission: Mission) -> str:
    """SHA-256 of the mission's TOML: what a database and its flights belong to."""
    return hashlib.sha256(mission.toml.encode()).hexdigest()


def shipped_missions() -> list[str]:
    """Names of the missions in the package."""
    folder = resources.files("ampi.missions")
    return sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml"))


def _read(name_or_path: str | Path) -> _Source:
    path, known = Path(name_or_path), shipped_missions()
    shipped = str(name_or_path) in known and not path.is_file()
    if not shipped and (path.suffix == ".toml" or path.exists()):
        if not path.is_file():
            raise MissionError(f"mission: no file at {path}")
        try:
            return _Source(str(path), path.read_text(encoding="utf-8"))
        except UnicodeDecodeError:
            raise MissionError(f"{path}: not a text file in UTF-8") from None
    if not shipped:
        raise MissionError(
            f"mission: expected one of {', '.join(known)} or the path of a .toml file, "
            f"got {str(name_or_path)!r}"
        )
    file = resources.files("ampi.missions").joinpath(f"{name_or_path}.toml")
    return _Source(str(name_or_path), file.read_text(encoding="utf-8"))


def parse_mission(text: str, label: str = "mission") -> Mission:
    """Mission from TOML `text`; `label` opens the error messages."""
    text = text.removeprefix("\ufeff")  # the byte order mark of a text file
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MissionError(f"{label}: not valid TOML: {error}") from None
    try:
        return Mission.model_validate({**data, "toml": text})
    except ValidationError as error:
        lines = [line for fault in error.errors() for line in u.sentences(fault, data)]
        lines += _faults_of_the_rest(data, {str(f["loc"][0]) for f in error.errors() if f["loc"]})
        told = "\n".join(f"  {line}" for line in lines)
        raise MissionError(f"{label}: {len(lines)} faulty field(s)\n{told}") from None


def _faults_of_the_rest(data: dict[str, Any], faulty: set[str]) -> list[str]:
    """What does not fit together among the sections that no fault of their own keeps out."""
    if not faulty:
        return []
    fields = {name: info for name, info in Mission.model_fields.items() if name not in faulty}
    sections = {
        name: TypeAdapter(info.annotation).validate_python(data[name])
        for name, info in fields.items()
        if name in data and info.annotation is not None
    }
    rest = Mission.model_construct(**sections)
    for name in faulty:
        rest.__dict__.pop(name, None)  # a default is not what was asked for
    return rest.disagreements()


def load_mission(name_or_path: str | Path) -> Mission:
    """Load a shipped mission by name or any mission by the path of its TOML file.

    Raises
    ------
    MissionError
        If it does not exist or a field is faulty; every faulty field is named with what was
        expected and what came.
    """
    source = _read(name_or_path)
    return parse_mission(source.text, source.label)
