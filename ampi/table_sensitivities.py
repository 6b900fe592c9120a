"""How the rows of a guidance table move with the parameters, from what a file holds of its optima.

States, bank rate and gains are in the file. The loads of a drag-tracking law are physics along the
optimum, the gains of two controls a Riccati equation along it, and so are their derivatives
(`ampi.tracker_design.row_sensitivities`). A case without any, a hole or an optimum where the derivative
does not exist, takes the divided differences of the table beside it: zero would say that the family is
flat there.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import RowKind, RowLayout
from ampi.physics.state import N_STATES
from ampi.tracker_design.drag_rows import drag_rows
from ampi.tracker_design.row_sensitivities import Rows, Tangent

Array = NDArray[np.float64]
AT_ONCE = 4096  # cases whose rows are made together: of a large database all would not fit
SHARE = 0.6  # of what the angle of attack may change: its acceptable size over the whole flight


def loads(dataset: TrajectoryDataset) -> Array:
    """`drag_rows` of all cases, (p…, 5, n)."""
    points, states, final_time = _optima(dataset)
    rows = [
        _load_rows(dataset.mission.family(points[b]), states[b], final_time[b])
        for b in _blocks(len(points))
    ]
    return np.concatenate(rows).reshape(*dataset.shape, -1, states.shape[-1])


def steered_gains(dataset: TrajectoryDataset) -> tuple[Array, Array]:
    """Of both controls, (p…, 7, n) each (`steering_gains`); NaN where there is no optimum."""
    points, states, final_time = _optima(dataset)
    rows = np.full((len(points), 2 * N_STATES, states.shape[-1]), np.nan)
    solved = np.flatnonzero(np.isfinite(final_time))
    for b in _blocks(len(solved)):
        part = solved[b]
        gains = _gain_rows(dataset, final_time[part])
        rows[part] = gains(dataset.mission.family(points[part]), states[part], final_time[part])
    rows = rows.reshape(*dataset.shape, *rows.shape[1:])
    return rows[..., :N_STATES, :], rows[..., N_STATES:, :]


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
        RowKind.GAIN: stored[..., N_STATES + 1 : 2 * N_STATES + 1, :],
        RowKind.ANGLE: stored[..., 2 * N_STATES + 1 :, :],
    }
    kinds = {row.kind for row in layout.rows}
    if RowKind.LOAD in kinds:
        parts[RowKind.LOAD] = _differentiated(dataset, lambda final_time: _load_rows)
    if RowKind.ANGLE_GAIN in kinds:
        both = _differentiated(dataset, lambda final_time: _gain_rows(dataset, final_time))
        parts[RowKind.GAIN] = both[..., :N_STATES, :]
        parts[RowKind.ANGLE_GAIN] = both[..., N_STATES:, :]
    found = layout.stacked(parts)
    found = np.concatenate([found.reshape(*by_time.shape, -1), by_time[..., None]], axis=-1)
    missing = ~np.isfinite(found).all(axis=(-2, -1))
    if missing.any():
        columns = np.concatenate([rows.reshape(*missing.shape, -1), final_time[..., None]], axis=-1)
        for i, axis in enumerate(dataset.axes):
            found[missing, i] = np.gradient(columns, axis, axis=i)[missing]
    return found


def _differentiated(dataset: TrajectoryDataset, rows_at: Callable[[Array], Rows]) -> Array:
    """Of rows along the optima, (p…, d, r, n), which depend on how long the flights are (`rows_at`)."""
    points, states, final_time = _optima(dataset)
    assert dataset.sensitivities is not None and dataset.final_time_sensitivity is not None
    stored = dataset.sensitivities.reshape(len(points), *dataset.sensitivities.shape[-3:])
    by_time = dataset.final_time_sensitivity.reshape(len(points), -1)
    of_states = [*range(N_STATES), *range(2 * N_STATES + 1, stored.shape[-2])]
    known, parts = np.flatnonzero(np.isfinite(final_time)), []
    for b in _blocks(len(known)):
        part = known[b]
        rows, optima = rows_at(final_time[part]), (points[part], states[part], final_time[part])
        moved = stored[part][:, :, of_states]
        tangent = Tangent(dataset.mission, *optima, moved, by_time[part])
        here = rows(dataset.mission.family(points[part]), *optima[1:])
        parts.append(tangent.derivative(rows, here))
    made = np.concatenate(parts)
    found = np.full((*stored.shape[:2], *made.shape[2:]), np.nan)
    found[known] = made
    return found.reshape(*dataset.final_time_sensitivity.shape, *made.shape[2:])


def _load_rows(family: MissionFamily[Mission], states: Array, final_time: Array) -> Array:
    fixed, free = family.mission.pseudospectral_mesh.node_time
    return drag_rows(family, states, fixed + free * final_time[:, None])


def _gain_rows(dataset: TrajectoryDataset, swept_as: Array) -> Rows:
    """Gains of both controls, swept on the grids of flights of these final times."""
    # imported when asked for: it brings CasADi, and who flies by bank alone never asks
    from ampi.tracker_design.riccati_gains import SteeringSettings, steering_gains

    mesh, most = dataset.mission.pseudospectral_mesh, dataset.mission.limits.angle_of_attack_change
    given = json.loads(str(dataset.attributes["gain_settings"]))
    if most is not None:
        given["angle_of_attack_change"] = SHARE * most
    settings = SteeringSettings(**given)

    def rows(family: MissionFamily[Mission], states: Array, final_time: Array) -> Array:
        return steering_gains(family, mesh, states, final_time, settings, swept_as=swept_as)

    return rows


def _optima(dataset: TrajectoryDataset) -> tuple[Array, Array, Array]:
    """p (c, d), states (c, 7 or 8, n) and final time (c,) of all cases."""
    points = np.stack(np.meshgrid(*dataset.axes, indexing="ij"), axis=-1)
    states = dataset.states.reshape(-1, *dataset.states.shape[-2:])
    return points.reshape(len(states), -1), states, dataset.final_time.ravel()


def _blocks(count: int) -> Iterator[slice]:
    return (slice(i, i + AT_ONCE) for i in range(0, count, AT_ONCE))
