"""`ampi solve`: one optimal control problem."""

from __future__ import annotations

import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from ampi.cli.console import escaped, known, out, print_error, print_json, print_summary
from ampi.cli.endings import refusals
from ampi.cli.node_table import HEADER, write_nodes
from ampi.cli.options import Force, Json, MissionArgument
from ampi.cli.output_files import check_figure, check_output

if TYPE_CHECKING:
    from ampi.missions.mission import Mission
    from ampi.scp.guesses import GuessResult
    from ampi.trajectory import GuessTried, Trajectory

DEFAULT_METHOD = "exact_hessian"


def solve(
    mission: MissionArgument,
    method: Annotated[str, typer.Option(help="exact_hessian, zhou2021, …")] = DEFAULT_METHOD,
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
    from ampi.missions.loading import load_mission

    with refusals():
        check_output(table, force=force, made_by=HEADER, others=[mission, plot])
        check_figure(plot, force=force, made_by="ampi solve", others=[mission])
        loaded = load_mission(mission)
        if each_guess:
            _refuse_with_guesses(method, bank_angle, refined, table, plot)
            _solve_from_each_guess(loaded, as_json)
            return
        optimum = _solve(loaded, method, bank_angle, refined)
        if math.isfinite(optimum.final_time):
            if table is not None:
                write_nodes(table, optimum)
            draw_trajectory(plot, loaded, optimum, "ampi solve")
    if as_json:
        print_json(_as_dict(loaded, optimum, refined))
    else:
        _print_optimum(loaded, optimum, refined)
    if not optimum.status.ok:
        _refuse(loaded, optimum)


def _solve(mission: Mission, method: str, bank_angle: float | None, refined: bool) -> Trajectory:
    from ampi.scp.guess import ConstantBank
    from ampi.scp.refinement import RefinementSettings
    from ampi.scp.solve import solve as solve_mission

    guess = None if bank_angle is None else ConstantBank(math.radians(bank_angle))
    refinement = RefinementSettings() if refined else None
    return solve_mission(mission, method=method, guess=guess, refinement=refinement)


def _as_dict(mission: Mission, optimum: Trajectory, refined: bool) -> dict[str, Any]:
    from ampi.missions.sections import MeshSection
    from ampi.scp.problem.shortfall import outcome_sentence

    statistics = optimum.statistics
    return {
        **optimum.summary(),
        "verdict": outcome_sentence(mission, optimum),
        "log": [asdict(row) for row in statistics.log],
        "rounds": [asdict(row) for row in statistics.rounds],
        "guesses": [_guess_row(one) for one in statistics.guesses],
        **({"mesh_toml": MeshSection.of(optimum.mesh).toml} if refined else {}),
    }


def _guess_row(one: GuessTried) -> dict[str, Any]:
    return {
        "bank_angle_deg": math.degrees(one.bank_angle),
        "status": one.status.name,
        "iterations": one.iterations,
        "cost": one.cost,
        "chosen": one.chosen,
    }


def _print_optimum(mission: Mission, optimum: Trajectory, refined: bool) -> None:
    from ampi.missions.sections import MeshSection
    from ampi.scp.problem.shortfall import outcome_sentence

    out.print(convergence_table(optimum))
    for one in optimum.statistics.guesses:
        out.print(
            f"  from a constant bank angle of {math.degrees(one.bank_angle):.4g}°: {one.status} after "
            f"{one.iterations} iterations{', shown above' if one.chosen else ''}"
        )
    if refined:
        out.print("the mesh, to paste into the mission in the place of its own:")
        sys.stdout.write(MeshSection.of(optimum.mesh).toml)
    if optimum.status.ok:  # else it is the error
        out.print(outcome_sentence(mission, optimum))
    print_summary(optimum.summary())


def _refuse(mission: Mission, optimum: Trajectory) -> None:
    """No solution: why, what to try, and the exit status that says so."""
    from ampi.scp.problem.shortfall import outcome_sentence
    from ampi.trajectory import Status

    says_how = optimum.status in (Status.INACCURATE, Status.REFINEMENT_LIMIT)
    ways = "" if says_how else " Move the target, widen the limits, or try another --bank-angle"
    print_error(f"{escaped(mission.name)}: {escaped(outcome_sentence(mission, optimum))}{ways}")
    raise typer.Exit(2)


def _refuse_with_guesses(
    method: str, bank_angle: float | None, refined: bool, table: Path | None, plot: Path | None
) -> None:
    given = {"--method": method != DEFAULT_METHOD, "--bank-angle": bank_angle is not None}
    given |= {"--refine": refined, "--csv": table is not None, "--plot": plot is not None}
    if any(given.values()):
        asked = ", ".join(name for name, is_given in given.items() if is_given)
        raise ValueError(f"--guesses: starts from each guess and keeps none; leave out {asked}")


def _solve_from_each_guess(mission: Mission, as_json: bool) -> None:
    """What every guess leads to, and which of the answers are one branch."""
    from ampi.scp.guesses import from_each
    from ampi.scp.solve import solve as solve_mission

    results = from_each(mission, lambda guess: solve_mission(mission, guess=guess))
    rows = [_branch_row(one) for one in results]
    if as_json:
        print_json(rows)
    else:
        _print_branches(rows)
    if not any(one.trajectory.status.ok for one in results):
        raise typer.Exit(2)


def _branch_row(one: GuessResult) -> dict[str, Any]:
    return {
        "guess_bank_angle_deg": math.degrees(one.guess.bank_angle),
        "status": one.trajectory.status.name,
        "cost": one.trajectory.cost,
        "bank_at_entry_deg": math.degrees(one.trajectory.states[6, 0]),
        "final_time_s": one.trajectory.final_time,
        "iterations": one.trajectory.statistics.iterations,
        "branch": one.branch,
    }


def _print_branches(rows: list[dict[str, Any]]) -> None:
    shown = Table("guess (deg)", "status", "cost", "bank at entry (deg)", "t_f (s)", "branch")
    for row in rows:
        shown.add_row(
            f"{row['guess_bank_angle_deg']:.4g}",
            row["status"],
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


def convergence_table(optimum: Trajectory) -> Table:
    """A row for each iteration of a solve."""
    table = Table(
        "iteration", "cost", "step (deg)", "t_f (s)", "radius (deg)", "ratio", "step kept"
    )
    for row in optimum.statistics.log:
        table.add_row(
            str(row.iteration),
            f"{row.cost:.6g}",
            f"{math.degrees(row.step):.2e}",
            f"{row.final_time:.2f}",
            known(math.degrees(row.trust_radius)),
            known(row.ratio, ".3f"),
            "yes" if row.accepted else "no",
        )
    return table


def draw_trajectory(path: Path | None, mission: Mission, optimum: Trajectory, made_by: str) -> None:
    """Save the trajectory's figure, if one is wanted."""
    if path is None:
        return
    from ampi.report.figures.single import trajectory_figure
    from ampi.report.figures.style import save_figure

    save_figure(path, trajectory_figure(mission, optimum), made_by)
