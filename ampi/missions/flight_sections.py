"""The sections of a mission file that bound the flight: its entry, its target and what it must keep."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Field, field_validator, model_validator

from ampi.missions import units as u
from ampi.missions.units import Section, dimension_of, in_units, symbol
from ampi.physics.angles import TURN, on_turn_of


class EntrySection(Section):
    """State at the entry interface, Table 1; the bank angle and its rate there are free unless given.

    A flight that is under way starts at a later `time`: the angle of attack and the mesh go by it, and
    phases of the mesh that are over by then are dropped.
    """

    altitude: u.Length = Field(ge=0, le=130e3, description="Height over the planet's surface")
    longitude: u.CircularAngle = Field(
        ge=-2 * TURN, le=2 * TURN, description="Longitude, east positive"
    )
    latitude: u.Angle = Field(
        gt=-0.5 * np.pi, lt=0.5 * np.pi, description="Latitude, north positive"
    )
    speed: u.Speed = Field(ge=10, le=12e3, description="Speed over the rotating ground")
    flight_path_angle: u.Angle = Field(
        gt=-0.5 * np.pi,
        lt=0.5 * np.pi,
        description="Of the velocity over the horizon; negative: descending",
    )
    azimuth: u.CircularAngle = Field(
        ge=-2 * TURN, le=2 * TURN, description="Of the velocity from north, clockwise"
    )
    bank_angle: u.CircularAngle | None = Field(
        default=None, ge=-TURN, le=TURN, description="Bank angle at entry; free unless given"
    )
    bank_rate: u.AngularRate | None = Field(
        default=None, description="Bank rate at entry; free unless given"
    )
    angle_of_attack: u.Angle | None = Field(
        default=None,
        description="Angle of attack at entry, where it is a control; free unless given",
    )
    angle_of_attack_rate: u.AngularRate | None = Field(
        default=None, description="Its rate at entry; free unless given"
    )
    time: u.Time = Field(
        default=0.0, ge=0, description="Since the entry interface, of a flight that is under way"
    )


def _written(name: str, value: float) -> str:
    """A number of a target with its unit, as a mission file has it."""
    dimension = dimension_of(TargetSection.model_fields[name])
    unit, number = in_units(dimension.name if dimension else "", value)
    return f"{number:.10g} {symbol(unit)}"


GivenState = Literal["altitude", "longitude", "latitude", "speed"]
GIVEN_STATES: tuple[GivenState, ...] = get_args(GivenState)  # of a target; the others may be absent
RANGES = (
    *(f"{name}_range" for name in GIVEN_STATES),
    "flight_path_angle",
    "azimuth",
    "bank_angle",
    "angle_of_attack",
)


class TargetSection(Section):
    """Where guided flight ends. Tolerances and radii serve the verdict, not the optimiser.

    A flight has passed where it ended within all three tolerances; `radii` are those within which
    flights are counted, by default a quarter, a half, once and twice the position tolerance.

    Altitude, longitude, latitude and speed are given; each is held, unless it is one of `free`, or its
    range [least, greatest] is given: then the number serves reports, guidance and verdict alone.
    `position = "free"` frees longitude and latitude; where one of them is free no distance is judged.
    Of the other states each is one number or a range; absent, it is free.
    """

    altitude: u.Length = Field(ge=0, le=120e3, description="Height over the planet's surface")
    longitude: u.CircularAngle = Field(
        ge=-2 * TURN, le=2 * TURN, description="Longitude, east positive"
    )
    latitude: u.Angle = Field(
        gt=-0.5 * np.pi, lt=0.5 * np.pi, description="Latitude, north positive"
    )
    speed: u.Speed = Field(
        ge=10, le=12e3, description="Speed over the ground at which guided flight ends"
    )
    altitude_tolerance: u.Length = Field(gt=0, description="±, of a flight that has passed")
    speed_tolerance: u.Speed = Field(gt=0, description="±, of a flight that has passed")
    position_tolerance: u.Length = Field(
        default=10e3, gt=0, description="Distance from the target, of a flight that has passed"
    )
    radii: u.Lengths | None = Field(
        default=None,
        description="About the target, within which flights are counted, increasing; by default "
        "¼, ½, 1 and 2 times the position tolerance",
    )
    position: Literal["fixed", "free"] = Field(
        default="fixed",
        description="fixed, or free: longitude and latitude then only serve the reports",
    )
    free: tuple[GivenState, ...] = Field(
        default=(),
        description="Of altitude, longitude, latitude and speed, those that an optimum may end at as it "
        "likes",
    )
    altitude_range: u.LengthRange | None = Field(
        default=None, description="[least, greatest] that an optimum may end at, about `altitude`"
    )
    longitude_range: u.CircularRange | None = Field(
        default=None, description="[least, greatest] that an optimum may end at, about `longitude`"
    )
    latitude_range: u.AngleRange | None = Field(
        default=None, description="[least, greatest] that an optimum may end at, about `latitude`"
    )
    speed_range: u.SpeedRange | None = Field(
        default=None, description="[least, greatest] that an optimum may end at, about `speed`"
    )
    flight_path_angle: u.AngleRange | None = Field(
        default=None, description="A number or [least, greatest]; free unless given"
    )
    azimuth: u.CircularRange | None = Field(
        default=None, description="A number or [least, greatest]; free unless given"
    )
    bank_angle: u.CircularRange | None = Field(
        default=None, description="A number or [least, greatest]; free unless given"
    )
    angle_of_attack: u.AngleRange | None = Field(
        default=None,
        description="A number or [least, greatest], where it is a control; free unless given",
    )

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

    @property
    def free_states(self) -> tuple[str, ...]:
        """Those of the given states that are free."""
        place = ("longitude", "latitude") if self.position == "free" else ()
        return tuple(name for name in GIVEN_STATES if name in (*place, *self.free))

    @property
    def place_is_free(self) -> bool:
        """Whether no distance is judged: longitude or latitude are free."""
        return bool({"longitude", "latitude"} & set(self.free_states))

    def held_by(self, state: str) -> str | None:
        """The field that an optimum ends at, a number or a range; None: the state is free."""
        if state in self.free_states or getattr(self, state) is None:
            return None
        ranged = state in GIVEN_STATES and getattr(self, f"{state}_range") is not None
        return f"{state}_range" if ranged else state

    @field_validator(*RANGES, mode="before")
    @classmethod
    def _number_is_a_range(cls, value: Any) -> Any:
        return (value, value) if isinstance(value, float) else value

    @field_validator("azimuth", "bank_angle", "longitude_range")
    @classmethod
    def _range_crosses_south(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        """[170°, −170°] is [170°, 190°]."""
        if value is not None and value[0] - value[1] > 0.5 * TURN:
            return value[0], value[1] + TURN
        return value

    @field_validator(*RANGES)
    @classmethod
    def _range_increases(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[1] < value[0]:
            raise ValueError("expected a number or [least, greatest]")
        return value

    @model_validator(mode="after")
    def _each_state_is_told_once(self) -> TargetSection:
        found = []
        if len(set(self.free)) < len(self.free):
            found.append(f"free: expected each state once, got {', '.join(self.free)}")
        for name in GIVEN_STATES:
            span, number = getattr(self, f"{name}_range"), getattr(self, name)
            if span is None:
                continue
            if name in self.free_states:
                found.append(f"{name}_range: expected none, for {name} is free; remove one of them")
            middle = 0.5 * (span[0] + span[1])
            about = on_turn_of(number, middle) if name == "longitude" else number
            if not span[0] <= about <= span[1]:
                low, high, came = (_written(name, value) for value in (*span, number))
                found.append(
                    f"{name}: expected a number in {name}_range, {low} to {high}, got {came}"
                )
        if found:
            raise ValueError("\n".join(found))
        return self


Margin = Annotated[float, Field(strict=True, ge=0, lt=1)]


class LimitsSection(Section):
    """Bank angle, rate and acceleration (±), the three path constraints of Eq. (4), a drag floor.

    A change of the angle of attack (±, on the reference's), its rate and its acceleration (±) are what
    guidance may use beside the bank angle; absent, it flies by bank alone. No optimum uses them.

    Load factor and drag floor are counted in the planet's g₀ (`PlanetSection`).

    The drag floor (Liu 2015, Eq. 73) holds where the speed is below `drag_floor_speed`. A margin is the
    share of a limit that an optimum leaves unused (path_limits); verdicts judge by the limit itself.
    """

    bank_angle: u.Angle = Field(gt=0, le=np.pi, description="Greatest size of the bank angle")
    bank_angle_minimum: u.Angle = Field(
        default=0.0, ge=0, lt=0.5 * np.pi, description="Least size of the bank angle"
    )
    bank_rate: u.AngularRate = Field(gt=0, description="Greatest size of the bank rate")
    bank_acceleration: u.AngularAcceleration = Field(
        gt=0, description="Greatest size of the bank acceleration"
    )
    angle_of_attack_change: u.Angle | None = Field(
        default=None,
        gt=0,
        lt=0.5 * np.pi,
        description="±, on the reference, that guidance may use; none: it flies by bank alone",
    )
    angle_of_attack_rate: u.AngularRate | None = Field(
        default=None, gt=0, description="±, of that change"
    )
    angle_of_attack_acceleration: u.AngularAcceleration = Field(
        default=4.0 * u.DEGREE, gt=0, description="±, of that change's rate"
    )
    dynamic_pressure: u.Pressure = Field(gt=0, description="Greatest dynamic pressure")
    heat_flux: u.HeatFlux = Field(gt=0, description="Greatest heat flux")
    load_factor: u.LoadFactor = Field(gt=0, description="Greatest load factor, in the planet's g₀")
    drag_floor: u.LoadFactor | None = Field(
        default=None, gt=0, description="Least drag, in the planet's g₀, Liu 2015, Eq. (73)"
    )
    drag_floor_speed: u.Speed | None = Field(
        default=None, gt=0, description="The drag floor holds below it"
    )
    bank_angle_margin: Margin = Field(
        default=0.0, description="Share of the limit that an optimum leaves unused"
    )
    bank_rate_margin: Margin = Field(
        default=0.0, description="Share of the limit that an optimum leaves unused"
    )
    dynamic_pressure_margin: Margin = Field(
        default=0.0, description="Share of the limit that an optimum leaves unused"
    )
    heat_flux_margin: Margin = Field(
        default=0.0, description="Share of the limit that an optimum leaves unused"
    )
    load_factor_margin: Margin = Field(
        default=0.0, description="Share of the limit that an optimum leaves unused"
    )
    drag_floor_margin: Margin = Field(
        default=0.0, description="Share of the floor that an optimum stays above it"
    )
    no_fly_zone_margin: Margin = Field(
        default=0.0, description="Share of every zone's radius that an optimum stays away besides"
    )

    def share(self, limit: str) -> float:
        """What an optimum may use of a limit (`PathLimits.names`): 1 − its margin.

        The angle of attack has bounds of its own, and no margin.
        """
        if limit.startswith("angle_of_attack"):
            return 1.0
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

    longitude: u.CircularAngle = Field(
        ge=-2 * TURN, le=2 * TURN, description="Of its centre, east positive"
    )
    latitude: u.Angle = Field(
        ge=-0.5 * np.pi, le=0.5 * np.pi, description="Of its centre, north positive"
    )
    radius: u.Length = Field(gt=0, description="On the ground")
