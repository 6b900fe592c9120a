"""The model of vehicle and air that flies: data, and the equations of motion in numpy of its own.

    rates(x, u, t) = ẋ,   x = (h, θ, φ, V, γ, ψ, σ),   u = σ̇                       Sagliano 2016, Eq. (2)

The air moves with the planet or blows (ampi/onboard/wind.py). The bank angle is about the velocity
through it; the schedule of the angle of attack goes by the speed over the ground.

No physics is imported: what flies stands by itself. The forms are those of `ampi.physics` with the same
coefficients, not tables drawn from them, so that both agree to rounding; a test holds them together.

All curves over altitude are one form, a Chebyshev polynomial within [0, top] and straight beyond,

    y(h) = Σ_k η^k (e_k + ξ o_k) + slopes outside,   ξ = 2 h/top − 1,   η = 2 ξ² − 1,               (1)

an exponential atmosphere is that of degree one in ln ρ. States may have any shape behind their first
axis: n flights, n flights at m instants. Nothing raises: what is no number comes out as none.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.aerodynamic_forms import AerodynamicForm
from ampi.onboard.row_layout import LINEAR_TRACKING, STATES
from ampi.onboard.wind import AirVelocity, Track

Array = NDArray[np.float64]

ALTITUDE, LONGITUDE, LATITUDE, SPEED, PATH_ANGLE, AZIMUTH, BANK = (
    LINEAR_TRACKING.index(row.name) for row in STATES
)
ANGLES = [LATITUDE, PATH_ANGLE, AZIMUTH, BANK]  # whose sines and cosines the rates need
LOADS = ("dynamic_pressure", "heat_flux", "load_factor")
CONTROL_LIMITS = ("bank_angle", "bank_rate")


@dataclass(frozen=True, eq=False)
class AltitudeCurve:
    """Eq. (1)."""

    top: float  # m
    terms: Array  # (k, 2): (e, o) by ascending powers of η
    edge_slopes: tuple[float, float]  # below 0 and above the top, 1/m

    def __post_init__(self) -> None:
        self.terms.setflags(write=False)

    def __call__(self, altitude: Any) -> Any:
        """Value at `altitude` (m)."""
        inside = np.minimum(np.maximum(altitude, 0.0), self.top)
        xi = inside * (2.0 / self.top) - 1.0
        eta = 2.0 * xi * xi - 1.0
        # one call for all powers: the loop of Horner's rule would take a third of a flight's time
        powers = np.empty((len(self.terms), *np.shape(eta)))
        powers[0], powers[1:] = 1.0, eta
        np.multiply.accumulate(powers, axis=0, out=powers)
        even, odd = np.einsum("kt,k...->t...", self.terms, powers)
        value = even + xi * odd
        below, above = np.minimum(altitude, 0.0), np.maximum(altitude - self.top, 0.0)
        return value + self.edge_slopes[0] * below + self.edge_slopes[1] * above


@dataclass(frozen=True, eq=False)
class Air:
    """Density and speed of sound over altitude."""

    log_density: AltitudeCurve  # ln (kg/m³)
    sound: AltitudeCurve  # ln c (c in m/s), or c²
    sound_is_squared: bool

    def density(self, altitude: Any) -> Any:
        """Density (kg/m³) at `altitude` (m)."""
        return np.exp(self.log_density(altitude))

    def speed_of_sound(self, altitude: Any) -> Any:
        """Speed of sound (m/s) at `altitude` (m)."""
        found = self.sound(altitude)
        return np.sqrt(found) if self.sound_is_squared else np.exp(found)


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Angle of attack (rad): two constants joined over time (s) or speed (m/s).

    f, the fraction of the way, is clipped to [0, 1], or rounded there by
    ½ [1 + √(f² + s²) − √((f − 1)² + s²)]; then joined by a line, or by the parabola f (2 − f).
    """

    over_time: bool  # else over speed
    start: float
    end: float
    start_angle: float
    end_angle: float
    is_parabola: bool
    smoothing: float  # s, as share of the way; 0: clipped

    def __call__(self, time: Any, speed: Any) -> Any:
        """Angle of attack at `time` (s) and `speed` (m/s)."""
        f = ((time if self.over_time else speed) - self.start) / (self.end - self.start)
        if self.smoothing > 0.0:
            s2 = self.smoothing * self.smoothing
            f = 0.5 * (1.0 + np.sqrt(f * f + s2) - np.sqrt((f - 1.0) * (f - 1.0) + s2))
        else:
            f = np.minimum(np.maximum(f, 0.0), 1.0)
        if self.is_parabola:
            f = f * (2.0 - f)
        return self.start_angle + (self.end_angle - self.start_angle) * f


