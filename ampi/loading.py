"""From a database file to the guidance that flies it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ampi.dataset import DatasetError, TrajectoryDataset, read_dataset
from ampi.guidance import Guidance
from ampi.missions.mission import mission_digest
from ampi.onboard.reference import Mode
from ampi.onboard.table import GuidanceTable
from ampi.tracking.bank_limiter import BankLimits


def guidance_table(dataset: TrajectoryDataset) -> GuidanceTable:
    """Pack states, bank rate and gains of a database into the table that flies.

    Raises
    ------
    DatasetError
        If a case has no solution: a table with holes cannot fly.
    """
    missing = np.flatnonzero(~dataset.solved.ravel())
    if len(missing):
        first = int(missing[0])
        message = dataset.message.ravel()[first].decode("utf-8", "replace")
        raise DatasetError(
            f"{len(missing)} of {dataset.solved.size} cases have no solution, the first is case "
            f"{first}: {message}. A table with holes cannot fly"
        )
    nominal = dataset.mission.nominal_parameters
    return GuidanceTable(
        axes=dataset.axes,
        values=np.concatenate(
            [dataset.states, dataset.bank_rate[..., None, :], dataset.gains], axis=-2
        ),
        final_time=dataset.final_time,
        conversion=dataset.conversion,
        high_density_time=(dataset.high_density_time[0], dataset.high_density_time[1]),
        centre=tuple(
            int(np.argmin(np.abs(axis - x))) for axis, x in zip(dataset.axes, nominal, strict=True)
        ),
    )


def load_guidance(path: str | Path, *, mode: Mode | str = Mode.AMPI) -> Guidance:
    """Guidance from a database file, checked: schema version, checksums, completeness.

    Parameters
    ----------
    path
        File made by `database.build`.
    mode
        "ampi" (default), "mpi", "quadratic" or "nominal".

    Raises
    ------
    DatasetError
        If the file cannot be trusted; the message says why and what to do.
    """
    dataset = read_dataset(path)
    limits, names = dataset.mission.limits, dataset.names
    return Guidance(
        guidance_table(dataset),
        BankLimits(limits.bank_angle, limits.bank_rate, limits.bank_acceleration),
        Mode(mode),
        limit_axes={
            limit: names.index(f"limits.bank_{limit}")
            for limit in ("angle", "rate", "acceleration")
            if f"limits.bank_{limit}" in names
        },
        mission_sha256=mission_digest(dataset.mission),
    )
