"""Which row is what: the layout that flies and the physics of the ground say the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.onboard.row_layout import (
    DRAG_TRACKING,
    LINEAR_TRACKING,
    N_STATES,
    STEERED_TRACKING,
    Row,
    RowKind,
    RowLayout,
)
from ampi.onboard.table import GuidanceTable
from ampi.physics import state

ROWS = LINEAR_TRACKING.rows


# --- laws -----------------------------------------------------------------------------------------


def test_what_flies_names_the_states_and_the_control_as_the_physics_does() -> None:
    states, controls = ROWS[LINEAR_TRACKING.states], ROWS[LINEAR_TRACKING.of(RowKind.CONTROL)]
    assert N_STATES == state.N_STATES
    assert tuple(row.name for row in states) == state.STATES
    assert tuple(row.unit for row in states) == state.STATE_UNITS
    assert tuple(i for i, row in enumerate(states) if row.is_circular) == state.CIRCULAR_STATES
    assert tuple(row.name for row in controls) == state.CONTROLS
    assert tuple(row.unit for row in controls) == state.CONTROL_UNITS


def test_the_kinds_are_a_partition_and_each_state_has_a_gain() -> None:
    places = [np.arange(len(ROWS))[LINEAR_TRACKING.of(kind)] for kind in RowKind]
    assert np.concatenate(places).tolist() == list(range(len(LINEAR_TRACKING)))
    assert LINEAR_TRACKING.of(RowKind.LOAD) == LINEAR_TRACKING.of(RowKind.MULTIPLIER) == slice(0, 0)
    assert [row.name for row in ROWS[LINEAR_TRACKING.gains]] == [
        f"{name}_gain" for name in state.STATES
    ]
    assert ROWS[-N_STATES].unit == "rad/s per m"


def test_rows_are_stacked_where_the_layout_says_that_they_are() -> None:
    parts = {
        RowKind.STATE: np.full((2, N_STATES, 3), 1.0),
        RowKind.CONTROL: np.full((2, 1, 3), 2.0),
        RowKind.GAIN: np.full((2, N_STATES, 3), 3.0),
    }
    rows = LINEAR_TRACKING.stacked(parts)
    assert rows.shape == (2, len(LINEAR_TRACKING), 3)
    assert np.all(rows[:, LINEAR_TRACKING.states] == 1.0)
    assert np.all(rows[:, LINEAR_TRACKING.bank_rate] == 2.0)
    assert np.all(rows[:, LINEAR_TRACKING.gains] == 3.0)


def test_a_table_may_hold_more_rows(table: GuidanceTable) -> None:
    layout = RowLayout((*ROWS, Row("drag", "m/s²", RowKind.LOAD)))
    wider = np.concatenate([table.values, table.values[..., :1, :]], axis=-2)
    held = replace(table, values=wider, layout=layout, sensitivities=None)
    assert held.corners().layout is held.nominal().layout is layout
    assert layout.of(RowKind.LOAD) == slice(len(ROWS), len(ROWS) + 1)
    with pytest.raises(ValueError, match=r"values has shape .*, expected"):
        replace(table, values=wider)


def test_a_second_control_adds_rows_behind_those_of_the_first() -> None:
    assert STEERED_TRACKING.rows[: len(ROWS)] == ROWS
    assert [row.name for row in STEERED_TRACKING.rows[STEERED_TRACKING.angle_gains]] == [
        f"{name}_angle_gain" for name in state.STATES
    ]
    for layout in (LINEAR_TRACKING, STEERED_TRACKING, DRAG_TRACKING):
        steered = layout.with_angle_of_attack
        assert layout.angle_of_attack is None
        assert steered.angle_of_attack == len(layout)
        assert steered.rows[:-1] == layout.rows
        assert steered.with_angle_of_attack is steered


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ((*ROWS, ROWS[0]), r"expected rows of different names, got altitude"),
        ((ROWS[0], *ROWS[7:], *ROWS[1:7]), r"expected rows of kind state side by side"),
        (ROWS[:-1], r"expected the rows altitude_gain, .*, bank_angle_gain, got altitude_gain"),
        (STEERED_TRACKING.rows[:-1], r"expected the rows altitude_angle_gain, .*, got altitude"),
        ((*ROWS[:7], *ROWS[8:]), r"expected a row called bank_rate, got altitude"),
    ],
)
def test_a_layout_checks_itself(rows: tuple[Row, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RowLayout(rows)
