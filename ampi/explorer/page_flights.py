"""Flights of campaigns as the page shows them: where they ended, from where, in which world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.physics.state import LATITUDE, LONGITUDE
from ampi.simulation.estimates.ellipses import Place, containing_ellipse, covariance_ellipse
from ampi.simulation.flights import Flights
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.statistics import judge
from ampi.simulation.uncertainties import BY_NAME

Array = NDArray[np.float64]

MOST = 1000  # flights in all: more are a cloud, and megabytes
OUTLINE = 73  # points of an ellipse
LOADED = (30e3, 60e3)  # m, altitudes over which a profile is averaged: there the air steers


def shown_flights(
    mission: Mission, campaigns: Mapping[str, Flights], units: Array, azimuth: float
) -> dict[str, Any]:
    """Of every campaign; `units` are SI per shown unit of each parameter, `azimuth` the track's (rad).

    Raises
    ------
    ValueError
        If flights are those of another mission.
    """
    place = Place(
        mission.target.longitude,
        mission.target.latitude,
        azimuth,
        mission.flight_model.planet.equatorial_radius,
    )
    found = []
    for label, flights in campaigns.items():
        if flights.mission_sha256 != mission.digest:
            raise ValueError(
                f"flights: expected those of the database's mission, got {label} of "
                f"{flights.mission}, whose numbers differ"
            )
        found.append(_campaign(label, flights, units, place, few_of(campaigns)))
    return {"campaigns": found}


def few_of(campaigns: Mapping[str, Flights]) -> int:
    """How many flights of each campaign are shown."""
    return MOST // max(len(campaigns), 1)


def _campaign(
    label: str, flights: Flights, units: Array, place: Place, count: int
) -> dict[str, Any]:
    few = slice(0, count)
    ends = np.where(flights.reached, (flights.across, flights.along), np.nan)
    pairs = (("covariance", covariance_ellipse(*ends)), ("contains", containing_ellipse(*ends)))
    return {
        "label": label,
        "mode": flights.mode.value,
        "correction": flights.correction,
        "world_name": flights.world,
        "n": len(flights.miss),
        "longitude": _rounded(np.degrees(flights.final_states[few, LONGITUDE]), 5),
        "latitude": _rounded(np.degrees(flights.final_states[few, LATITUDE]), 5),
        "miss": _rounded(flights.miss[few] / 1e3, 3),
        "altitude": _rounded(flights.altitude_error[few], 1),
        "arrives": flights.reached[few].tolist(),
        "parameters": _rounded(flights.parameters[few] / units, 5),
        "world": _rounded(_world(flights)[few], 4),
        "ellipses": [
            {
                "share": 0.95,
                "kind": kind,
                "outline": _rounded(np.degrees(np.stack(one.on_map(place, OUTLINE), axis=1)), 6),
            }
            for kind, one in pairs
            if one is not None
        ],
        "within": [
            {"radius": radius / 1e3, "share": own.percent / 100.0, "low": own.low, "high": own.high}
            for radius, own in judge(flights).within.items()
        ],
    }


def _world(flights: Flights) -> Array:
    """Density, lift, drag and wind of each flight as the sliders have them, (n, 5).

    A profile is averaged where the air steers; a heavier vehicle is one in thinner air.
    """
    numbers = dict(zip(BY_NAME, flights.numbers.T, strict=True))
    low, high = LOADED
    steers = (low <= ALTITUDES) & (high >= ALTITUDES)
    density = numbers["density_factor"] * flights.density[:, steers].mean(axis=1)
    wind = flights.wind[:, :, steers].mean(axis=2)
    own = [density / numbers["mass_factor"], numbers["lift_factor"], numbers["drag_factor"]]
    return np.stack([*own, *wind.T], axis=1)


def _rounded(values: Array, digits: int) -> list[Any]:
    """As JSON: what is no number is null."""
    rounded = np.round(np.asarray(values, dtype=float), digits)
    plain = rounded.astype(object)
    plain[~np.isfinite(rounded)] = None
    return list(plain.tolist())
