"""The flight model as it is, flight by flight: the mission's, changed by what is true (`Truth`).

    ρ(h) = k_ρ p_ρ(h) ρ_mission(h),   C_L = k_L C_L,mission,   C_D = k_D C_D,mission,
    m = k_m m_mission,   α = α_schedule + δα,   wind (w_E, w_N)(h)

with p_ρ and the wind linear between points that are equally spaced over altitude. Guidance knows none
of these numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.physics.atmosphere import Atmosphere
from ampi.physics.equations_of_motion import FlightModel
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Profiles:
    """Functions of altitude, each linear between points `step` (m) apart from 0, of n flights."""

    step: float
    values: Array  # (n, k, functions)

    def __call__(self, altitude: Array) -> Array:
        """(functions, n) at the altitudes (n,) of the flights; held at both ends."""
        n, k, functions = self.values.shape
        place = np.minimum(np.maximum(altitude * (1.0 / self.step), 0.0), k - 1.0)
        # not-a-number has no place, and is to come out as it is
        below = np.minimum(np.fmax(place, 0.0).astype(np.intp), k - 2)
        share = place - below
        below += np.arange(n) * k
        flat = self.values.reshape(n * k, functions)
        lower = flat[below].T
        return lower + share * (flat[below + 1].T - lower)


@dataclass(frozen=True, eq=False)
class TrueAtmosphere:
    """The mission's air, as thin or thick as it is."""

    mission: Atmosphere
    factor: Any  # (n,)
    profile: Profiles | None

    def density(self, altitude: Any) -> Any:
        """Density (kg/m³) at the altitudes (m)."""
        density = self.factor * self.mission.density(altitude)
        return density if self.profile is None else density * self.profile(altitude)[0]

    def speed_of_sound(self, altitude: Any) -> Any:
        """The mission's: what differs in temperature is left out."""
        return self.mission.speed_of_sound(altitude)


@dataclass(frozen=True, eq=False)
class TrueWind:
    """East and north wind over altitude."""

    profile: Profiles

    def components(self, altitude: Any) -> tuple[Any, Any]:
        """(east, north) in m/s at the altitudes (m)."""
        east, north = self.profile(altitude)
        return east, north


def true_model(family: MissionFamily, truth: Truth) -> FlightModel:
    """Planet, air and vehicle of n flights; its numbers are (n,).

    A factor that is 1 and an error that is 0 in all flights are left out: they change no bit.
    """
    model, numbers = family.flight_model(), truth.numbers
    step = float(truth.altitudes[1] - truth.altitudes[0])
    changed = {
        name: getattr(model.vehicle, name) * numbers[of]
        for name, of in (
            ("mass", "mass_factor"),
            ("lift_factor", "lift_factor"),
            ("drag_factor", "drag_factor"),
        )
        if np.any(numbers[of] != 1.0)
    }
    error = numbers["angle_of_attack_error"]
    atmosphere: Atmosphere = model.atmosphere
    if truth.density is not None or np.any(numbers["density_factor"] != 1.0):
        profile = None if truth.density is None else Profiles(step, truth.density[..., None])
        atmosphere = TrueAtmosphere(atmosphere, numbers["density_factor"], profile)
    wind = truth.wind
    return replace(
        model,
        atmosphere=atmosphere,
        vehicle=replace(model.vehicle, **changed),
        wind=None if wind is None else TrueWind(Profiles(step, _functions_last(wind))),
        angle_of_attack_offset=error if np.any(error != 0.0) else None,
    )


def _functions_last(wind: Array) -> Array:
    """(2, n, k) as (n, k, 2)."""
    return np.ascontiguousarray(np.moveaxis(wind, 0, -1))
