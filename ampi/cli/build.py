"""`ampi build`, `ampi refine`, `ampi crop`: what writes a trajectory database."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ampi.cli.cluster import cluster
from ampi.cli.console import error_out, escaped, out, print_json
from ampi.cli.endings import Stopped, refusals
from ampi.cli.options import DatabaseArgument, Jobs, Json, MissionArgument, key_and_value
from ampi.cli.progress import progress

if TYPE_CHECKING:
    from ampi.missions.mission import Mission
    from database.build_report import BuildReport
    from database.crop import CropReport
    from database.refine import RefineReport


def build(
    mission: MissionArgument,
    path: Annotated[Path, typer.Argument(help="HDF5 file to write.")],
    *,
    jobs: Jobs,
    resume: Annotated[
        bool, typer.Option(help="Continue an interrupted build, or start afresh.")
    ] = True,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a dask.distributed scheduler to solve on.")
    ] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(help="Of one solve (s); then the case is tried along another path."),
    ] = None,
    sensitivities: Annotated[
        bool,
        typer.Option(
            "--sensitivities",
            help="Store the derivatives of every optimum over the parameters, too.",
        ),
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="Build a large grid without being asked.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Solve a mission's whole grid and write the trajectory database. Run again to resume.

    Exit status: 0 if all cases are solved, 1 if the file is written but cases have no solution, 2 if
    nothing could be built, 130 if interrupted.
    """
    from ampi.missions.loading import load_mission

    with refusals():
        loaded = load_mission(mission)
        try:
            with cluster(scheduler) as client:
                asked = {"resume": resume, "sensitivities": sensitivities}
                _agree_to_build(loaded, path, client, jobs, yes=yes, **asked)
                report = _build(loaded, path, client, jobs, time_limit, **asked)
        except Stopped as stopped:
            _print_how_to_go_on(path)
            raise typer.Exit(128 + stopped.signal) from None
    if as_json:
        print_json(report.as_dict())
    else:
        _print_build(report, path)
    _end_of_build(report)


def _build(
    mission: Mission,
    path: Path,
    client: Any,
    jobs: int,
    time_limit: float | None,
    *,
    resume: bool,
    sensitivities: bool,
) -> BuildReport:
    import database
    from database.plan.grid import Grid
    from database.records.campaign import TIME_LIMIT

    with progress("solving", Grid.from_mission(mission).size) as advance:
        return database.build(
            mission,
            path,
            n_jobs=jobs,
            client=client,
            resume=resume,
            sensitivities=sensitivities,
            time_limit=TIME_LIMIT if time_limit is None else time_limit,
            advance=advance,
        )


def _print_how_to_go_on(path: Path) -> None:
    from ampi.dataset import partial_folder
    from database.records.record_files import count_records

    folder = partial_folder(path)
    kept = count_records(folder) if folder.is_dir() else 0
    again = shlex.join(word for word in sys.argv[1:] if word != "--no-resume")
    error_out.print(
        f"Interrupted: {kept} solved cases are kept in {escaped(folder)}. "
        f"To continue: ampi {escaped(again)}"
    )


def _print_build(report: BuildReport, path: Path) -> None:
    how = "already whole: " if report.already_whole else ""
    done = "" if how else f" in {report.seconds:.1f} s ({report.resumed} found solved)"
    out.print(
        f"{escaped(path)}: {how}{report.solved} of {report.cases} cases solved{done}, "
        f"{report.median_iterations:.0f} iterations in the median, {report.worst_iterations} at "
        f"most; re-integrated position error at most {report.worst_position_error:.1f} m, "
        f"limits used to {100 * report.worst_limit:.1f} %"
    )


def _end_of_build(report: BuildReport) -> None:
    """What is to be said of a database that is written; exit status 1 if it has holes."""
    for line in report.failure_summary:
        error_out.print(escaped(line))
    for doubt in report.doubts:
        error_out.print(f"warning: {escaped(doubt)}")
    if report.solved < report.cases:
        raise typer.Exit(1)