@dataclass(frozen=True, eq=False, kw_only=True)
class Limits:
    """What a flight may use; numbers, or arrays over flights."""

    dynamic_pressure: Any  # Pa
    heat_flux: Any  # W/m²
    load_factor: Any  # g
    bank_angle: Any  # rad
    bank_rate: Any  # rad/s
    drag_floor: tuple[float, float] | None = (
        None  # m/s², where the speed (m/s) is at most the second
    )
    no_fly_zones: tuple[tuple[float, float, float], ...] = ()  # θ_c, φ_c, radius / R₀ (rad)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all limits, in order: those of `ampi.missions.path_limits`."""
        floor = () if self.drag_floor is None else ("drag_floor",)
        zones = (f"no_fly_zone {k}" for k in range(1, len(self.no_fly_zones) + 1))
        return (*LOADS, *floor, *zones, *CONTROL_LIMITS)


class Factors(NamedTuple):
    """What differs from the model: factors on density, lift, drag and mass; wind; angle of attack.

    Numbers, or arrays over flights. The numbers 0 as wind are still air; arrays of zeros are wind, so
    that no flight's last digits depend on whether the wind blows for another.
    """

    density: Any = 1.0
    lift: Any = 1.0
    drag: Any = 1.0
    mass: Any = 1.0
    wind_east: Any = 0.0  # m/s, towards
    wind_north: Any = 0.0
    angle_of_attack: Any = 0.0  # rad, on the schedule's

    @property
    def is_still(self) -> bool:
        """Whether no wind is given."""
        winds = (self.wind_east, self.wind_north)
        return all(np.ndim(wind) == 0 and wind == 0.0 for wind in winds)


class AirLoads(NamedTuple):
    """Lift and drag (m/s²), density (kg/m³), angle of attack (rad), speed through the air (m/s)."""

    lift: Any
    drag: Any
    density: Any
    angle_of_attack: Any
    speed: Any


