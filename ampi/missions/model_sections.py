"""The sections of a mission file that make its flight model: planet, atmosphere and vehicle."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ampi.missions import units as u
from ampi.missions.units import Dimension, Number, Section
from ampi.physics.aerodynamics import (
    Aerodynamics,
    ModifiedNewtonian,
    PolynomialDragPolar,
    TabulatedAerodynamics,
)
from ampi.physics.atmosphere import (
    SPECIFIC_HEAT_RATIO,
    Atmosphere,
    ExponentialAtmosphere,
    StandardAtmosphere1976,
    TableAtmosphere,
)
from ampi.physics.planet import WGS84, Planet
from ampi.physics.vehicle import AngleOfAttackSchedule, Vehicle


class PlanetSection(Section):
    """`wgs84`, or a sphere given by radius and surface gravity.

    Load factors (`load_factor_g`, `drag_floor_g`) are counted in g₀ = `load_factor_gravity`: 9.782 m/s²
    of wgs84, of a sphere its own surface gravity, unless the mission gives another (9.80665 for limits
    in the Earth's g on Mars).
    """

    model: Literal["wgs84", "sphere"] = Field(
        description="wgs84 (ellipsoid, J2, rotation), or a sphere of the numbers below"
    )
    radius: u.Length | None = Field(default=None, gt=0, description="Radius of the sphere")
    surface_gravity: Number | None = Field(
        default=None, gt=0, description="Gravity on the surface of the sphere (m/s²)"
    )
    rotation_rate: Number | None = Field(
        default=None,
        description="Of the sphere about its axis (rad/s); without one it stands still",
    )
    load_factor_gravity: Number | None = Field(
        default=None,
        gt=0,
        description="g₀ that load factors are counted in (m/s²); else the surface gravity",
    )

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
            gravitational_parameter=self.surface_gravity * (self.radius * self.radius),
            j2=0.0,
            rotation_rate=0.0 if self.rotation_rate is None else self.rotation_rate,
            load_factor_gravity=self.surface_gravity
            if self.load_factor_gravity is None
            else self.load_factor_gravity,
        )


OWN_FIELDS = {  # of each model of the atmosphere; the density factor is of all
    "us76": (),
    "exponential": ("surface_density", "scale_height", "specific_heat_ratio"),
    "table": ("altitude", "density", "speed_of_sound"),
}


class AtmosphereSection(Section):
    """`us76`, `exponential` with surface density (kg/m³) and scale height, or a `table`; and a factor.

    An exponential atmosphere is isothermal: its speed of sound, √(κ g H), follows from its scale height
    H, the planet's surface gravity g and its `specific_heat_ratio` κ (1.4 of air, 1.29 of CO₂).

    A table has `altitude`, `density` (kg/m³) and `speed_of_sound` from the ground to the entry altitude
    at least. A mission file may name a CSV in their place (`file`, air_table); a mission holds them.
    """

    model: Literal["us76", "exponential", "table"] = Field(
        description="us76, exponential (isothermal), or a table over altitude"
    )
    density_factor: Number = Field(default=1.0, gt=0, description="On the model's density")
    surface_density: Number | None = Field(
        default=None, gt=0, description="Of the exponential model at altitude 0 (kg/m³)"
    )
    scale_height: u.Length | None = Field(
        default=None, gt=0, description="Of the exponential model"
    )
    specific_heat_ratio: Number | None = Field(
        default=None,
        gt=1,
        description="κ of the exponential model's speed of sound; 1.4 unless given",
    )
    altitude: u.Lengths | None = Field(
        default=None,
        description="Of the table's rows, increasing, from the ground to the entry at least; or the "
        "whole table in a CSV: `file` (columns altitude_m, density_kg_per_m3, speed_of_sound_m_per_s)",
    )
    density: tuple[Number, ...] | None = Field(
        default=None, description="In the table's rows (kg/m³)"
    )
    speed_of_sound: u.Speeds | None = Field(default=None, description="In the table's rows")

    @model_validator(mode="after")
    def _model_is_complete(self) -> AtmosphereSection:
        if self.model == "exponential" and (
            self.surface_density is None or self.scale_height is None
        ):
            raise ValueError("exponential needs surface_density (kg/m³) and scale_height_m")
        if self.model == "table" and None in (self.altitude, self.density, self.speed_of_sound):
            raise ValueError(
                "table needs altitude_km, density (kg/m³) and speed_of_sound_m_per_s, or a file of them"
            )
        own = OWN_FIELDS.get(self.model, ())  # a changed object may have any name
        given = self.model_fields_set - {"model", "density_factor", *own}
        if given:
            what = "complete in itself" if not own else f"complete with {', '.join(own)}"
            raise ValueError(f"{self.model} is {what}; remove {', '.join(sorted(given))}")
        return self

    def build(self, surface_gravity: float) -> Atmosphere:
        """The physics object over a planet of `surface_gravity` (m/s²).

        Raises
        ------
        ValueError
            If it is a table that cannot be made smooth.
        """
        if self.altitude and self.density and self.speed_of_sound:
            table = TableAtmosphere.of(self.altitude, self.density, self.speed_of_sound)
            return replace(table, density_factor=self.density_factor)
        if self.surface_density is None or self.scale_height is None:
            return StandardAtmosphere1976(density_factor=self.density_factor)
        return ExponentialAtmosphere(
            surface_density=self.surface_density,
            scale_height=self.scale_height,
            surface_gravity=surface_gravity,
            specific_heat_ratio=SPECIFIC_HEAT_RATIO
            if self.specific_heat_ratio is None
            else self.specific_heat_ratio,
            density_factor=self.density_factor,
        )


class ModifiedNewtonianSection(Section):
    """C_N = normal_quadratic · sin²α + normal_linear · sin α; C_A = axial."""

    model: Literal["modified_newtonian"] = Field(
        description="C_N = normal_quadratic sin²α + normal_linear sin α, C_A = axial"
    )
    normal_quadratic: Number = Field(description="Of the normal-force coefficient, times sin²α")
    normal_linear: Number = Field(description="Of the normal-force coefficient, times sin α")
    axial: Number = Field(description="Axial-force coefficient")

    def build(self) -> Aerodynamics:
        """The physics object."""
        return ModifiedNewtonian(
            normal_quadratic=self.normal_quadratic,
            normal_linear=self.normal_linear,
            axial=self.axial,
        )


class PolynomialSection(Section):
    """C_L = Σ lift[k] α^k (α in degrees), C_D = Σ drag[k] C_L^k."""

    model: Literal["polynomial"] = Field(
        description="C_L a polynomial in α (degrees), C_D one in C_L"
    )
    lift: tuple[Number, ...] = Field(description="Coefficients of α⁰, α¹, … (α in degrees)")
    drag: tuple[Number, ...] = Field(description="Coefficients of C_L⁰, C_L¹, …")

    def build(self) -> Aerodynamics:
        """The physics object."""
        return PolynomialDragPolar(lift=self.lift, drag=self.drag)


class TableSection(Section):
    """Rows over angle of attack, columns over Mach number."""

    model: Literal["table"] = Field(
        description="C_L and C_D in a table over angle of attack and Mach number"
    )
    angle_of_attack: Annotated[tuple[Number, ...], Dimension("angle")] = Field(
        description="Of the table's rows, increasing; or the whole table in a CSV: `file` (columns "
        "angle_of_attack_deg, mach, lift, drag)"
    )
    mach: tuple[Number, ...] = Field(description="Of the table's columns, increasing")
    lift: tuple[tuple[Number, ...], ...] = Field(
        description="C_L: a list for each angle of attack, a number for each Mach number"
    )
    drag: tuple[tuple[Number, ...], ...] = Field(
        description="C_D: a list for each angle of attack, a number for each Mach number"
    )

    def build(self) -> Aerodynamics:
        """The physics object."""
        return TabulatedAerodynamics(
            angle_of_attack=self.angle_of_attack, mach=self.mach, lift=self.lift, drag=self.drag
        )


class AngleOfAttackSection(Section):
    """Two constant angles joined by a line or a parabola over time (s) or speed (m/s)."""

    variable: Literal["time", "speed"] = Field(
        description="What the schedule goes by: time (s) or speed (m/s)"
    )
    shape: Literal["line", "parabola"] = Field(
        default="line", description="How the two constant angles are joined"
    )
    start: Number = Field(
        description="Where the first angle ends, in the variable's unit (s or m/s)"
    )
    end: Number = Field(
        description="Where the second angle begins, in the variable's unit (s or m/s)"
    )
    start_angle: u.Angle = Field(description="Angle of attack before `start`")
    end_angle: u.Angle = Field(description="Angle of attack after `end`")
    smoothing: Number = Field(
        default=0.0,
        ge=0,
        description="Rounds the kinks, in the variable's unit (s or m/s); 0: none",
    )

    def build(self) -> AngleOfAttackSchedule:
        """The physics object."""
        return AngleOfAttackSchedule(
            variable=self.variable,
            shape=self.shape,
            start=self.start,
            end=self.end,
            start_angle=self.start_angle,
            end_angle=self.end_angle,
            smoothing=self.smoothing,
        )


class VehicleSection(Section):
    """Mass, reference area, heat-flux model, aerodynamics and angle-of-attack schedule."""

    mass: u.Mass = Field(gt=0, description="Mass")
    reference_area: u.Area = Field(gt=0, description="Area that the coefficients refer to")
    heat_flux_constant: Number = Field(
        gt=0, description="k of the heat flux k √ρ Vⁿ (SI: kg^(1/2)/m³ for n = 3)"
    )
    heat_flux_speed_exponent: Number = Field(
        default=3.0, ge=1, le=4, description="n of the heat flux k √ρ Vⁿ"
    )
    load_factor: Literal["normal", "total"] = Field(
        default="normal", description="normal: L cos α + D sin α; total: √(L² + D²)"
    )
    lift_factor: Number = Field(default=1.0, gt=0, description="On the model's lift coefficient")
    drag_factor: Number = Field(default=1.0, gt=0, description="On the model's drag coefficient")
    aerodynamics: Annotated[
        ModifiedNewtonianSection | PolynomialSection | TableSection, Field(discriminator="model")
    ] = Field(description="Coefficients: modified_newtonian, polynomial, or a table")
    angle_of_attack: AngleOfAttackSection | None = Field(
        default=None,
        description="Schedule of the angle of attack; none where [angle_of_attack] steers it",
    )

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
            angle_of_attack=None if self.angle_of_attack is None else self.angle_of_attack.build(),
        )
