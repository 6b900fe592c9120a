"""`ampi rerun`, `ampi verify`: one case solved again, and every byte checked."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ampi.cli.console import escaped, out, print_error, print_json, print_summary
from ampi.cli.endings import refusals
from ampi.cli.options import DatabaseArgument, Force, Json
from ampi.cli.output_files import check_figure
from ampi.cli.solve import convergence_table, draw_trajectory

if TYPE_CHECKING:
    from database.rerun import AttemptResult


def rerun(
    path: Annotated[Path, typer.Argument(help="Trajectory database, or FILE.partial.")],
    case: Annotated[int, typer.Argument(help="Number of the case, in C order of the grid.")],
    output: Annotated[
        Path | None, typer.Option(help="Draw the trajectory (PNG, PDF, SVG).")
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Solve one case of a database or of an unfinished build again, showing every iteration.

    Exit status 1 where the case has no solution.
    """
    from database.rerun import rerun as rerun_case

    with refusals():
        check_figure(output, force=force, made_by="ampi rerun", others=[path])
        found = rerun_case(path, case, watch=None if as_json else _print_attempt)
        if math.isfinite(found.trajectory.final_time):
            draw_trajectory(output, found.mission, found.trajectory, "ampi rerun")
    if as_json:
        print_json(found.as_dict())
    else:
        out.print(f"{found.where}; stored: {escaped(found.stored)}")
        print_summary(found.trajectory.summary())
    if not found.trajectory.status.ok:
        raise typer.Exit(1)


def _print_attempt(result: AttemptResult) -> None:
    solves = "1 solve" if result.solves == 1 else f"{result.solves} solves"
    out.print(f"{result.attempt} ({solves}): {escaped(result.outcome)}")
    if result.trajectory is not None:
        out.print(convergence_table(result.trajectory))


def verify(path: DatabaseArgument, as_json: Json = False) -> None:
    """Check every byte of a database and name what is damaged.

    Exit status 2 where the file is damaged.
    """
    from database.audit.verify import verify as verify_file

    with refusals():
        found = verify_file(path)
    if as_json:
        print_json(found.as_dict())
    elif found.whole:
        out.print(
            f"{escaped(path)}: whole; {found.datasets} datasets, "
            f"{found.solved} of {found.cases} cases solved, "
            f"SHA-256 {found.sha256}"
        )
    for fault in found.faults:
        print_error(f"{escaped(path)}: {escaped(fault)}")
    if not found.whole:
        raise typer.Exit(2)
