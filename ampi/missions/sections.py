"""What a mission file may say: its sections, each checked by itself, and all of them together."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from ampi.missions import units as u
from ampi.missions.angle_of_attack import AngleOfAttackControlSection
from ampi.missions.flight_sections import (
    EntrySection,
    LimitsSection,
    NoFlyZoneSection,
    TargetSection,
)
from ampi.missions.grid import GridSection
from ampi.missions.model_sections import AtmosphereSection, PlanetSection, VehicleSection
from ampi.missions.text import toml_text
from ampi.missions.units import Number, Section, sentences
from ampi.physics.angles import TURN
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.state import ENTRY_STATES
from ampi.pseudospectral.mesh import Mesh, Phase

MODEL_SECTIONS = ("planet", "atmosphere", "vehicle")  # what the flight model is made of


TARGET_WEIGHTS = ("altitude_weight", "longitude_weight", "latitude_weight", "speed_weight")


TERMS = (  # of the objective, beside the target weights
    "bank_rate_effort",
    "bank_rate_variation",
    "flight_time",
    "heat_load",
    "ground_range",
    "descent_rate",
    "cross_range",
    "final_speed",
    "angle_of_attack_effort",
)

SMALLEST_WEIGHT = 1e-20  # in SI, and the inverse of the largest


class ObjectiveSection(Section):
    """What is minimised: a weighted sum of the terms that are given.

    With the four target weights (all or none) the target is a quadratic cost, Sagliano 2016,
    Eq. (1); without them it is to be met exactly.
    """

    altitude_weight: u.PerLengthSquared | None = Field(
        default=None, ge=0, description="Of the squared miss in altitude"
    )
    longitude_weight: u.PerAngleSquared | None = Field(
        default=None, ge=0, description="Of the squared miss in longitude"
    )
    latitude_weight: u.PerAngleSquared | None = Field(
        default=None, ge=0, description="Of the squared miss in latitude"
    )
    speed_weight: u.PerSpeedSquared | None = Field(
        default=None, ge=0, description="Of the squared miss in speed"
    )
    bank_rate_effort: Number = Field(default=0.0, ge=0, description="Of ∫ σ̇² dt, per (deg/s)² s")
    bank_rate_variation: Number = Field(default=0.0, ge=0, description="Of ∫ |σ̇| dt, per deg")
    flight_time: Number = Field(
        default=0.0, description="Of the final time, per s; negative: longest flight"
    )
    heat_load: Number = Field(default=0.0, ge=0, description="Of ∫ Q̇ dt, per MJ/m²")
    ground_range: Number = Field(
        default=0.0, description="Of ∫ V cos γ R/r dt, per km; negative: farthest flight"
    )
    cross_range: Number = Field(
        default=0.0,
        description="Of the final distance out of the plane of the entry's great circle, per km, "
        "positive to the left of the entry's heading; negative: farthest to the left",
    )
    final_speed: Number = Field(
        default=0.0, description="Of the final speed, per m/s; negative: fastest"
    )
    angle_of_attack_effort: Number = Field(
        default=0.0, ge=0, description="Of ∫ α̇² dt, per (deg/s)² s, where α is a control"
    )
    descent_rate: Number = Field(
        default=0.0, ge=0, description="Of ∫ |ḣ − desired_altitude_rate| dt, per m"
    )
    desired_altitude_rate: u.Speed | None = Field(
        default=None,
        description="The ḣ that the descent rate is measured from; negative: descending",
    )

    @property
    def has_terminal(self) -> bool:
        """Whether it weighs the final state by itself."""
        return self.cross_range != 0.0 or self.final_speed != 0.0

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
        if not any(getattr(self, name) for name in TERMS):
            found.append("expected at least one term: bank_rate_effort, flight_time, …")
        if found:
            raise ValueError("\n".join(found))
        return self


class GuessSection(Section):
    """Constant bank angle of the first guess. It selects the branch where several optima exist.

    With a heading corridor its sign turns over where the azimuth leaves bearing ± corridor.
    """

    bank_angle: u.CircularAngle = Field(ge=-TURN, le=TURN, description="Held from entry to target")
    angle_of_attack: u.Angle | None = Field(
        default=None,
        ge=-np.pi,
        le=np.pi,
        description="Held likewise where it is a control; by default in the middle of its bounds",
    )
    heading_corridor: u.Angle | None = Field(
        default=None,
        gt=0,
        lt=np.pi,
        description="Its sign turns over where the azimuth leaves the bearing by that much",
    )


class PhaseSection(Section):
    """One phase of the mesh; the last has no end."""

    end: u.Time | None = Field(
        default=None, description="Time since entry; the last phase has none"
    )
    degrees: tuple[Annotated[int, Field(strict=True)], ...] = Field(
        description="Of the polynomial in each segment"
    )
    fractions: tuple[Number, ...] | None = Field(
        default=None,
        description="Ends of the segments as fractions of the phase, from 0 to 1; even by default",
    )


class MeshSection(Section):
    """Phases in order of time."""

    phase: tuple[PhaseSection, ...] = Field(
        min_length=1, description="A phase: its end, and the degrees of its segments"
    )

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

    name: str = Field(pattern=r"^[a-z0-9_]+$", description="Small letters, digits and _")
    title: str = Field(pattern=r"^[^\x00-\x1f]*$", description="One line, as reports print it")
    planet: PlanetSection = Field(description="Its shape, its gravity, its rotation")
    atmosphere: AtmosphereSection = Field(description="Density and speed of sound over altitude")
    vehicle: VehicleSection = Field(
        description="What flies, and how its angle of attack is scheduled"
    )
    angle_of_attack: AngleOfAttackControlSection | None = Field(
        default=None,
        description="Steers the angle of attack by a second control, in the place of a schedule",
    )
    entry: EntrySection = Field(
        description="Where guided flight begins; bank angle and its rate there are free unless given"
    )
    target: TargetSection = Field(
        description="Where guided flight ends; tolerances and radii serve the verdict, not the optimiser"
    )
    limits: LimitsSection = Field(description="What the flight must keep")
    no_fly_zone: tuple[NoFlyZoneSection, ...] = Field(
        default=(), description="Circles on the ground that the flight stays out of"
    )
    objective: ObjectiveSection = Field(
        description="What is minimised: a weighted sum of the terms that are given. With the four "
        "target weights (all or none) the target is a quadratic cost; without them it is met exactly"
    )
    guess: GuessSection | None = Field(
        default=None,
        description="The first guess; it selects the branch where several optima exist",
    )
    mesh: MeshSection = Field(description="Of the transcription: phases in order of time")
    grid: GridSection = Field(
        default=GridSection(),
        description="Offsets from the nominal numbers, an increasing axis with 0 for each parameter; "
        "any number of the mission may be one, by its path and unit",
    )

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
    def n_states(self) -> int:
        """Seven, or eight where the angle of attack is a control."""
        return self.flight_model.n_states

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