def _agree_to_build(
    mission: Mission,
    path: Path,
    client: Any,
    jobs: int,
    *,
    yes: bool,
    resume: bool,
    sensitivities: bool,
) -> None:
    """Say what it will take; before a large build ask, and where nobody can be asked refuse."""
    from ampi.dataset import partial_folder
    from database.estimate import MOST_EVER, estimate

    workers = jobs if client is None else max(1, sum(client.nthreads().values()))
    found = estimate(mission, path, workers=workers, sensitivities=sensitivities)
    if not found.possible:
        raise ValueError(
            f"{found}; expected at most {MOST_EVER:,} cases: give the axes fewer points"
        )
    asked = sys.stdin.isatty() and sys.stderr.isatty()
    if sys.stderr.isatty() or (yes and found.large):
        error_out.print(str(found))
    # nothing is to be solved
    whole = resume and path.exists() and not partial_folder(path).exists()
    if yes or not found.large or whole:
        return
    if not asked:
        raise ValueError(f"{found}; to build that much, add --yes")
    if not typer.confirm("Build it?", err=True):
        raise typer.Exit(2)


def refine(
    path: DatabaseArgument,
    output: Annotated[
        Path | None, typer.Option(help="Database to write; by default NAME-refined.h5 beside it.")
    ] = None,
    parameter: Annotated[
        str | None, typer.Option(help="Axis to refine, by default where a point pays most.")
    ] = None,
    *,
    jobs: Jobs,
    as_json: Json = False,
) -> None:
    """Add the point that pays most to the grid; solved cases are kept. Run again to resume.

    Exit status 1 where cases have no solution.
    """
    from database.refine import refine as refine_database

    target = output or path.with_name(f"{path.stem}-refined{path.suffix}")
    with refusals(), progress("refining", 1) as advance:
        report = refine_database(path, target, parameter=parameter, n_jobs=jobs)
        advance(1)
    if as_json:
        cell = {**asdict(report.cell), "gain_per_case": report.cell.gain_per_case}
        print_json({**vars(report), "cell": cell, "build": report.build.as_dict()})
    else:
        _print_refinement(report, target)
    _end_of_build(report.build)


def _print_refinement(report: RefineReport, target: Path) -> None:
    built = report.build
    out.print(
        f"{escaped(target)}: {report.cell.key} with one more point at {report.offset:g}, "
        f"which takes away {100 * report.cell.gain:.0f} % of the interpolation error; "
        f"{report.reused} cases kept, {report.solved_anew} new, "
        f"{built.solved} of {built.cases} solved in {built.seconds:.1f} s"
    )


def crop(
    path: DatabaseArgument,
    drop: Annotated[
        list[str] | None,
        typer.Option(help="Grid point to leave out, KEY=VALUE in the key's unit; repeatable."),
    ] = None,
    box: Annotated[
        bool, typer.Option("--box", help="Keep the largest box without an unsolved case.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option(help="Database to write; by default NAME-cropped.h5 beside it.")
    ] = None,
    *,
    jobs: Jobs,
    as_json: Json = False,
) -> None:
    """Leave out grid points with cases that nobody can solve; all else is taken over as it is."""
    from database.crop import crop as crop_database

    target = output or path.with_name(f"{path.stem}-cropped{path.suffix}")
    with refusals(), progress("cropping", 1) as advance:
        given = [key_and_value(text, "--drop") for text in drop or []]
        report = crop_database(path, target, drop=given, box=box, n_jobs=jobs)
        advance(1)
    if as_json:
        print_json({**vars(report), "build": report.build.as_dict()})
    else:
        _print_crop(report, target)
    _end_of_build(report.build)


def _print_crop(report: CropReport, target: Path) -> None:
    dropped = "; ".join(
        f"{key} = {', '.join(f'{v:.6g}' for v in values)}" for key, values in report.dropped.items()
    )
    out.print(
        f"{escaped(target)}: {report.build.cases} of {report.cases_before} cases, "
        f"{report.build.solved} of them solved; without {dropped}"
    )
