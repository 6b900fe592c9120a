"""From a database file to the guidance that flies it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

import numpy as np

from ampi.dataset import DatasetError, TrajectoryDataset, read_dataset
from ampi.guidance import Guidance
from ampi.onboard.reference import Mode
from ampi.onboard.row_layout import LINEAR_TRACKING, RowKind
from ampi.onboard.table import GuidanceTable, nearest_solved
from ampi.tracking.bank_limiter import BankLimits

Holes = Literal["refuse", "fly"]
HOLES: tuple[Holes, ...] = get_args(Holes)


def guidance_table(dataset: TrajectoryDataset, holes: Holes = "refuse") -> GuidanceTable:
    """Pack states, bank rate and gains of a database into the table that flies.

    With `holes="fly"` a case without solution takes the rows of the nearest one that has one, and the
    table says so.

    Raises
    ------
    DatasetError
        If a case has no solution and the table was not asked to fly all the same; or if none has one.
    """
    if holes not in HOLES:
        raise ValueError(f"holes: expected {' or '.join(HOLES)}, got {holes!r}")
    solved = dataset.solved
    missing = np.flatnonzero(~solved.ravel())
    if len(missing) and (holes == "refuse" or not solved.any()):
        first = int(missing[0])
        told = (
            dataset.message.ravel()[first].decode("utf-8", "replace").split("; ")
        )  # every attempt
        raise DatasetError(
            f"{len(missing)} of {solved.size} cases have no solution, the first is case "
            f"{first}: {told[0].rstrip('.')}. A table with holes cannot fly unless it is asked to "
            "(holes='fly', --holes fly); or leave them out with: ampi crop"
        )
    rows = LINEAR_TRACKING.stacked(
        {
            RowKind.STATE: dataset.states,
            RowKind.CONTROL: dataset.bank_rate[..., None, :],
            RowKind.GAIN: dataset.gains,
        }
    )
    final_time = dataset.final_time
    if len(missing):
        nearest = nearest_solved(dataset.axes, solved).ravel()
        cases = rows.reshape(-1, *rows.shape[-2:])
        cases[missing] = cases[nearest[missing]]
        final_time = final_time.ravel()[nearest].reshape(final_time.shape)
    nominal = dataset.mission.nominal_parameters
    return GuidanceTable(
        axes=dataset.axes,
        values=rows,
        final_time=final_time,
        conversion=dataset.conversion,
        high_density_time=(dataset.high_density_time[0], dataset.high_density_time[1]),
        centre=tuple(
            int(np.argmin(np.abs(axis - x))) for axis, x in zip(dataset.axes, nominal, strict=True)
        ),
        solved=solved if len(missing) else None,
        circular=tuple(i for i, p in enumerate(dataset.mission.parameters) if p.number.is_circular),
    )


def load_guidance(
    path: str | Path,
    *,
    mode: Mode | str = Mode.AMPI,
    holes: Holes = "refuse",
    cycle: float | None = None,
) -> Guidance:
    """Guidance from a database file, checked: schema version, checksums, completeness.

    Parameters
    ----------
    path
        File made by `database.build`.
    mode
        "ampi" (default), "mpi", "quadratic" or "nominal".
    holes
        Of a database in which cases have no solution: "refuse" it, or "fly" it, with references flagged
        where they need such a case (`Reference.hole`).
    cycle
        Nominal guidance cycle (s). Guidance measures its own; this one is that of the first command,
        which changes next to nothing if none is stated. Simulated flights take 0.5 s then.

    Raises
    ------
    DatasetError
        If the file cannot be trusted; the message says why and what to do.
    """
    return guidance_of(read_dataset(path), mode=mode, holes=holes, cycle=cycle)


def guidance_of(
    dataset: TrajectoryDataset,
    *,
    mode: Mode | str = Mode.AMPI,
    holes: Holes = "refuse",
    cycle: float | None = None,
) -> Guidance:
    """The same from a database that has been read."""
    limits, names = dataset.mission.limits, dataset.names
    return Guidance(
        guidance_table(dataset, holes),
        BankLimits(limits.bank_angle, limits.bank_rate, limits.bank_acceleration),
        mode,
        cycle=cycle,
        limit_axes={
            limit: names.index(f"limits.bank_{limit}")
            for limit in ("angle", "rate", "acceleration")
            if f"limits.bank_{limit}" in names
        },
        mission_sha256=dataset.mission.digest,
    )
