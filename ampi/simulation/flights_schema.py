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

from ampi.hdf5.seal import Seal
from ampi.onboard.reference import Mode
from ampi.physics.state import CONTROL_UNITS, STATE_UNITS, STATES
from ampi.simulation.dispersions import Distribution

SCHEMA_VERSION = 1
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
        return FLIGHT in self.dimensions and TIME in self.dimensions


FIELDS: dict[str, Field] = {
    FLIGHT: Field((FLIGHT,), "1", "number of the flight", "i8"),
    TIME: Field((TIME,), "s", "time since entry"),
    "state": Field(("state",), "1", "names of the states", "S20"),
    "limit": Field(("limit",), "1", "names of the limits that a flight is to keep", "S20"),
    "parameter": Field(("parameter",), "1", "number of the mission's parameter", "i8"),
    "radius": Field(("radius",), "m", "radii within which the verdict counts flights"),
    "half_widths": Field(("parameter",), "SI, rad", "half-widths of the dispersions"),
    "centre": Field(("parameter",), "SI, rad", "centre of the dispersions, from the nominal"),
    "parameters": Field((FLIGHT, "parameter"), "SI, rad", "parameters as drawn"),
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
    "states": Field((FLIGHT, "state", TIME), " ".join(STATE_UNITS), "states"),
    "reference_states": Field(
        (FLIGHT, "state", TIME), " ".join(STATE_UNITS), "states of the reference"
    ),
    "bank_rate": Field((FLIGHT, TIME), CONTROL_UNITS[0], "bank rate"),
    "path": Field((FLIGHT, "limit", TIME), "1", "use of each limit, over the limit"),
    "peak": Field((FLIGHT, "limit"), "1", "greatest use of each limit, at any guidance cycle"),
}
LABELS = {"state": STATES}  # of dimensions whose values are always the same

# what `Flights` calls the values of a scale
SCALES = {"times": TIME, "limits": "limit", "radii": "radius"}

ATTRIBUTES: dict[str, Callable[[Any], Any]] = {  # numbers and words of a campaign, and their types
    "mission": str,
    "mission_sha256": str,
    "mode": Mode,
    "seed": int,
    "cycle": float,  # s
    "distribution": Distribution,
    "position_tolerance": float,  # m
    "altitude_tolerance": float,  # m
    "speed_tolerance": float,  # m/s
}
