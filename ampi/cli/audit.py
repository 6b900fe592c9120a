"""`ampi audit`: is a database true, is it smooth, and where would a point pay?"""

from __future__ import annotations

import math
import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ampi.cli.console import escaped, known, out, print_json
from ampi.cli.endings import refusals
from ampi.cli.options import DatabaseArgument, Force, Jobs, Json
from ampi.cli.output_files import check_figures
from ampi.cli.progress import progress

if TYPE_CHECKING:
    from database.audit.audit import AuditReport
    from database.audit.error_map import CellError

FIGURES = ("coherence.png", "error_map.png")
MOST_CASES = 12  # numbers of cases in a printed line; --json has them all


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
    *,
    jobs: Jobs,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Is the database true, is it smooth, what does interpolating it cost, where would a point pay?"""
    from ampi.dataset import read_dataset
    from database.audit.audit import audit as audit_dataset
    from database.repair import repair

    with refusals():
        check_figures(figures, FIGURES, force=force, made_by="ampi audit")
        repairs = repair(path, n_jobs=jobs) if mend else ()
        dataset = read_dataset(path)
        with progress("auditing", int(dataset.solved.sum()) + probes) as advance:
            report = audit_dataset(dataset, probes=probes, seed=seed, n_jobs=jobs, advance=advance)
        if figures is not None:
            _draw(report, figures)
    if as_json:
        print_json({**report.as_dict(), "repairs": [asdict(one) for one in repairs]})
        return
    for one in repairs:
        out.print(escaped(one))
    _print_truth(report, path)
    _print_interpolation(report)
    _print_coherence(report, path)
    _print_branches(report, path)
    _print_error_map(report)


def _print_truth(report: AuditReport, path: Path) -> None:
    statuses = ", ".join(
        f"{n} {name.lower().replace('_', ' ')}" for name, n in report.statuses.items()
    )
    out.print(f"{escaped(path)}: {report.cases} cases: {statuses}")
    table = Table("against re-integration (DOP853)", "median", "90 %", "worst")
    for label, error in (
        ("position (m)", report.position_error),
        ("altitude (m)", report.altitude_error),
        ("speed (m/s)", report.speed_error),
    ):
        numbers = (error.median, error.percentile_90, error.worst)
        table.add_row(label, *(f"{number:.3g}" for number in numbers))
    out.print(table)
    for name, value in report.limits.items():
        out.print(
            f"  greatest {name.replace('_', ' ')} between the nodes: {100 * value:.1f} % of its limit"
        )


def _print_interpolation(report: AuditReport) -> None:
    measured = report.probes - report.hidden_probes - report.unsolved_probes
    if measured:
        table = Table(
            f"interpolation, 90 % of {measured} points",
            "altitude (m)",
            "speed (m/s)",
            "bank (deg)",
            "t_f (s)",
            "open-loop miss (km)",
        )
        for mode, columns in report.interpolation.items():
            table.add_row(mode, *(known(error.percentile_90) for error in columns.values()))
        out.print(table)
    if report.hidden_probes:
        out.print(
            f"{report.hidden_probes} of {report.probes} probes lie in cells with a case that has no "
            "solution: nothing is interpolated there"
        )
    if report.unsolved_probes:
        out.print(f"{report.unsolved_probes} of {report.probes} probes could not be solved")


def _print_coherence(report: AuditReport, path: Path) -> None:
    import numpy as np

    from database.audit.coherence import THRESHOLD

    smooth = report.coherence
    if not smooth.triples:
        out.print("coherence: unknown, no axis has three points in a row with a solution")
        return
    row = int(np.nanargmax(smooth.worst))
    worst = smooth.rows[row].replace("_", " ")
    hidden = int(np.isnan(smooth.roughness).sum()) - report.cases + report.statuses.get("SOLVED", 0)
    out.print(
        f"coherence: {smooth.triples} second differences, the roughest {smooth.worst[row]:.1f} times "
        f"the family's scale ({worst}); a case stands out above {THRESHOLD:g}"
        + (f"; unknown for {hidden} cases that are in none" if hidden else "")
    )
    for outlier in smooth.outliers:
        limit = "" if outlier.limit is None else outlier.limit.replace("_", " ")
        acts = f"; the {limit} reaches its limit there and in no case beside it" if limit else ""
        out.print(
            f"  case {outlier.case} at grid index {outlier.index}: "
            f"roughness {outlier.roughness:.1f}{acts}"
        )
    if smooth.outliers:
        out.print(
            "  on another branch, or where a limit begins to act; re-solve them from their neighbours "
            f"with: ampi audit {_quoted(path)} --repair"
        )


def _print_branches(report: AuditReport, path: Path) -> None:
    from database.audit.branches import SETTINGS

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
    if not found.astray and found.worst_flown > SETTINGS.flown:
        out.print(
            f"  one branch, but above {SETTINGS.flown / 1e3:g} km too wide a step for interpolation; "
            f"add a point with: ampi refine {_quoted(path)}"
        )
    if found.astray:
        out.print(
            "  nothing interpolates between two branches, and no new point pays there; bring all cases "
            f"onto one with: ampi audit {_quoted(path)} --repair"
        )


def _print_error_map(report: AuditReport) -> None:
    best = _best_cell(report)
    out.print(
        "interpolation error in each cell, 90 %, and what one more point there would take away:"
    )
    heads = ("m", "m/s", "deg", "s", "gain", "solves")
    out.print(f"  {'':34}" + "".join(f"{head:>9}" for head in heads))
    for cell in report.error_map:
        mark = ", probed" if cell.source == "probes" else ""
        mark += " ← pays most" if cell is best else ""
        errors = "".join(f" {known(error):>8}" for error in cell.errors.values())
        gain = f"{100 * cell.gain:.1f} %" if math.isfinite(cell.gain) else known(cell.gain)
        name = f"{cell.key} {cell.low:g} … {cell.high:g}"
        out.print(f"  {name:34}{errors} {gain:>8}{cell.new_cases:8}{mark}")


def _best_cell(report: AuditReport) -> CellError | None:
    """Where a point pays most; None if failed cases hide every cell."""
    from database.audit.error_map import best_cell

    visible = any(math.isfinite(cell.gain) for cell in report.error_map)
    return best_cell(report.error_map) if visible else None


def _degrees(span: tuple[float, float]) -> str:
    low, high = map(math.degrees, span)
    return f"{low:.1f} … {high:.1f} deg" if high - low > 0.05 else f"{low:.1f} deg"


def _quoted(path: Path) -> str:
    return escaped(shlex.quote(str(path)))


def _draw(report: AuditReport, folder: Path) -> None:
    from ampi.report.figures.audit import CellBar, coherence_figure, error_map_figure
    from ampi.report.figures.style import save_figure
    from database.audit.coherence import THRESHOLD

    best = _best_cell(report)
    bars = [
        CellBar(cell.parameter, f"{cell.low:g} … {cell.high:g}", cell.errors, cell is best)
        for cell in report.error_map
    ]
    outliers = {outlier.case for outlier in report.coherence.outliers}
    named = {case: f"case {case}" for case in sorted(outliers | set(report.branches.cases))}
    smooth = coherence_figure(report.coherence.roughness.ravel(), THRESHOLD, named)
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in zip(FIGURES, (smooth, error_map_figure(bars)), strict=True):
        save_figure(folder / name, figure, "ampi audit")
