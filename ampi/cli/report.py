"""`ampi report`: the verdict, all figures and what the database knows of itself, as one page."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ampi.cli.console import escaped, known, out
from ampi.cli.endings import refusals
from ampi.cli.options import DatabaseArgument, Force
from ampi.cli.output_files import check_drawing, check_output
from ampi.cli.progress import progress

if TYPE_CHECKING:
    from ampi.dataset import TrajectoryDataset
    from ampi.simulation.flights import Flights

PROVENANCE = (
    ("ampi", "ampi_version"),
    ("Git revision", "git_revision"),
    ("Content SHA-256", "content_sha256"),
    ("numpy", "numpy_version"),
    ("clarabel", "clarabel_version"),
)


def report(
    path: DatabaseArgument,
    campaigns: Annotated[Path, typer.Argument(help="Flights kept by 'ampi fly --output'.")],
    output: Annotated[Path, typer.Option(help="HTML file to write.")] = Path("report.html"),
    force: Force = False,
) -> None:
    """Write the verdict and all figures as one HTML file."""
    from ampi.dataset import read_dataset
    from ampi.loading import guidance_table
    from ampi.simulation.flights_file import load_campaigns

    with refusals():
        check_output(output, force=force, made_by="ampi report", others=[path, campaigns])
        check_drawing(output)
        from ampi.report.html import write_report

        dataset = read_dataset(path)
        flown = load_campaigns(campaigns)
        _require_same_mission(dataset, path, flown, campaigns)
        origin = {"Written": _now(), "Database file": path.name, "Flights file": campaigns.name}
        origin |= {label: str(dataset.attributes[key]) for label, key in PROVENANCE}
        notices, lines = _notices(dataset, path), _audit_lines(dataset, path)
        with progress("drawing", 1) as advance:
            table = guidance_table(dataset, holes="fly")
            write_report(output, dataset.mission, table, flown, origin, notices, lines)
            advance(1)
    out.print(f"{escaped(output)}: {output.stat().st_size / 1e6:.1f} MB")


def _require_same_mission(
    dataset: TrajectoryDataset, path: Path, flown: Mapping[str, Flights], campaigns: Path
) -> None:

    for flights in flown.values():
        if flights.mission_sha256 != dataset.mission.digest:
            raise ValueError(
                f"{campaigns}: flown from a database of another mission than {path} "
                f"({_difference(flights.mission, dataset.mission.name)}); fly this database again"
            )


def _difference(flown: str, here: str) -> str:
    return f"{flown}, not {here}" if flown != here else f"also {here}, with other numbers or axes"


def _now() -> str:
    """The date; SOURCE_DATE_EPOCH where a page is to be the same again (reproducible-builds.org)."""
    seconds = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = int(seconds) if seconds.isdigit() else None
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now))


def _notices(dataset: TrajectoryDataset, path: Path) -> list[str]:
    import numpy as np

    from database.audit.branches import branch_doubt, suspects
    from database.file.encoded_block import stations
    from database.plan.grid import Grid

    bank = np.where(dataset.solved[..., None], stations(dataset.states), np.nan)
    doubtful = suspects(Grid.from_mission(dataset.mission), bank)
    return [branch_doubt(doubtful, path)] if doubtful else []


def _audit_lines(dataset: TrajectoryDataset, path: Path) -> dict[str, str]:
    """What the file knows of itself, and what follows from it without another solve."""
    return {
        **_truth_lines(dataset),
        "Coherence": _coherence_line(dataset),
        "Interpolation error, 90 % in the worst cell": _interpolation_line(dataset),
        "In full": f"ampi audit {shlex.quote(str(path))}",
    }


def _truth_lines(dataset: TrajectoryDataset) -> dict[str, str]:
    import numpy as np

    from ampi.missions.path_limits import PathLimits

    solved, names = dataset.solved, PathLimits.of(dataset.mission).names
    lines = {"Cases solved": f"{np.count_nonzero(solved)} of {solved.size}"}
    for label, unit, errors in (
        ("Position", "m", dataset.position_error),
        ("Altitude", "m", dataset.altitude_error),
        ("Speed", "m/s", dataset.speed_error),
    ):
        own = errors[solved]
        lines[f"{label} error against re-integration"] = (
            f"{np.median(own):.3g} {unit} in the median, at most {own.max():.3g} {unit}"
        )
    use = dataset.peak[solved].max(axis=0)
    lines["Greatest use of each limit"] = ", ".join(
        f"{name.replace('_', ' ')} {100.0 * share:.1f} %"
        for name, share in zip(names, use, strict=True)
    )
    return lines


def _coherence_line(dataset: TrajectoryDataset) -> str:
    import numpy as np

    from database.audit.coherence import THRESHOLD, coherence

    smooth = coherence(dataset)
    if not smooth.triples:
        return "unknown: no axis has three points in a row with a solution"
    row = int(np.nanargmax(smooth.worst))
    return (
        f"{smooth.triples} second differences, the roughest {smooth.worst[row]:.1f} times the "
        f"family's scale ({smooth.rows[row].replace('_', ' ')}); {len(smooth.outliers)} cases stand out "
        f"above {THRESHOLD:g}"
    )


def _interpolation_line(dataset: TrajectoryDataset) -> str:
    from database.audit.error_map import error_map

    if any(len(axis) <= 2 for axis in dataset.axes):
        return "unknown: an axis of two points leaves none out"
    cells = error_map(dataset, n_jobs=1)
    units = ("m", "m/s", "deg of bank", "s of final time")
    worst = (max(cell.errors[key] for cell in cells) for key in cells[0].errors)
    return ", ".join(f"{known(value)} {unit}" for value, unit in zip(worst, units, strict=True))
