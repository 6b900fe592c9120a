"""The HDF5 schema of flights: every array of a campaign, once.

    /                    root attributes: schema_version, campaigns (their names), identity
    /<campaign>          attributes: mission, mode, seed, tolerances, … (`ATTRIBUTES`; SI, rad)
    /<campaign>/<name>   an array, a line of `FIELDS` each, on dimension scales of the same group

A dataset that is named as its only dimension is the scale of that. Histories end with their flight and
with the longest batch: NaN from there on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ampi.correction.corrector import CorrectionOutcome
from ampi.hdf5.seal import Seal
from ampi.onboard.reference import Mode
from ampi.physics.state import CONTROL_UNITS, STATE_UNITS, STATES
from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.uncertainties import BY_NAME

SCHEMA_VERSION = 3
SEAL = Seal("ampi flights")
FLIGHT, TIME = "flight", "time"


@dataclass(frozen=True)
class Field:
    """How one array is described in the file."""

    dimensions: tuple[str, ...]
    units: str
    long_name: str
    dtype: str = "f8"

    @property
    def is_history(self) -> bool:
        """Whether it is read when it is looked at: a file may hold more of these than the memory."""
        return FLIGHT in self.dimensions and not {TIME, "altitude"}.isdisjoint(self.dimensions)


FIELDS: dict[str, Field] = {
    FLIGHT: Field((FLIGHT,), "1", "number of the flight", "i8"),
    TIME: Field((TIME,), "s", "time since entry"),
    "state": Field(("state",), "1", "names of the states", "S20"),
    "limit": Field(("limit",), "1", "names of the limits that a flight is to keep", "S20"),
    "parameter": Field(("parameter",), "1", "number of the mission's parameter", "i8"),
    "uncertainty": Field(("uncertainty",), "1", "names of what may be uncertain", "S40"),
    "direction": Field(("direction",), "1", "where the wind blows to", "S20"),
    "altitude": Field(("altitude",), "m", "altitude of the profiles"),
    "outcome": Field(("outcome",), "1", "names of what becomes of a correction", "S20"),
    "radius": Field(("radius",), "m", "radii within which the verdict counts flights"),
    "numbers": Field((FLIGHT, "uncertainty"), "SI, rad", "what was true, of each uncertainty"),
    "density": Field((FLIGHT, "altitude"), "1", "true density over the mission's"),
    "wind": Field((FLIGHT, "direction", "altitude"), "m/s", "true wind"),
    "seeds": Field((FLIGHT,), "1", "seed of the sensors' noise", "u8"),
    "parameters": Field((FLIGHT, "parameter"), "SI, rad", "parameters of the mission as they are"),
    "clipped": Field((FLIGHT,), "1", "entry outside the hypercube", "?"),
    "hole": Field((FLIGHT,), "1", "reference borrowed from beside an unsolved case", "?"),
    "status": Field((FLIGHT,), "1", "how the flight ended; see FlightStatus", "i8"),
    "final_states": Field((FLIGHT, "state"), " ".join(STATE_UNITS), "state at the end"),
    "final_time": Field((FLIGHT,), "s", "time of the end since entry"),
    "miss": Field((FLIGHT,), "m", "great-circle distance to the target at the end"),
    "along": Field((FLIGHT,), "m", "miss along the nominal ground track, positive beyond it"),
    "across": Field((FLIGHT,), "m", "miss across the nominal ground track, positive to the right"),
    "altitude_error": Field((FLIGHT,), "m", "altitude at the end over the target's"),
    "speed_error": Field((FLIGHT,), "m/s", "speed at the end over the target's"),
    "saturation": Field((FLIGHT,), "1", "share of the cycles with bank angle or rate at its limit"),
    "activity": Field((FLIGHT,), "rad", "integral of the size of the bank rate"),
    "rebound": Field((FLIGHT,), "m", "highest altitude after the first descent"),
    "corrections": Field((FLIGHT, "outcome"), "1", "corrections in flight, by outcome", "i8"),
    "distance": Field((FLIGHT,), "m", "distance of the target at entry"),
    "least_range": Field((FLIGHT,), "m", "least range by propagation, of what has not passed"),
    "greatest_range": Field((FLIGHT,), "m", "greatest range, likewise"),
    "states": Field((FLIGHT, "state", TIME), " ".join(STATE_UNITS), "states"),
    "reference_states": Field(
        (FLIGHT, "state", TIME), " ".join(STATE_UNITS), "states of the reference"
    ),
    "bank_rate": Field((FLIGHT, TIME), CONTROL_UNITS[0], "bank rate"),
    "angle_of_attack": Field((FLIGHT, TIME), "rad", "change of the angle of attack"),
    "path": Field((FLIGHT, "limit", TIME), "1", "use of each limit, over the limit"),
    "peak": Field((FLIGHT, "limit"), "1", "greatest use of each limit, at any plant step"),
}
LABELS: dict[str, Any] = {  # of dimensions whose values are always the same
    "state": np.array(STATES, "S20"),
    "uncertainty": np.array(list(BY_NAME), "S40"),
    "direction": np.array(["east", "north"], "S20"),
    "altitude": ALTITUDES,
    "outcome": np.array([own.name for own in CorrectionOutcome], "S20"),
}

# what `Flights` calls the values of a scale
SCALES = {"times": TIME, "limits": "limit", "radii": "radius"}

ATTRIBUTES: dict[str, Callable[[Any], Any]] = {  # numbers and words of a campaign, and their types
    "mission": str,
    "mission_sha256": str,
    "guidance_sha256": str,
    "law": str,
    "correction": str,
    "mode": Mode,
    "world": str,
    "world_sha256": str,
    "world_toml": str,
    "drawn": str,
    "profiles": str,
    "seed": int,
    "pool": str,
    "cycle": float,  # s
    "engine": str,
    "position_tolerance": float,  # m
    "altitude_tolerance": float,  # m
    "speed_tolerance": float,  # m/s
    "entry_altitude": float,  # m
}
