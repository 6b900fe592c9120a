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
    ANGLE_GAIN = "angle gain"  # change of the angle of attack per unit of a state
    LOAD = "load"
    MULTIPLIER = "multiplier"  # cost per unit of a final state
    ANGLE = "angle"  # of attack, where no schedule gives it


@dataclass(frozen=True)
class Row:
    """One number at each node."""

    name: str
    unit: str
    kind: RowKind
    is_circular: bool = False  # an angle that is the same modulo a turn


@dataclass(frozen=True)
class RowLayout:
    """Rows in order; those of a kind stand side by side; gains, if any, are one for each state."""

    rows: tuple[Row, ...]
    states: slice = field(init=False)
    gains: slice = field(init=False)
    angle_gains: slice = field(init=False)
    bank_rate: int = field(init=False)
    angle_of_attack: int | None = field(init=False)  # None: the vehicle follows a schedule

    def __post_init__(self) -> None:
        names = [row.name for row in self.rows]
        if len(set(names)) < len(names):
            raise ValueError(f"layout: expected rows of different names, got {', '.join(names)}")
        kinds = {"states": RowKind.STATE, "gains": RowKind.GAIN, "angle_gains": RowKind.ANGLE_GAIN}
        for name, kind in kinds.items():
            object.__setattr__(self, name, self.of(kind))
        object.__setattr__(self, "bank_rate", self.index("bank_rate"))
        angle = names.index("angle_of_attack") if "angle_of_attack" in names else None
        object.__setattr__(self, "angle_of_attack", angle)
        for rows, ending in ((self.gains, "gain"), (self.angle_gains, "angle_gain")):
            expected = [f"{row.name}_{ending}" for row in self.rows[self.states]]
            if names[rows] not in ([], expected):
                raise ValueError(
                    f"layout: expected the rows {', '.join(expected)}, got {', '.join(names[rows])}"
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

    @property
    def with_angle_of_attack(self) -> RowLayout:
        """The same of a vehicle that steers its angle of attack: the reference's, last of the rows."""
        return (
            self if self.angle_of_attack is not None else RowLayout((*self.rows, ANGLE_OF_ATTACK))
        )

    def flight_states(self, rows: Array) -> Array:
        """States (…, 7, n) of rows (…, r, n); (…, 8, n) with the angle of attack if it is a row."""
        if self.angle_of_attack is None:
            return rows[..., self.states, :]
        return np.concatenate(
            [rows[..., self.states, :], rows[..., self.of(RowKind.ANGLE), :]], axis=-2
        )

    def stacked(self, parts: Mapping[RowKind, Array]) -> Array:
        """Rows (…, r, n) from those of each kind, (…, rows of the kind, n)."""
        kinds = dict.fromkeys(row.kind for row in self.rows)
        return np.concatenate([parts[kind] for kind in kinds], axis=-2)


BANK_RATE = Row("bank_rate", "rad/s", RowKind.CONTROL)
ANGLE_OF_ATTACK = Row("angle_of_attack", "rad", RowKind.ANGLE)
STATES = (
    Row("altitude", "m", RowKind.STATE),
    Row("longitude", "rad", RowKind.STATE, is_circular=True),
    Row("latitude", "rad", RowKind.STATE),
    Row("speed", "m/s", RowKind.STATE),
    Row("flight_path_angle", "rad", RowKind.STATE),
    Row("azimuth", "rad", RowKind.STATE, is_circular=True),
    Row("bank_angle", "rad", RowKind.STATE, is_circular=True),
)
N_STATES = len(STATES)
# States, control and the gains of a linear tracking law: what files hold.
LINEAR_TRACKING = RowLayout(
    (
        *STATES,
        BANK_RATE,
        *(Row(f"{x.name}_gain", f"{BANK_RATE.unit} per {x.unit}", RowKind.GAIN) for x in STATES),
    )
)
# The same, and the gains of the change of the angle of attack: what a second control is computed by.
STEERED_TRACKING = RowLayout(
    (
        *LINEAR_TRACKING.rows,
        *(Row(f"{x.name}_angle_gain", f"rad per {x.unit}", RowKind.ANGLE_GAIN) for x in STATES),
    )
)
# States, control and what a drag-tracking law must know of the air and the vehicle.
DRAG_TRACKING = RowLayout(
    (
        *STATES,
        BANK_RATE,
        Row("log_drag", "ln(m/s²)", RowKind.LOAD),
        Row("lift_to_drag", "1", RowKind.LOAD),
        Row("drag_scale_height", "m", RowKind.LOAD),  # −1/(∂ ln D/∂h)
        Row("drag_slope", "1/rad", RowKind.LOAD),  # ∂ ln D/∂α
        Row("range_to_go", "m", RowKind.LOAD),  # over the great circle, to the end of the reference
    )
)
