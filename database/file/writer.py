"""The single writer: from assembled blocks to one HDF5 file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.missions.path_limits import PathLimits
from ampi.physics.state import N_STATES, STATES, STEERED_STATES
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from database.file.block_sensitivities import stored_rows
from database.file.blocks import Block, block_shape
from database.file.encoded_block import EncodedBlock
from database.file.hdf5_file import write_dataset
from database.records.campaign import Campaign

Array = NDArray[np.float64]

HIGH_DENSITY_INTERVALS = 600


def high_density_times(mesh: Mesh, nominal_final_time: float) -> tuple[Array, Array]:
    """(a, b) of the high-density times: uniform in each phase, about equal steps at nominal t_f.

    Phase boundaries are high-density points, so no interval holds a kink.
    """
    ends = [0.0, *(p.end for p in mesh.phases if p.end is not None), nominal_final_time]
    lengths = np.diff(ends)
    counts = np.maximum(1, np.round(HIGH_DENSITY_INTERVALS * lengths / lengths.sum())).astype(int)
    counts[-1] += HIGH_DENSITY_INTERVALS - counts.sum()
    fixed, free = [np.zeros(1)], [np.zeros(1)]
    for begin, length, count in zip(ends[:-2], lengths[:-1], counts[:-1], strict=True):
        fixed.append(begin + length * np.arange(1, count + 1) / count)
        free.append(np.zeros(count))
    fraction = np.arange(1, counts[-1] + 1) / counts[-1]
    fixed.append(ends[-2] * (1.0 - fraction))
    free.append(fraction)
    return np.concatenate(fixed), np.concatenate(free)


def write_database(
    path: Path,
    campaign: Campaign,
    attributes: Mapping[str, object],
    nominal_final_time: float,
    encoded_blocks: Iterable[tuple[Block, EncodedBlock]],
) -> None:
    """Merge the blocks, in index order, into `path`; `attributes` are its `provenance`."""
    mission, grid = campaign.mission, campaign.grid
    mesh, problem = mission.pseudospectral_mesh, OptimalControlProblem.of(mission)
    fixed, free = high_density_times(mesh, nominal_final_time)
    states = np.array(STEERED_STATES[: mission.n_states], dtype="S20")
    conversion = mesh.conversion(fixed + free * nominal_final_time, nominal_final_time).T
    write_dataset(
        path,
        names=grid.names,
        axes=grid.axes,
        axis_units=grid.units,
        scales={
            "state": states,
            "target": states[problem.target.state],
            "limit": np.array(PathLimits.of(mission).names, dtype="S20"),
            "affine": np.array(["a", "b"], dtype="S1"),
            "node": np.arange(mesh.n_nodes),
            "high_density": np.arange(len(fixed)),
            **({"tracked": np.array(STATES, dtype="S20")} if len(states) > N_STATES else {}),
            **(_rows_by_parameter(campaign) if campaign.sensitivities else {}),
        },
        values={
            "node_time": np.stack(mesh.node_time),
            "high_density_time": np.stack([fixed, free]),
            "ld_to_hd": np.ascontiguousarray(conversion),
        },
        block_shape=block_shape(grid.shape),
        blocks=((block.slices, encoded.chunks) for block, encoded in encoded_blocks),
        attributes=attributes,
    )


def _rows_by_parameter(campaign: Campaign) -> dict[str, NDArray[np.bytes_]]:
    """The scales of what is differentiated, and over what."""
    rows = [row.name.encode() for row in stored_rows(campaign.mission).rows]
    return {"parameter": np.char.encode(campaign.grid.names), "row": np.array(rows)}