NOMINAL = Factors()


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightModelData:
    """Planet, air, vehicle and limits of one mission (SI, rad)."""

    equatorial_radius: float
    gravitational_parameter: float
    j2: float
    rotation_rate: float
    load_factor_gravity: float  # m/s², the g in which load factors are counted
    air: Air
    aerodynamics: AerodynamicForm
    angle_of_attack: Schedule
    lift_factor: float  # on the lift coefficient
    drag_factor: float
    mass: float
    reference_area: float
    heat_flux_constant: float
    heat_flux_speed_exponent: float
    load_factor_is_total: bool  # √(L² + D²), else |L cos α + D sin α|
    limits: Limits = field(repr=False)

    def air_loads(self, state: Array, time: Any, factors: Factors = NOMINAL) -> AirLoads:
        """Of `state` (7, …) at `time` (s)."""
        return self._air_loads(state, time, factors, _through_air(state, factors))

    def _air_loads(
        self, state: Array, time: Any, factors: Factors, through_air: AirVelocity | None
    ) -> AirLoads:
        speed = state[SPEED] if through_air is None else through_air.speed
        density = factors.density * self.air.density(state[ALTITUDE])
        angle = self.angle_of_attack(time, state[SPEED]) + factors.angle_of_attack
        needs_mach = self.aerodynamics.needs_mach
        mach = speed / self.air.speed_of_sound(state[ALTITUDE]) if needs_mach else None
        lift, drag = self.aerodynamics.coefficients(angle, mach)
        pressure = 0.5 * density * speed * speed * (self.reference_area / self.mass / factors.mass)
        lift = pressure * (self.lift_factor * factors.lift * lift)
        drag = pressure * (self.drag_factor * factors.drag * drag)
        return AirLoads(lift, drag, density, angle, speed)

    def sensed(self, state: Array, time: Any, factors: Factors = NOMINAL) -> tuple[Any, Any, Any]:
        """What an ideal accelerometer senses (m/s²) at `state` (7, …) and `time` (s).

        Components along the velocity over the ground, normal to it in the vertical plane and upwards,
        and horizontally to its right; in still air (−D, L cos σ, L sin σ).
        """
        sin_bank, cos_bank = np.sin(state[BANK]), np.cos(state[BANK])
        through_air = _through_air(state, factors)
        air = self._air_loads(state, time, factors, through_air)
        if through_air is None:
            return -air.drag, air.lift * cos_bank, air.lift * sin_bank
        return through_air.along_the_track(air.drag, air.lift * cos_bank, air.lift * sin_bank)

    def rates(self, state: Array, bank_rate: Any, time: Any, factors: Factors = NOMINAL) -> Array:
        """ẋ (7, …) of `state` (7, …) under `bank_rate` (rad/s) at `time` (s)."""
        return self._rates(state, bank_rate, time, factors)[0]

    def rates_and_loads(
        self, state: Array, bank_rate: Any, time: Any, factors: Factors = NOMINAL
    ) -> tuple[Array, tuple[Any, Any, Any]]:
        """`rates` and `loads` at once: the air is looked up once."""
        rates, air = self._rates(state, bank_rate, time, factors)
        return rates, self._loads(air)

    def _rates(
        self, state: Array, bank_rate: Any, time: Any, factors: Factors
    ) -> tuple[Array, AirLoads]:
        altitude, speed = state[ALTITUDE], state[SPEED]
        angles = state[ANGLES]
        sin_lat, sin_fpa, sin_azi, sin_bank = np.sin(angles)
        cos_lat, cos_fpa, cos_azi, cos_bank = np.cos(angles)
        track = Track(sin_fpa, cos_fpa, sin_azi, cos_azi)
        through_air = _through_air(state, factors, track)
        air = self._air_loads(state, time, factors, through_air)
        along, up, right = -air.drag, air.lift * cos_bank, air.lift * sin_bank
        if through_air is not None:
            along, up, right = through_air.along_the_track(air.drag, up, right)
        radius = self.equatorial_radius + altitude
        g = self._gravity(radius, sin_lat)
        omega = self.rotation_rate
        centrifugal = omega * omega * radius * cos_lat
        level, turning = speed * cos_fpa, speed * cos_fpa / radius
        found = np.empty_like(state)
        found[ALTITUDE] = speed * sin_fpa
        found[LONGITUDE] = turning * sin_azi / cos_lat
        found[LATITUDE] = turning * cos_azi
        found[SPEED] = (
            centrifugal * (sin_fpa * cos_lat - cos_fpa * sin_lat * cos_azi) + along - g * sin_fpa
        )
        found[PATH_ANGLE] = (
            up / speed
            + (speed / radius - g / speed) * cos_fpa
            + 2.0 * omega * cos_lat * sin_azi
            + centrifugal / speed * (cos_fpa * cos_lat + sin_fpa * sin_lat * cos_azi)
        )
        found[AZIMUTH] = (
            right / level
            + turning * sin_azi * sin_lat / cos_lat
            - 2.0 * omega * (sin_fpa / cos_fpa * cos_lat * cos_azi - sin_lat)
            + centrifugal / level * sin_lat * sin_azi
        )
        found[BANK] = bank_rate
        return found, air

    def _gravity(self, radius: Any, sin_latitude: Any) -> Any:
        """μ/r² · [1 + 3/2 J2 (R_e/r)² (1 − 3 sin²φ)] (m/s²)."""
        share = self.equatorial_radius / radius
        oblateness = 1.5 * self.j2 * share * share * (1.0 - 3.0 * sin_latitude * sin_latitude)
        return self.gravitational_parameter / (radius * radius) * (1.0 + oblateness)

    def loads(self, state: Array, time: Any, factors: Factors = NOMINAL) -> tuple[Any, Any, Any]:
        """(q in Pa, Q̇ in W/m², n in g) at `state` (7, …) and `time` (s), Sagliano 2016, Eq. (4)."""
        return self._loads(self.air_loads(state, time, factors))

    def _loads(self, air: AirLoads) -> tuple[Any, Any, Any]:
        heat_flux = self.heat_flux_constant * np.sqrt(air.density)
        heat_flux = heat_flux * air.speed**self.heat_flux_speed_exponent
        if self.load_factor_is_total:
            load = np.sqrt(air.lift * air.lift + air.drag * air.drag)
        else:
            angle = air.angle_of_attack
            load = np.abs(air.lift * np.cos(angle) + air.drag * np.sin(angle))
        return 0.5 * air.density * air.speed * air.speed, heat_flux, load / self.load_factor_gravity

    def limit_use(
        self,
        state: Array,
        bank_rate: Any,
        time: Any,
        factors: Factors = NOMINAL,
        limits: Limits | None = None,
    ) -> Array:
        """(l, …): the share of each limit, in the order of their names, that is used; 1 is all of it."""
        own, speed = limits or self.limits, state[SPEED]
        air = self.air_loads(state, time, factors)
        bounds = (own.dynamic_pressure, own.heat_flux, own.load_factor)
        use = [load / most for load, most in zip(self._loads(air), bounds, strict=True)]
        if own.drag_floor is not None:
            least, fastest = own.drag_floor
            use.append((speed <= fastest) * (2.0 - air.drag / least))
        use += [_zone_use(state, zone) for zone in own.no_fly_zones]
        use += [np.abs(state[BANK]) / own.bank_angle, np.abs(bank_rate) / own.bank_rate]
        return np.stack(np.broadcast_arrays(*use))


def _through_air(state: Array, factors: Factors, track: Track | None = None) -> AirVelocity | None:
    """The velocity through the air; None: that over the ground."""
    if factors.is_still:
        return None
    winds = factors.wind_east, factors.wind_north
    return AirVelocity.of(state[SPEED], track or Track.of(state[PATH_ANGLE], state[AZIMUTH]), winds)


def _zone_use(state: Array, zone: tuple[float, float, float]) -> Any:
    """2 − hav d / hav ρ: 1 on the edge of a no-fly zone."""
    longitude, latitude, radius = zone
    away = (
        np.sin(0.5 * (latitude - state[LATITUDE])) ** 2
        + np.cos(state[LATITUDE])
        * np.cos(latitude)
        * np.sin(0.5 * (longitude - state[LONGITUDE])) ** 2
    )
    return 2.0 - away / np.sin(0.5 * radius) ** 2
