"""The command line `ampi`: parse, hand over, print. The only room that may import everything."""

from __future__ import annotations

import csv
import json
import os
import shlex
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import joblib
import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission, MissionError
from ampi.outputs import FIGURES, check_figures, check_output, written
from ampi.progress import progress
from ampi.terminal import discard, standard_stream
from ampi.trajectory import GuessTried, Status, Trajectory
from ampi.workers.job import JobError

if TYPE_CHECKING:
    from ampi.dataset import TrajectoryDataset
    from ampi.papers.table import Reproduction

app = typer.Typer(
    help="Entry guidance from a database of optimal trajectories.",
    epilog="Exit status: 0 done; 1 done in part, and the output says what is missing; 2 refused, "
    "not solved or damaged, and one sentence on standard error says why; 130 interrupted, and what "
    "is solved is kept.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
# paths and titles are data: no markup, no :names: of pictures; and where there is no terminal nobody
# knows how wide it is, and no number may be cut
PLAIN: dict[str, Any] = {"markup": False, "emoji": False, "highlight": False, "soft_wrap": True}
out = Console(**PLAIN, width=None if sys.stdout and sys.stdout.isatty() else 160)
error_out = Console(**PLAIN, stderr=True)

Jobs = Annotated[int, typer.Option("--jobs", "-j", min=1, help="Worker processes.")]
Json = Annotated[bool, typer.Option("--json", help="Print numbers as JSON.")]
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Replace flights, and files of other commands, that are already there.",
    ),
]
MissionArgument = Annotated[str, typer.Argument(help="Name of a shipped mission, or a .toml file.")]
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
DatabaseArgument = Annotated[Path, typer.Argument(help="Trajectory database (.h5).")]
HolesOption = Annotated[
    str, typer.Option("--holes", help="Of a database with unsolved cases: refuse it, or fly it.")
]
CORES = joblib.cpu_count()  # those that this process may use
MOST_CASES = 12  # numbers of cases in a printed line; --json has them all


class Stopped(SystemExit):
    """A signal has asked for the end: what was begun is ended in order, workers and temporary files."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.signal = signal.Signals(number)


def _stop(number: int, frame: FrameType | None) -> None:
    for one in STOPPING:  # whoever asks twice does not wait
        signal.signal(one, signal.SIG_DFL)
    raise Stopped(number)


@contextmanager
def _told() -> Iterator[None]:
    """Misuse and bad files end in one clear sentence, not in a traceback."""
    try:
        yield
    except (ValueError, OSError, MemoryError, JobError) as error:
        _print_error(_sentence(error))
        raise typer.Exit(2) from None
    except Stopped as stopped:
        error_out.print(f"Interrupted by {stopped.signal.name}.")
        raise


def _sentence(error: Exception) -> str:
    """The file before what befell it, without the system's number."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{_escaped(error.filename)}: {error.strerror}"
    lines = isinstance(error, MissionError)  # a line for each fault
    return "\n".join(map(_escaped, str(error).split("\n"))) if lines else _escaped(error)


def _print_error(sentence: str) -> None:
    error_out.print(Text.assemble(("error:", "bold red"), " ", sentence))


def _escaped(value: object) -> str:
    """On one line, as it is, but for characters that would move the cursor: those as in Python."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(value))


def _check_drawing(wanted: Path | None) -> None:
    """Before the work: what draws is installed, and asks for no window that the environment names."""
    if wanted is None:
        return
    os.environ["MPLBACKEND"] = (
        "agg"  # matplotlib refuses to be imported under one that is not there
    )
    try:
        import jinja2  # noqa: F401
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise ValueError(
            f"{wanted}: drawing needs {error.name}, which is not installed; "
            "try: pip install 'ampi[report]'"
        ) from None
    except UnicodeDecodeError as error:
        raise ValueError(
            f"matplotlibrc: expected UTF-8, got {error.reason} at byte {error.start}; mend or move "
            "the file of this name in the working folder or in matplotlib's configuration folder"
        ) from None


def _print_json(value: Any) -> None:
    text = json.dumps(_without_nan(value), indent=1, default=float, allow_nan=False)
    sys.stdout.write(text + "\n")


def _without_nan(value: Any) -> Any:
    """What is no number is null: JSON has no word for it, and strict readers refuse NaN."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value


@app.command()
def missions() -> None:
    """List the shipped missions."""
    from ampi.missions.loading import shipped_missions

    for name in shipped_missions():
        out.print(f"{name:16} {load_mission(name).title}")


