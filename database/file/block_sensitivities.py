"""How the optima of a block move with the parameters: what the file holds of it, if it is asked to.

They are made from what the file holds of the optima, and not in their solves: so they do not depend on
the way to an optimum, and those that are taken over from another file have them as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import LINEAR_TRACKING, RowKind
from ampi.scp.sensitivities import sensitivities
from ampi.tracker_design.riccati_gains import vertex_gains
from ampi.tracker_design.row_sensitivities import Tangent
from ampi.trajectory import Status, Trajectory
from database.file.blocks import Block
from database.records.campaign import Campaign

Array = NDArray[np.float64]


def block_sensitivities(
    campaign: Campaign, block: Block, values: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """The fields of sensitivities of a block, in its shape, from its other fields (`blocks.assemble`).

    NaN for a case that is not solved, or whose optimum has none.
    """
    grid, mesh = campaign.grid, campaign.mission.pseudospectral_mesh
    solved = values["status"] == int(Status.SOLVED)
    shape = (*block.shape, len(grid.shape))
    rows = np.full((*shape, len(LINEAR_TRACKING), mesh.n_nodes), np.nan)
    final_time = np.full(shape, np.nan)
    if solved.any():
        cases = block.cases(grid.shape)[solved.ravel()]
        points = np.array([grid.point(case) for case in cases.tolist()])
        of_solved = {name: array[solved] for name, array in values.items()}
        rows[solved], final_time[solved] = _sensitivities(campaign, points, of_solved)
    return {"sensitivities": rows, "final_time_sensitivity": final_time}


def _sensitivities(
    campaign: Campaign, points: Array, values: Mapping[str, NDArray[Any]]
) -> tuple[Array, Array]:
    """Of the rows (c, d, 15, n) and of the final time (c, d), of c optima at `points` (c, d)."""
    mission, mesh = campaign.mission, campaign.mission.pseudospectral_mesh
    names = ("states", "bank_rate", "final_time", "cost", "target_multipliers")
    optima = [
        Trajectory(
            mesh, states, rate, float(time), float(cost), Status.SOLVED, target_multipliers=on
        )
        for states, rate, time, cost, on in zip(*(values[name] for name in names), strict=True)
    ]
    moved = sensitivities(mission, points, optima, campaign.settings)
    times = values["final_time"]
    tangent = Tangent(mission, points, values["states"], times, moved.states, moved.final_time)

    def gains(family: MissionFamily[Mission], states: Array, final_time: Array) -> Array:
        return vertex_gains(family, mesh, states, final_time, campaign.gains, swept_as=times)

    rows = LINEAR_TRACKING.stacked(
        {
            RowKind.STATE: moved.states,
            RowKind.CONTROL: moved.bank_rate[..., None, :],
            RowKind.GAIN: tangent.derivative(gains, values["gains"]),
        }
    )
    return rows, moved.final_time
