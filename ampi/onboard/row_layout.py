"""The rows of a table by name, unit and kind: the one place that knows which row is what.

Table, reference, HDF5 file, simulator and exports read rows through a layout, so a law that brings rows
of its own (`ampi.tracker_design`) changes the layout and none of its readers. It repeats the names of
`ampi.physics.state`, for what flies imports numpy alone; a test ties the two.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class RowKind(Enum):
    """What a row is to its readers."""

    STATE = "state"
    CONTROL = "control"
    GAIN = "gain"  # control per unit of a state
    LOAD = "load"
    MULTIPLIER = "multiplier"  # cost per unit of a final state


@dataclass(frozen=True)
class Row:
    """One number at each node."""

    name: str
    unit: str
    kind: RowKind
    is_circular: bool = False  # an angle that is the same modulo a turn


@dataclass(frozen=True)
class RowLayout:
    """Rows in order; those of a kind stand side by side, and there is a gain for each state."""

    rows: tuple[Row, ...]
    states: slice = field(init=False)
    gains: slice = field(init=False)
    bank_rate: int = field(init=False)

    def __post_init__(self) -> None:
        names = [row.name for row in self.rows]
        if len(set(names)) < len(names):
            raise ValueError(f"layout: expected rows of different names, got {', '.join(names)}")
        for name, kind in (("states", RowKind.STATE), ("gains", RowKind.GAIN)):
            object.__setattr__(self, name, self.of(kind))
        object.__setattr__(self, "bank_rate", self.index("bank_rate"))
        expected = [f"{row.name}_gain" for row in self.rows[self.states]]
        if names[self.gains] != expected:
            raise ValueError(
                f"layout: expected the rows {', '.join(expected)}, got {', '.join(names[self.gains])}"
            )

    def __len__(self) -> int:
        return len(self.rows)

    def of(self, kind: RowKind) -> slice:
        """Where the rows of a kind stand."""
        places = [i for i, row in enumerate(self.rows) if row.kind is kind]
        if places != list(range(places[0], places[-1] + 1) if places else []):
            raise ValueError(f"layout: expected rows of kind {kind.value} side by side")
        return slice(places[0], places[-1] + 1) if places else slice(0, 0)

    def index(self, name: str) -> int:
        """The row of a name."""
        for i, row in enumerate(self.rows):
            if row.name == name:
                return i
        names = ", ".join(row.name for row in self.rows)
        raise ValueError(f"layout: expected a row called {name}, got {names}")

    def stacked(self, parts: Mapping[RowKind, Array]) -> Array:
        """Rows (…, r, n) from those of each kind, (…, rows of the kind, n)."""
        kinds = dict.fromkeys(row.kind for row in self.rows)
        return np.concatenate([parts[kind] for kind in kinds], axis=-2)


def _tracked(*states: Row) -> RowLayout:
    rate = Row("bank_rate", "rad/s", RowKind.CONTROL)
    gains = (Row(f"{x.name}_gain", f"{rate.unit} per {x.unit}", RowKind.GAIN) for x in states)
    return RowLayout((*states, rate, *gains))


# States, control and the gains of a linear tracking law: what tables hold today.
LINEAR_TRACKING = _tracked(
    Row("altitude", "m", RowKind.STATE),
    Row("longitude", "rad", RowKind.STATE, is_circular=True),
    Row("latitude", "rad", RowKind.STATE),
    Row("speed", "m/s", RowKind.STATE),
    Row("flight_path_angle", "rad", RowKind.STATE),
    Row("azimuth", "rad", RowKind.STATE, is_circular=True),
    Row("bank_angle", "rad", RowKind.STATE, is_circular=True),
)
N_STATES = len(LINEAR_TRACKING.rows[LINEAR_TRACKING.states])