@app.command()
def solve(
    mission: MissionArgument,
    method: Annotated[str, typer.Option(help="exact_hessian, zhou2021, …")] = "exact_hessian",
    bank_angle: Annotated[
        float | None, typer.Option(help="Constant bank angle of the first guess (deg).")
    ] = None,
    refined: Annotated[bool, typer.Option("--refine", help="Refine the mesh (hp).")] = False,
    each_guess: Annotated[
        bool,
        typer.Option("--guesses", help="Start from several bank angles: which optima are there?"),
    ] = False,
    table: Annotated[Path | None, typer.Option("--csv", help="Write the nodes as CSV.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the trajectory (PNG, PDF, SVG).")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Solve a mission's optimal control problem once.

    Exit status 2 where the answer is no solution; it is printed and drawn all the same.
    """
    from ampi.scp.guess import ConstantBank
    from ampi.scp.problem.shortfall import verdict
    from ampi.scp.refinement import RefinementSettings
    from ampi.scp.solve import solve as solve_mission

    with _told():
        check_output(table, force=force, made_by=CSV_HEADER, others=[mission, plot])
        check_output(plot, *FIGURES, force=force, made_by="ampi solve", others=[mission])
        _check_drawing(plot)
        loaded = load_mission(mission)
        guess = None if bank_angle is None else ConstantBank(float(np.radians(bank_angle)))
        refinement = RefinementSettings() if refined else None
        if each_guess:
            _refuse_with_guesses(method, bank_angle, refined, table, plot)
            _print_guesses(loaded, as_json)
            return
        optimum = solve_mission(loaded, method=method, guess=guess, refinement=refinement)
        summary = optimum.summary()
        if np.isfinite(optimum.final_time):
            _write_trajectory(loaded, optimum, table, plot, "ampi solve")
    if as_json:
        log = [asdict(row) for row in optimum.statistics.log]
        rounds = [asdict(row) for row in optimum.statistics.rounds]
        more: dict[str, Any] = {"verdict": verdict(loaded, optimum), "log": log, "rounds": rounds}
        more["guesses"] = [_guess_row(one) for one in optimum.statistics.guesses]
        if refined:
            more["mesh_toml"] = optimum.mesh.toml
        _print_json({**summary, **more})
    else:
        out.print(_convergence_table(optimum))
        for one in optimum.statistics.guesses:
            out.print(
                f"  from a constant bank angle of {np.degrees(one.bank_angle):.4g}°: {one.status} after "
                f"{one.iterations} iterations{', shown above' if one.chosen else ''}"
            )
        if refined:
            out.print("the mesh, to paste into the mission in the place of its own:")
            sys.stdout.write(optimum.mesh.toml)
        out.print(verdict(loaded, optimum))
        for key, value in summary.items():
            out.print(
                f"  {key:34} {value:.8g}" if not isinstance(value, str) else f"  {key:34} {value}"
            )
    if not optimum.status.ok:
        says_how = optimum.status in (Status.INACCURATE, Status.REFINEMENT_LIMIT)
        ways = "" if says_how else " Move the target, widen the limits, or try another --bank-angle"
        _print_error(f"{_escaped(loaded.name)}: {_escaped(verdict(loaded, optimum))}{ways}")
        raise typer.Exit(2)


def _refuse_with_guesses(
    method: str, bank_angle: float | None, refined: bool, table: Path | None, plot: Path | None
) -> None:
    given = {"--method": method != "exact_hessian", "--bank-angle": bank_angle is not None}
    given |= {"--refine": refined, "--csv": table is not None, "--plot": plot is not None}
    if any(given.values()):
        asked = ", ".join(name for name, is_given in given.items() if is_given)
        raise ValueError(f"--guesses: starts from each guess and keeps none; leave out {asked}")


def _guess_row(one: GuessTried) -> dict[str, Any]:
    return {
        "bank_angle_deg": float(np.degrees(one.bank_angle)),
        "status": one.status.name,
        "iterations": one.iterations,
        "cost": one.cost,
        "chosen": one.chosen,
    }


def _print_guesses(mission: Mission, as_json: bool) -> None:
    """What every guess leads to, and which of the answers are one branch."""
    from ampi.scp.guesses import from_each
    from ampi.scp.solve import solve as solve_mission

    results = from_each(mission, lambda guess: solve_mission(mission, guess=guess))
    rows = [
        {
            "guess_bank_angle_deg": float(np.degrees(one.guess.bank_angle)),
            "status": one.trajectory.status.name,
            "cost": one.trajectory.cost,
            "bank_at_entry_deg": float(np.degrees(one.trajectory.states[6, 0])),
            "final_time_s": one.trajectory.final_time,
            "iterations": one.trajectory.statistics.iterations,
            "branch": one.branch,
        }
        for one in results
    ]
    if as_json:
        _print_json(rows)
    else:
        shown = Table("guess (deg)", "status", "cost", "bank at entry (deg)", "t_f (s)", "branch")
        for row in rows:
            shown.add_row(
                f"{row['guess_bank_angle_deg']:.4g}",
                str(row["status"]),
                f"{row['cost']:.6g}",
                f"{row['bank_at_entry_deg']:.2f}",
                f"{row['final_time_s']:.2f}",
                "–" if row["branch"] is None else str(row["branch"]),
            )
        out.print(shown)
        out.print(
            "Name the guess of the branch to follow in the mission: [guess] bank_angle_deg = …"
            if any(row["branch"] for row in rows)
            else "No guess leads to a solution: move the target or widen the limits"
        )
    if not any(one.trajectory.status.ok for one in results):
        raise typer.Exit(2)


def _convergence_table(optimum: Trajectory) -> Table:
    table = Table(
        "iteration", "cost", "step (deg)", "t_f (s)", "radius (deg)", "ratio", "step kept"
    )
    for row in optimum.statistics.log:
        table.add_row(
            str(row.iteration),
            f"{row.cost:.6g}",
            f"{np.degrees(row.step):.2e}",
            f"{row.final_time:.2f}",
            f"{np.degrees(row.trust_radius):.3g}",
            f"{row.ratio:.3f}",
            "yes" if row.accepted else "no",
        )
    return table


def _write_trajectory(
    mission: Mission, optimum: Trajectory, table: Path | None, plot: Path | None, made_by: str
) -> None:
    if table is not None:
        _write_csv(table, optimum.times, optimum.states, optimum.bank_rate)
    if plot is not None:
        from ampi.report.figures.look import save_figure
        from ampi.report.figures.single import trajectory_figure

        save_figure(plot, trajectory_figure(mission, optimum), made_by)


CSV_HEADER = (
    "time_s,altitude_m,longitude_deg,latitude_deg,speed_m_per_s,flight_path_angle_deg,azimuth_deg,"
    "bank_angle_deg,bank_rate_deg_per_s"
)


def _write_csv(path: Path, times: Any, states: Any, bank_rate: Any) -> None:
    degrees = states.copy()
    degrees[[1, 2, 4, 5, 6]] = np.degrees(degrees[[1, 2, 4, 5, 6]])
    with (
        written(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(CSV_HEADER.split(","))
        for i, t in enumerate(times):
            row = [t, *degrees[:, i], np.degrees(bank_rate[i])]
            writer.writerow([f"{value:.10g}" for value in row])


@app.command()
def build(
    mission: MissionArgument,
    path: Annotated[Path, typer.Argument(help="HDF5 file to write.")],
    jobs: Jobs = CORES,
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
    yes: Annotated[
        bool, typer.Option("--yes", help="Build a large grid without being asked.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Solve a mission's whole grid and write the trajectory database. Run again to resume.

    Exit status: 0 if all cases are solved, 1 if the file is written but cases have no solution, 2 if
    nothing could be built, 130 if interrupted.
    """
    import database
    from ampi.dataset import partial_folder
    from database.plan.grid import Grid
    from database.records.campaign import TIME_LIMIT
    from database.records.record_files import count_records

    with _told():
        loaded = load_mission(mission)
        size = Grid.from_mission(loaded).size
        try:
            with _cluster(scheduler) as client:
                _agree_to_build(loaded, path, client, jobs, yes=yes, resume=resume)
                with progress("solving", size) as advance:
                    report = database.build(
                        loaded,
                        path,
                        n_jobs=jobs,
                        client=client,
                        resume=resume,
                        time_limit=TIME_LIMIT if time_limit is None else time_limit,
                        advance=advance,
                    )
        except Stopped as stopped:
            folder = partial_folder(path)
            kept = count_records(folder) if folder.is_dir() else 0
            again = shlex.join(word for word in sys.argv[1:] if word != "--no-resume")
            error_out.print(
                f"Interrupted: {kept} solved cases are kept in {_escaped(folder)}. "
                f"To continue: ampi {_escaped(again)}"
            )
            raise typer.Exit(128 + stopped.signal) from None
    if as_json:
        _print_json(report.as_dict())
    else:
        how = "already whole: " if report.already_whole else ""
        done = "" if how else f" in {report.seconds:.1f} s ({report.resumed} found solved)"
        out.print(
            f"{_escaped(path)}: {how}{report.solved} of {report.cases} cases solved{done}, "
            f"{report.median_iterations:.0f} iterations in the median, {report.worst_iterations} at "
            f"most; re-integrated position error at most {report.worst_position_error:.1f} m, "
            f"limits used to {100 * report.worst_limit:.1f} %"
        )
    _end_of_build(report)


def _agree_to_build(
    mission: Mission, path: Path, client: Any, jobs: int, *, yes: bool, resume: bool
) -> None:
    """Say what it will take; before a large build ask, and where nobody can be asked refuse."""
    from ampi.dataset import partial_folder
    from database.estimate import MOST_EVER, estimate

    workers = jobs if client is None else max(1, sum(client.nthreads().values()))
    found = estimate(mission, path, workers=workers)
    if not found.possible:
        raise ValueError(
            f"{found}; expected at most {MOST_EVER:,} cases: give the axes fewer points"
        )
    asked = sys.stdin.isatty() and sys.stderr.isatty()
    if sys.stderr.isatty() or (yes and found.large):
        error_out.print(str(found))
    whole = (
        resume and path.exists() and not partial_folder(path).exists()
    )  # nothing is to be solved
    if yes or not found.large or whole:
        return
    if not asked:
        raise ValueError(f"{found}; to build that much, add --yes")
    if not typer.confirm("Build it?", err=True):
        raise typer.Exit(2)


def _end_of_build(report: Any) -> None:
    """What is to be said of a database that is written; exit status 1 if it has holes."""
    for line in report.failure_summary:
        error_out.print(_escaped(line))
    for doubt in report.doubts:
        error_out.print(f"warning: {_escaped(doubt)}")
    if report.solved < report.cases:
        raise typer.Exit(1)


@contextmanager
def _cluster(scheduler: str | None) -> Iterator[Any]:
    """A client of a running scheduler; None without an address."""
    if scheduler is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise ValueError(
            "--scheduler: needs dask.distributed, which is not installed; "
            "try: pip install 'ampi[cluster]'"
        ) from None
    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"--scheduler: expected the address of a running scheduler, got {scheduler!r} "
            f"({type(error).__name__}); start one with: dask scheduler"
        ) from None
    with client:
        yield client


@app.command()
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
    from database.rerun import AttemptResult
    from database.rerun import rerun as rerun_case

    def show(result: AttemptResult) -> None:
        out.print(f"{result.attempt} ({result.solves} solves): {_escaped(result.outcome)}")
        if result.trajectory is not None:
            out.print(_convergence_table(result.trajectory))

    with _told():
        check_output(output, *FIGURES, force=force, made_by="ampi rerun", others=[path])
        _check_drawing(output)
        found = rerun_case(path, case, watch=None if as_json else show)
        if output is not None and np.isfinite(found.trajectory.final_time):
            _write_trajectory(found.mission, found.trajectory, None, output, "ampi rerun")
    if as_json:
        _print_json(found.as_dict())
    else:
        out.print(f"{found.where}; stored: {_escaped(found.stored)}")
        for key, value in found.trajectory.summary().items():
            shown = value if isinstance(value, str) else f"{value:.8g}"
            out.print(f"  {key:34} {shown}")
    if not found.trajectory.status.ok:
        raise typer.Exit(1)


@app.command()
def verify(path: DatabaseArgument, as_json: Json = False) -> None:
    """Check every byte of a database and name what is damaged.

    Exit status 2 where the file is damaged.
    """
    from database.audit.verify import verify as verify_file

    with _told():
        found = verify_file(path)
    if as_json:
        _print_json(found.as_dict())
    elif found.whole:
        out.print(
            f"{_escaped(path)}: whole; {found.datasets} datasets, "
            f"{found.solved} of {found.cases} cases solved, "
            f"SHA-256 {found.sha256}"
        )
    for fault in found.faults:
        _print_error(f"{_escaped(path)}: {_escaped(fault)}")
    if not found.whole:
        raise typer.Exit(2)


@app.command()
def audit(
    path: DatabaseArgument,
    probes: Annotated[int, typer.Option(min=0, help="Random points to solve.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random points.")] = 2016,
    mend: Annotated[
        bool, typer.Option("--repair", help="First re-solve the cases that stand out.")
    ] = False,
    figures: Annotated[
        Path | None, typer.Option(help="Folder for coherence.png and error_map.png.")
    ] = None,
    jobs: Jobs = CORES,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Is the database true, is it smooth, what does interpolating it cost, where would a point pay?"""
    from ampi.dataset import read_dataset
    from database.audit.audit import audit as audit_dataset
    from database.repair import repair

    with _told():
        check_figures(figures, AUDIT_FIGURES, force=force, made_by="ampi audit")
        _check_drawing(figures)
        repairs = repair(path, n_jobs=jobs) if mend else ()
        dataset = read_dataset(path)
        with progress("auditing", int(dataset.solved.sum()) + probes) as advance:
            report = audit_dataset(dataset, probes=probes, seed=seed, n_jobs=jobs, advance=advance)
        if figures is not None:
            _draw_audit(report, figures)
    if as_json:
        _print_json({**report.as_dict(), "repairs": [asdict(one) for one in repairs]})
        return
    for one in repairs:
        out.print(_escaped(one))
    statuses = ", ".join(f"{n} {name.lower()}" for name, n in report.statuses.items())
    out.print(f"{_escaped(path)}: {report.cases} cases: {statuses}")
    truth = Table("against re-integration (DOP853)", "median", "90 %", "worst")
    for label, q in (
        ("position (m)", report.position_error),
        ("altitude (m)", report.altitude_error),
        ("speed (m/s)", report.speed_error),
    ):
        truth.add_row(label, f"{q.median:.3g}", f"{q.percentile_90:.3g}", f"{q.worst:.3g}")
    out.print(truth)
    for name, value in report.limits.items():
        out.print(
            f"  greatest {name.replace('_', ' ')} between the nodes: {100 * value:.1f} % of its limit"
        )
    if report.probes:
        out.print(_interpolation_table(report))
    if report.hidden_probes:
        out.print(
            f"{report.hidden_probes} of {report.probes} probes lie in cells with a case that has no "
            "solution: nothing is interpolated there"
        )
    if report.unsolved_probes:
        out.print(f"{report.unsolved_probes} of {report.probes} probes could not be solved")
    _print_coherence(report, path)
    _print_branches(report, path)
    _print_error_map(report)


def _print_coherence(report: Any, path: Path) -> None:
    from database.audit.coherence import ROWS, THRESHOLD

    smooth = report.coherence
    if not smooth.triples:
        out.print("coherence: unknown, no axis has three points in a row with a solution")
        return
    row = int(np.nanargmax(smooth.worst))
    hidden = int(np.isnan(smooth.roughness).sum()) - report.cases + report.statuses.get("SOLVED", 0)
    out.print(
        f"coherence: {smooth.triples} second differences, the roughest {smooth.worst[row]:.1f} times "
        f"the family's scale ({ROWS[row].replace('_', ' ')}); a case stands out above {THRESHOLD:g}"
        + (f"; unknown for {hidden} cases that are in none" if hidden else "")
    )
    for outlier in smooth.outliers:
        limit = "" if outlier.limit is None else outlier.limit.replace("_", " ")
        bend = f"; the {limit} reaches its limit there and in no case beside it" if limit else ""
        out.print(f"  {_outlier_name(outlier)}: roughness {outlier.roughness:.1f}{bend}")
    if smooth.outliers:
        out.print(
            "  on another branch, or where a limit begins to act; re-solve them from their neighbours "
            f"with: ampi audit {_escaped(shlex.quote(str(path)))} --repair"
        )


def _print_branches(report: Any, path: Path) -> None:
    from database.audit.branches import FLOWN

    found = report.branches
    if found.worst_pair is None:
        out.print("branches: unknown, no two cases beside each other have a solution")
        return
    one, other = found.worst_pair
    out.print(
        f"branches: halfway between neighbours the interpolated bank angle flies up to "
        f"{found.worst_flown / 1e3:.1f} km from the interpolated flight (cases {one} and {other}; "
        f"{found.flown} of {found.pairs} pairs flown, the least alike)"
    )
    for branch in found.astray:
        cases = ", ".join(map(str, branch.cases[:MOST_CASES]))
        more = f" and {len(branch.cases) - MOST_CASES} more" * (len(branch.cases) > MOST_CASES)
        out.print(
            f"  another branch: {'case' if len(branch.cases) == 1 else 'cases'} {cases}{more}; bank at "
            f"entry {_degrees(branch.bank_at_entry)}, of the rest {_degrees(found.main_bank_at_entry)}; "
            f"cost {branch.cost_ratio:.2f} times that of the cases beside"
        )
    if not found.astray and found.worst_flown > FLOWN:
        out.print(
            f"  one branch, but above {FLOWN / 1e3:g} km too wide a step for interpolation; add a point "
            f"with: ampi refine {_escaped(shlex.quote(str(path)))}"
        )
    if found.astray:
        out.print(
            "  nothing interpolates between two branches, and no new point pays there; bring all cases "
            f"onto one with: ampi audit {_escaped(shlex.quote(str(path)))} --repair"
        )


def _degrees(span: tuple[float, float]) -> str:
    low, high = np.degrees(span)
    return f"{low:.1f} … {high:.1f} deg" if high - low > 0.05 else f"{low:.1f} deg"


def _outlier_name(outlier: Any) -> str:
    return f"case {outlier.case} at grid index {outlier.index}"


def _best_cell(report: Any) -> Any:
    """Where a point pays most; None if failed cases hide every cell."""
    from database.audit.error_map import best_cell

    known = any(np.isfinite(cell.gain) for cell in report.error_map)
    return best_cell(report.error_map) if known else None


def _print_error_map(report: Any) -> None:
    best = _best_cell(report)
    out.print(
        "interpolation error in each cell, 90 %, and what one more point there would take away:"
    )
    heads = ("m", "m/s", "deg", "s", "gain", "solves")
    out.print(f"  {'':34}" + "".join(f"{head:>9}" for head in heads))
    for cell in report.error_map:
        mark = ", probed" if cell.source == "probes" else ""
        mark += " ← pays most" if cell is best else ""
        errors = "".join(f" {_known(error):>8}" for error in cell.errors.values())
        gain = f"{100 * cell.gain:.1f} %" if np.isfinite(cell.gain) else _known(cell.gain)
        name = f"{cell.key} {cell.low:g} … {cell.high:g}"
        out.print(f"  {name:34}{errors} {gain:>8}{cell.new_cases:8}{mark}")


def _known(value: float) -> str:
    """Three digits, or a dash where failed cases hide a number; "inf" of a flight with no end."""
    return "–" if np.isnan(value) else f"{value:.3g}"


AUDIT_FIGURES = ("coherence.png", "error_map.png")


def _draw_audit(report: Any, folder: Path) -> None:
    from ampi.report.figures.audit import CellBar, coherence_figure, error_map_figure
    from ampi.report.figures.look import save_figure
    from database.audit.coherence import THRESHOLD

    best = _best_cell(report)
    bars = [
        CellBar(cell.parameter, f"{cell.low:g} … {cell.high:g}", cell.errors, cell is best)
        for cell in report.error_map
    ]
    outliers = {o.case for o in report.coherence.outliers}
    named = {case: f"case {case}" for case in sorted(outliers | set(report.branches.cases))}
    smooth = coherence_figure(report.coherence.roughness.ravel(), THRESHOLD, named)
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in zip(AUDIT_FIGURES, (smooth, error_map_figure(bars)), strict=True):
        save_figure(folder / name, figure, "ampi audit")


@app.command()
def refine(
    path: DatabaseArgument,
    output: Annotated[
        Path | None, typer.Option(help="Database to write; by default NAME-refined.h5 beside it.")
    ] = None,
    parameter: Annotated[
        str | None, typer.Option(help="Axis to refine, by default where a point pays most.")
    ] = None,
    jobs: Jobs = CORES,
    as_json: Json = False,
) -> None:
    """Add the point that pays most to the grid; solved cases are kept. Run again to resume.

    Exit status 1 where cases have no solution.
    """
    from database.refine import refine as refine_database

    target = output or path.with_name(f"{path.stem}-refined{path.suffix}")
    with _told(), progress("refining", 1) as advance:
        report = refine_database(path, target, parameter=parameter, n_jobs=jobs)
        advance(1)
    built = report.build
    if as_json:
        cell = {**asdict(report.cell), "gain_per_case": report.cell.gain_per_case}
        _print_json({**vars(report), "cell": cell, "build": built.as_dict()})
    else:
        out.print(
            f"{_escaped(target)}: {report.cell.key} with one more point at {report.offset:g}, "
            f"which takes away {100 * report.cell.gain:.0f} % of the interpolation error; "
            f"{report.reused} cases kept, "
            f"{report.solved_anew} new, {built.solved} of {built.cases} solved in "
            f"{built.seconds:.1f} s"
        )
    _end_of_build(built)


@app.command()
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
    jobs: Jobs = CORES,
    as_json: Json = False,
) -> None:
    """Leave out grid points with cases that nobody can solve; all else is taken over as it is."""
    from database.crop import crop as crop_database

    target = output or path.with_name(f"{path.stem}-cropped{path.suffix}")
    with _told(), progress("cropping", 1) as advance:
        given = [_key_and_value(text, "--drop") for text in drop or []]
        report = crop_database(path, target, drop=given, box=box, n_jobs=jobs)
        advance(1)
    built = report.build
    if as_json:
        _print_json({**vars(report), "build": built.as_dict()})
    else:
        dropped = "; ".join(
            f"{key} = {', '.join(f'{v:.6g}' for v in values)}"
            for key, values in report.dropped.items()
        )
        out.print(
            f"{_escaped(target)}: {built.cases} of {report.cases_before} cases, {built.solved} of them "
            f"solved; without {dropped}"
        )
    _end_of_build(built)


def _interpolation_table(report: Any) -> Table:
    measured = report.probes - report.hidden_probes - report.unsolved_probes
    table = Table(
        f"interpolation, 90 % of {measured} points",
        "altitude (m)",
        "speed (m/s)",
        "bank (deg)",
        "t_f (s)",
        "open-loop miss (km)",
    )
    for mode, columns in report.interpolation.items():
        table.add_row(mode, *(_known(q.percentile_90) for q in columns.values()))
    return table


def _entry_option(unit: str) -> Any:
    return typer.Option(help=f"Measured at the entry interface ({unit}); nominal if not given.")


@app.command()
def guide(
    path: DatabaseArgument,
    altitude_km: Annotated[float | None, _entry_option("km")] = None,
    longitude_deg: Annotated[float | None, _entry_option("deg")] = None,
    latitude_deg: Annotated[float | None, _entry_option("deg")] = None,
    speed: Annotated[float | None, _entry_option("m/s")] = None,
    flight_path_angle_deg: Annotated[float | None, _entry_option("deg")] = None,
    azimuth_deg: Annotated[float | None, _entry_option("deg")] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option("--parameter", "-p", help="Any parameter of the database, KEY=VALUE."),
    ] = None,
    mode: Annotated[str, typer.Option(help="ampi, mpi, quadratic or nominal.")] = "ampi",
    holes: HolesOption = "refuse",
    table: Annotated[Path | None, typer.Option("--csv", help="Write the reference as CSV.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw it (PNG, PDF, SVG).")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measured parameters → the reference that the tracker flies.

    Exit status 1 where they lie outside the hypercube by more than 20 % of an axis' range.
    """
    from ampi.dataset import read_dataset
    from ampi.loading import load_guidance
    from ampi.missions.parameters import measured_values
    from ampi.onboard.health import Health
    from ampi.onboard.reference import Mode

    with _told():
        check_output(table, force=force, made_by=CSV_HEADER, others=[path, plot])
        check_output(plot, *FIGURES, force=force, made_by="ampi guide", others=[path])
        _check_drawing(plot)
        chosen = _choice(Mode, mode, "--mode")
        loaded = read_dataset(path).mission
        options = {
            "altitude_km": altitude_km,
            "longitude_deg": longitude_deg,
            "latitude_deg": latitude_deg,
            "speed_m_per_s": speed,
            "flight_path_angle_deg": flight_path_angle_deg,
            "azimuth_deg": azimuth_deg,
        }
        given = {key: value for key, value in options.items() if value is not None}
        for key, value in map(_key_and_value, parameter or []):
            if key in given:
                raise ValueError(f"{key}: given twice")
            given[key] = value
        measured = measured_values(loaded, loaded.parameters, given)
        reference = load_guidance(path, mode=chosen, holes=_holes(holes)).reference(measured)
        if table is not None:
            _write_csv(table, reference.times, reference.states, reference.bank_rate)
        if plot is not None:
            from ampi.report.figures.look import save_figure
            from ampi.report.figures.single import reference_figure

            save_figure(
                plot, reference_figure(loaded.with_parameters(measured), reference), "ampi guide"
            )
    names = [p.name for p in loaded.parameters]
    outside = [name for name, c in zip(names, reference.clipped, strict=True) if c]
    excess = {name: share for name, share in zip(names, reference.excess, strict=True) if share > 0}
    for name, share in excess.items():
        by = np.format_float_positional(100 * share, precision=3, fractional=False, trim="-")
        error_out.print(f"warning: {name} lies outside the hypercube by {by} % of its axis' range")
    if reference.health >= Health.HOLE_REFERENCE:
        error_out.print(f"warning: {reference.health}: {reference.health.sentence}")
    if as_json:
        _print_json(
            {
                "parameters": dict(zip(names, measured.tolist(), strict=True)),
                "cell": reference.cell,
                "outside": outside,
                "excess": excess,
                "health": str(reference.health),
                "hole": reference.hole,
                "final_time_s": reference.final_time,
                "bank_angle_at_entry_deg": float(np.degrees(reference.states[6, 0])),
            }
        )
    else:
        cell = ", ".join(str(i) for i in reference.cell)
        out.print(
            f"cell ({cell}), final time {reference.final_time:.2f} s, bank angle at entry "
            f"{np.degrees(reference.states[6, 0]):.2f} deg"
        )
        if outside:
            out.print(f"outside the hypercube in {', '.join(outside)}: boundary trajectory")
        if reference.hole:
            out.print("in a cell with an unsolved case: the nearest solved one stands for it")
    if reference.health >= Health.FAR_OUTSIDE:
        raise typer.Exit(1)


def _choice(kind: Any, text: str, option: str) -> Any:
    """The member of an enumeration with this value."""
    values = [member.value for member in kind]
    if text not in values:
        raise ValueError(f"{option}: expected one of {', '.join(values)}, got {text!r}")
    return kind(text)


def _holes(text: str) -> Literal["refuse", "fly"]:
    if text not in ("refuse", "fly"):
        raise ValueError(f"--holes: expected refuse or fly, got {text!r}")
    return "fly" if text == "fly" else "refuse"


def _key_and_value(text: str, option: str = "--parameter") -> tuple[str, float]:
    key, _, value = text.partition("=")
    try:
        return key.strip(), float(value)
    except ValueError:
        raise ValueError(f"{option}: expected KEY=NUMBER, got {text!r}") from None


@app.command()
def fly(
    path: DatabaseArgument,
    n: Annotated[int, typer.Option("-n", "--flights", min=1, help="Flights per mode.")] = 1000,
    modes: Annotated[
        str, typer.Option(help="Comma-separated: nominal, mpi, ampi, quadratic.")
    ] = "nominal,mpi,ampi,quadratic",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the campaign.")] = 2016,
    distribution: Annotated[str, typer.Option(help="normal, uniform or corners.")] = "normal",
    holes: HolesOption = "refuse",
    output: Annotated[Path | None, typer.Option(help="Keep the flights (.npz) for report.")] = None,
    table: Annotated[
        Path | None, typer.Option("--csv", help="Write a row for each flight as CSV.")
    ] = None,
    cycle: Annotated[
        float | None, typer.Option(help="Guidance cycle (s); 0.5 if not given.")
    ] = None,
    jobs: Jobs = CORES,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fly closed-loop entries, the same draws in every mode, and give the verdict."""
    from ampi.dataset import read_dataset
    from ampi.loading import load_guidance
    from ampi.onboard.reference import Mode
    from ampi.report.text import verdict_text
    from ampi.simulation.dispersions import Dispersions, Distribution
    from ampi.simulation.flights_csv import write_flights_csv
    from ampi.simulation.monte_carlo import fly_modes, save_campaigns
    from ampi.simulation.statistics import judge, ratio_to_nominal

    with _told():
        check_output(output, force=force, others=[path])
        check_output(table, force=force, others=[path, output])
        mission = read_dataset(path).mission
        guidance = load_guidance(path, holes=_holes(holes))
        names = dict.fromkeys(name.strip() for name in modes.split(","))
        chosen = [_choice(Mode, name, "--modes") for name in names]
        law = _choice(Distribution, distribution, "--distribution")
        dispersions = Dispersions.from_mission(mission, law)
        with progress("flying", n * len(chosen)) as advance:
            flown = fly_modes(
                mission,
                guidance,
                chosen,
                dispersions,
                n,
                seed=seed,
                n_jobs=jobs,
                cycle=cycle,
                advance=advance,
            )
        campaigns = {mode.value: flights for mode, flights in flown.items()}
        if output is not None:
            save_campaigns(output, campaigns)
        if table is not None:
            write_flights_csv(table, mission, campaigns)
    if as_json:
        verdicts = {name: judge(flights).as_dict() for name, flights in campaigns.items()}
        for name, flights in campaigns.items():
            ratio = ratio_to_nominal(flights, campaigns)
            verdicts[name]["drawn"] = flights.dispersions.in_words(mission)
            verdicts[name]["footprint_ratio"] = None if ratio is None else asdict(ratio)
        _print_json(verdicts)
    else:
        sys.stdout.write(verdict_text(mission, campaigns) + "\n")


@app.command()
def report(
    path: DatabaseArgument,
    campaigns: Annotated[Path, typer.Argument(help="Flights kept by 'ampi fly --output'.")],
    output: Annotated[Path, typer.Option(help="HTML file to write.")] = Path("report.html"),
    force: Force = False,
) -> None:
    """Write the verdict and all figures as one HTML file."""
    from ampi.dataset import read_dataset
    from ampi.loading import guidance_table
    from ampi.missions.mission import mission_digest
    from ampi.simulation.monte_carlo import load_campaigns
    from database.audit.branches import branch_doubt, stations, suspects
    from database.plan.grid import Grid

    with _told():
        check_output(output, force=force, made_by="ampi report", others=[path, campaigns])
        _check_drawing(output)
        from ampi.report.html import write_report

        dataset = read_dataset(path)
        loaded = load_campaigns(campaigns)
        for flights in loaded.values():
            if flights.mission_sha256 != mission_digest(dataset.mission):
                raise ValueError(
                    f"{campaigns}: flown from a database of another mission ({flights.mission}) than "
                    f"{path} ({dataset.mission.name}); fly this database again"
                )
        grid = Grid.from_mission(dataset.mission)
        bank = np.where(dataset.solved[..., None], stations(dataset.states), np.nan)
        doubtful = suspects(grid, bank)
        notices = [branch_doubt(doubtful, path)] if doubtful else []
        attributes = dataset.attributes
        extra = {"Written": _now(), "Database file": path.name, "Flights file": campaigns.name}
        for label, key in (
            ("ampi", "ampi_version"),
            ("Git revision", "git_revision"),
            ("Content SHA-256", "content_sha256"),
            ("numpy", "numpy_version"),
            ("clarabel", "clarabel_version"),
        ):
            extra[label] = str(attributes[key])
        with progress("drawing", 1) as advance:
            table = guidance_table(dataset, holes="fly")
            write_report(
                output, dataset.mission, table, loaded, extra, notices, _audit_lines(dataset, path)
            )
            advance(1)
    out.print(f"{_escaped(output)}: {output.stat().st_size / 1e6:.1f} MB")


def _now() -> str:
    """The date; SOURCE_DATE_EPOCH where a page is to be the same again (reproducible-builds.org)."""
    seconds = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = int(seconds) if seconds.isdigit() else None
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now))


def _audit_lines(dataset: TrajectoryDataset, path: Path) -> dict[str, str]:
    """What the file knows of itself, and what follows from it without another solve."""
    from ampi.missions.path_limits import PathLimits
    from database.audit.coherence import ROWS, THRESHOLD, coherence
    from database.audit.error_map import error_map

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
    smooth = coherence(dataset)
    lines["Coherence"] = "unknown: no axis has three points in a row with a solution"
    if smooth.triples:
        row = int(np.nanargmax(smooth.worst))
        lines["Coherence"] = (
            f"{smooth.triples} second differences, the roughest {smooth.worst[row]:.1f} times the "
            f"family's scale ({ROWS[row].replace('_', ' ')}); {len(smooth.outliers)} cases stand out "
            f"above {THRESHOLD:g}"
        )
    lines["Interpolation error, 90 % in the worst cell"] = (
        "unknown: an axis of two points leaves none out"
    )
    if all(len(axis) > 2 for axis in dataset.axes):
        cells = error_map(dataset, n_jobs=1)
        worst = {key: max(cell.errors[key] for cell in cells) for key in cells[0].errors}
        lines["Interpolation error, 90 % in the worst cell"] = ", ".join(
            f"{_known(value)} {unit}"
            for value, unit in zip(
                worst.values(), ("m", "m/s", "deg of bank", "s of final time"), strict=True
            )
        )
    lines["In full"] = f"ampi audit {shlex.quote(str(path))}"
    return lines


@app.command()
def reproduce(
    papers: Annotated[
        list[str] | None, typer.Argument(help="zhou2021, liu2015, wang2020, liu2024; default all.")
    ] = None,
    output: Annotated[Path | None, typer.Option(help="Folder for one figure a paper.")] = None,
    skip_slow: Annotated[
        bool, typer.Option("--skip-slow", help="Stop the global PSCP after two iterations.")
    ] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Print the tables of the optimiser papers: paper, ours by the same method, ours by our method."""
    from ampi.papers.reproduction import PAPERS

    chosen = papers or list(PAPERS)
    with _told():
        for name in chosen:
            if name not in PAPERS:
                raise ValueError(f"paper: expected one of {', '.join(PAPERS)}, got {name!r}")
        figures = [f"{name}.png" for name in chosen]
        check_figures(output, figures, force=force, made_by="ampi reproduce")
        _check_drawing(output)
        if output is not None:
            output.mkdir(parents=True, exist_ok=True)
        found = {}
        with progress("papers", len(chosen)) as advance:
            for name in chosen:
                found[name] = PAPERS[name](skip_slow)
                advance(1)
                if output is not None:
                    _draw_reproduction(found[name], output)
    if as_json:
        _print_json({name: result.as_dict() for name, result in found.items()})
        return
    for result in found.values():
        table = Table("", "paper", "ours, same method", "ours, our method", "must hold", "")
        table.title = result.title
        for row in result.rows:
            verdict = "" if row.holds is None else "yes" if row.holds else Text("no", "bold red")
            cells = (row.quantity, row.paper, row.same_method, row.our_method, row.must_hold)
            table.add_row(*cells, verdict)
        out.print(table)
        for row in result.rows:
            if row.note:
                out.print(f"  {_escaped(row.quantity)}: {_escaped(row.note)}")


def _draw_reproduction(found: Reproduction, folder: Path) -> None:
    from ampi.papers.figures import FIGURES as PAPER_FIGURES
    from ampi.report.figures.look import save_figure

    save_figure(folder / f"{found.paper}.png", PAPER_FIGURES[found.paper](found), "ampi reproduce")


def main() -> None:
    """Entry point. What cannot be shown on standard output changes no result."""
    sys.stdout, sys.stderr = map(standard_stream, (sys.stdout, sys.stderr))
    out.file, error_out.file = sys.stdout, sys.stderr  # their encoding decides on a table's lines
    for number in STOPPING:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup wants it
            signal.signal(number, _stop)
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except OSError as error:
        discard(sys.stdout)
        if isinstance(error, BrokenPipeError):  # the reader has seen enough
            sys.exit(1)
        _print_error(f"standard output: {error.strerror}")
        sys.exit(2)


if __name__ == "__main__":
    main()
