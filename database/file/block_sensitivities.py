"""How the optima of a block move with the parameters: what the file holds of it, if it is asked to.

They are made from what the file holds of the optima, and not in their solves: so they do not depend on
the way to an optimum, and those that are taken over from another file have them as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import ANGLE_RATE
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import LINEAR_TRACKING, RowKind, RowLayout
from ampi.physics.state import N_STATES
from ampi.scp.sensitivities import sensitivities
from ampi.tracker_design.riccati_gains import vertex_gains
from ampi.tracker_design.row_sensitivities import Tangent
from ampi.trajectory import Status, Trajectory
from database.file.blocks import Block
from database.records.campaign import Campaign

Array = NDArray[np.float64]
OF_NODES = ("states", "bank_rate", ANGLE_RATE, "target_multipliers")


def stored_rows(mission: Mission) -> RowLayout:
    """What is differentiated of a mission's optima."""
    steered = mission.n_states > N_STATES
    return LINEAR_TRACKING.with_angle_of_attack if steered else LINEAR_TRACKING


def block_sensitivities(
    campaign: Campaign, block: Block, values: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """The fields of sensitivities of a block, in its shape, from its other fields (`blocks.assemble`).

    NaN for a case that is not solved, or whose optimum has none.
    """
    grid, mesh = campaign.grid, campaign.mission.pseudospectral_mesh
    solved = values["status"] == int(Status.SOLVED)
    shape = (*block.shape, len(grid.shape))
    rows = np.full((*shape, len(stored_rows(campaign.mission)), mesh.n_nodes), np.nan)
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
    """Of the rows (c, d, 15 or 16, n) and of the final time (c, d), of c optima at `points` (c, d)."""
    mission, mesh = campaign.mission, campaign.mission.pseudospectral_mesh
    optima = [
        Trajectory(
            mesh=mesh,
            final_time=float(values["final_time"][case]),
            cost=float(values["cost"][case]),
            status=Status.SOLVED,
            **{name: values[name][case] for name in OF_NODES if name in values},
        )
        for case in range(len(points))
    ]
    moved = sensitivities(mission, points, optima, campaign.settings)
    times = values["final_time"]
    tangent = Tangent(mission, points, values["states"], times, moved.states, moved.final_time)

    def gains(family: MissionFamily[Mission], states: Array, final_time: Array) -> Array:
        return vertex_gains(family, mesh, states, final_time, campaign.gains, swept_as=times)

    rows = stored_rows(mission).stacked(
        {
            RowKind.STATE: moved.states[:, :, :N_STATES],
            RowKind.ANGLE: moved.states[:, :, N_STATES:],
            RowKind.CONTROL: moved.bank_rate[..., None, :],
            RowKind.GAIN: tangent.derivative(gains, values["gains"]),
        }
    )
    return rows, moved.final_time
