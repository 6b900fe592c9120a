"""How the rows of a guidance table move with the parameters, from what a file holds of its optima.

States, bank rate and gains are in the file. The loads of a drag-tracking law are physics along the
optimum, and so are their derivatives (`ampi.tracker_design.row_sensitivities`). A case without any, a
hole or an optimum where the derivative does not exist, takes the divided differences of the table beside
it: zero would say that the family is flat there.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import RowKind, RowLayout
from ampi.physics.state import N_STATES
from ampi.tracker_design.drag_rows import drag_rows
from ampi.tracker_design.row_sensitivities import Tangent

Array = NDArray[np.float64]
AT_ONCE = 4096  # cases whose rows are made together: of a large database all would not fit


def loads(dataset: TrajectoryDataset) -> Array:
    """`drag_rows` of all cases, (p…, 5, n)."""
    points, states, final_time = _optima(dataset)
    rows = [
        _load_rows(dataset.mission.family(points[b]), states[b], final_time[b])
        for b in _blocks(len(points))
    ]
    return np.concatenate(rows).reshape(*dataset.shape, -1, states.shape[-1])


def table_sensitivities(
    dataset: TrajectoryDataset, layout: RowLayout, rows: Array, final_time: Array
) -> Array | None:
    """∂(rows, final time)/∂p at every grid point, (p…, d, r·n + 1), SI per SI unit of p.

    None where the file holds none.

    Parameters
    ----------
    dataset
        All that the file holds.
    layout
        Of the rows.
    rows
        The table's (p…, r, n), holes filled.
    final_time
        The same (p…).
    """
    stored, by_time = dataset.sensitivities, dataset.final_time_sensitivity
    if stored is None or by_time is None:
        return None
    parts = {
        RowKind.STATE: stored[..., :N_STATES, :],
        RowKind.CONTROL: stored[..., N_STATES : N_STATES + 1, :],
        RowKind.GAIN: stored[..., N_STATES + 1 :, :],
    }
    if any(row.kind is RowKind.LOAD for row in layout.rows):
        parts[RowKind.LOAD] = _load_sensitivities(dataset)
    found = layout.stacked(parts)
    found = np.concatenate([found.reshape(*by_time.shape, -1), by_time[..., None]], axis=-1)
    missing = ~np.isfinite(found).all(axis=(-2, -1))
    if missing.any():
        columns = np.concatenate([rows.reshape(*missing.shape, -1), final_time[..., None]], axis=-1)
        for i, axis in enumerate(dataset.axes):
            found[missing, i] = np.gradient(columns, axis, axis=i)[missing]
    return found


def _load_sensitivities(dataset: TrajectoryDataset) -> Array:
    """Of the loads, (p…, d, 5, n)."""
    points, states, final_time = _optima(dataset)
    assert dataset.sensitivities is not None and dataset.final_time_sensitivity is not None
    shape = dataset.sensitivities.shape
    moved = dataset.sensitivities[..., :N_STATES, :].reshape(-1, shape[-3], N_STATES, shape[-1])
    by_time = dataset.final_time_sensitivity.reshape(len(points), -1)
    found = []
    for b in _blocks(len(points)):
        optima = (points[b], states[b], final_time[b])
        tangent = Tangent(dataset.mission, *optima, moved[b], by_time[b])
        here = _load_rows(dataset.mission.family(points[b]), *optima[1:])
        found.append(tangent.derivative(_load_rows, here))
    return np.concatenate(found).reshape(*shape[:-2], -1, shape[-1])


def _load_rows(family: MissionFamily[Mission], states: Array, final_time: Array) -> Array:
    fixed, free = family.mission.pseudospectral_mesh.node_time
    return drag_rows(family, states, fixed + free * final_time[:, None])


def _optima(dataset: TrajectoryDataset) -> tuple[Array, Array, Array]:
    """p (c, d), states (c, 7, n) and final time (c,) of all cases."""
    points = np.stack(np.meshgrid(*dataset.axes, indexing="ij"), axis=-1)
    states = dataset.states.reshape(-1, *dataset.states.shape[-2:])
    return points.reshape(len(states), -1), states, dataset.final_time.ravel()


def _blocks(count: int) -> Iterator[slice]:
    return (slice(i, i + AT_ONCE) for i in range(0, count, AT_ONCE))
