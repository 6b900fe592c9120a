"""What the measured parameters p say of a flight: entry, target, factors of the model, limits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.flight_model import Factors, Limits
from ampi.onboard.plausibility import SANE

Array = NDArray[np.float64]

ENTRY = ("altitude", "longitude", "latitude", "speed", "flight_path_angle", "azimuth")
TARGET = ("altitude", "longitude", "latitude", "speed")
FACTORS = ("density", "lift", "drag", "mass")
LIMITS = ("dynamic_pressure", "heat_flux", "load_factor", "bank_angle", "bank_rate")
# the numbers of a flight by their path in a mission; a factor is over the mission's own number
VARIED = (
    *(("entry", name) for name in ENTRY),
    *(("target", name) for name in TARGET),
    ("atmosphere", "density_factor"),
    ("vehicle", "lift_factor"),
    ("vehicle", "drag_factor"),
    ("vehicle", "mass"),
    *(("limits", name) for name in LIMITS),
)
UNMOVED = -1  # place of a parameter that moves no flight, such as a weight of the objective


class OfFlights(NamedTuple):
    """Numbers of n flights."""

    entry: Array  # (6, n): h, θ, φ, V, γ, ψ
    target: Array  # (4, n): h, θ, φ, V
    factors: Factors  # (n,) each
    limits: Limits  # (n, 1) each


@dataclass(frozen=True, eq=False)
class FlightNumbers:
    """The numbers of a mission in the order of `VARIED`, and which of them p replaces (SI, rad)."""

    nominal: Array  # (19,)
    places: tuple[int, ...]  # (d,), index of each parameter, or `UNMOVED`
    limits: Limits  # of the mission

    def __post_init__(self) -> None:
        self.nominal.setflags(write=False)

    def at(self, parameters: Array) -> OfFlights:
        """Of n flights with p (n, d); what is no number is nominal."""
        numbers = np.repeat(self.nominal[:, None], len(parameters), axis=1)
        for place, told in zip(self.places, parameters.T, strict=True):
            if place != UNMOVED:
                numbers[place] = np.where(np.abs(told) < SANE, told, self.nominal[place])
        counts = np.cumsum([len(ENTRY), len(TARGET), len(FACTORS)])
        entry, target, absolute, limits = np.split(numbers, counts)
        own = self.nominal[counts[1] : counts[2], None]
        return OfFlights(
            entry,
            target,
            Factors(*(absolute / own)),
            replace(self.limits, **dict(zip(LIMITS, limits[:, :, None], strict=True))),
        )
