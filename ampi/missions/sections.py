"""What a mission file may say: its sections, each checked by itself, and all of them together."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, field_validator, model_validator

from ampi.missions import units as u
from ampi.missions.grid import GridSection
from ampi.missions.model_sections import AtmosphereSection, PlanetSection, VehicleSection
from ampi.missions.text import toml_text
from ampi.missions.units import Number, Section, sentences
from ampi.physics.angles import TURN
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.state import ENTRY_STATES
from ampi.pseudospectral.mesh import Mesh, Phase

MODEL_SECTIONS = ("planet", "atmosphere", "vehicle")  # what the flight model is made of


class EntrySection(Section):
    """State at the entry interface, Table 1; the bank angle and its rate there are free unless given.

    A flight that is under way starts at a later `time`: the angle of attack and the mesh go by it, and
    phases of the mesh that are over by then are dropped.
    """

    altitude: u.Length = Field(ge=0, le=130e3)
    longitude: u.CircularAngle = Field(ge=-2 * TURN, le=2 * TURN)
    latitude: u.Angle = Field(gt=-0.5 * np.pi, lt=0.5 * np.pi)
    speed: u.Speed = Field(ge=10, le=12e3)
    flight_path_angle: u.Angle = Field(gt=-0.5 * np.pi, lt=0.5 * np.pi)
    azimuth: u.CircularAngle = Field(ge=-2 * TURN, le=2 * TURN)
    bank_angle: u.CircularAngle | None = Field(default=None, ge=-TURN, le=TURN)
    bank_rate: u.AngularRate | None = None
    time: u.Time = Field(default=0.0, ge=0)


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

    A change of the angle of attack (±, on the schedule's) and its rate (±) are what guidance may use
    beside the bank angle; absent, it flies by bank alone. No optimum uses them.

    Load factor and drag floor are counted in the planet's g₀ (`PlanetSection`).

    The drag floor (Liu 2015, Eq. 73) holds where the speed is below `drag_floor_speed`. A margin is the
    share of a limit that an optimum leaves unused (path_limits); verdicts judge by the limit itself.
    """

    bank_angle: u.Angle = Field(gt=0, le=np.pi)
    bank_angle_minimum: u.Angle = Field(default=0.0, ge=0, lt=0.5 * np.pi)  # of |σ|
    bank_rate: u.AngularRate = Field(gt=0)
    bank_acceleration: u.AngularAcceleration = Field(gt=0)
    angle_of_attack_change: u.Angle | None = Field(default=None, gt=0, lt=0.5 * np.pi)
    angle_of_attack_rate: u.AngularRate | None = Field(default=None, gt=0)
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
    def _pairs_are_complete(self) -> LimitsSection:
        found = []
        if (self.angle_of_attack_change is None) != (self.angle_of_attack_rate is None):
            found.append(
                "angle_of_attack_change_deg and angle_of_attack_rate_deg_per_s: expected both or neither"
            )
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

    @classmethod
    def of(cls, mesh: Mesh) -> MeshSection:
        """The section that makes `mesh`."""
        return cls(
            phase=tuple(
                PhaseSection.model_construct(
                    end=None if p.end is None else float(p.end),
                    degrees=tuple(int(degree) for degree in p.degrees),
                    fractions=None if p.fractions is None else tuple(map(float, p.fractions)),
                )
                for p in mesh.phases
            )
        )

    @property
    def toml(self) -> str:
        """The `[[mesh.phase]]` tables of a mission file."""
        return toml_text({"mesh": self.as_written()})

    def build(self) -> Mesh:
        """The pseudospectral mesh."""
        return Mesh(tuple(Phase(p.degrees, p.end, p.fractions) for p in self.phase))


class MissionError(ValueError):
    """A mission, or a mission file, that cannot be used; the message names every faulty field."""


class MissionSections(Section):
    """All that a mission file says, and the physics and the mesh that it makes."""

    name: str = Field(pattern=r"^[a-z0-9_]+$")
    title: str = Field(pattern=r"^[^\x00-\x1f]*$")  # one line: it is a title in reports
    planet: PlanetSection
    atmosphere: AtmosphereSection
    vehicle: VehicleSection
    entry: EntrySection
    target: TargetSection
    limits: LimitsSection
    no_fly_zone: tuple[NoFlyZoneSection, ...] = ()
    objective: ObjectiveSection
    guess: GuessSection | None = None
    mesh: MeshSection
    grid: GridSection = GridSection()

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
        return self.mesh.build().after(self.entry.time)

    @property
    def entry_state(self) -> NDArray[np.float64]:
        """Nominal (h, θ, φ, V, γ, ψ) at the entry interface (m, rad, m/s)."""
        return np.array([getattr(self.entry, name) for name in ENTRY_STATES])

    def checked(self, *, whole: bool = True) -> Self:
        """This mission, if a mission file can say it; if not `whole`, each of its sections.

        What a measurement has moved may well disagree with the rest, and is a hard problem, not a fault.

        Raises
        ------
        MissionError
            One sentence that names what no file could say.
        """
        faults = self.section_faults or (self.own_faults if whole else ())
        if faults:
            raise MissionError(f"{self.name}: {'; '.join(faults)}")
        return self

    @cached_property
    def section_faults(self) -> tuple[str, ...]:
        """Why no mission file could have one of its sections: a sentence each."""
        given = {name: getattr(self, name) for name in type(self).model_fields}
        try:
            read = MissionSections.model_validate(given)
        except ValidationError as error:
            return tuple(line for fault in error.errors() for line in sentences(fault, given))
        found = []
        for name, value in given.items():
            if type(getattr(read, name)) is not type(value):
                found.append(f"{name}: expected a section of a mission, got {value!r}")
            several = value if isinstance(value, tuple) else (value,)
            for section in (section for section in several if isinstance(section, Section)):
                found += [f"{name}.{fault}" for fault in section.own_faults]
        return tuple(found)
