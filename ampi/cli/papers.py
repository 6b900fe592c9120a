"""`ampi reproduce`: the tables of the optimiser papers beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table
from rich.text import Text

from ampi.cli.console import escaped, out, print_json
from ampi.cli.endings import refusals
from ampi.cli.options import Force, Json, one_of
from ampi.cli.output_files import check_figures
from ampi.cli.progress import progress

if TYPE_CHECKING:
    from ampi.papers.table import Reproduction


def reproduce(
    papers: Annotated[
        list[str] | None,
        typer.Argument(help="zhou2021, liu2015, wang2020, liu2024, betts2010; default all."),
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

    with refusals():
        chosen = [one_of(PAPERS, name, "paper") for name in papers or PAPERS]
        figures = [f"{name}.png" for name in chosen]
        check_figures(output, figures, force=force, made_by="ampi reproduce")
        if output is not None:
            output.mkdir(parents=True, exist_ok=True)
        found = {}
        with progress("papers", len(chosen)) as advance:
            for name in chosen:
                found[name] = PAPERS[name](skip_slow)
                advance(1)
                if output is not None:
                    _draw(found[name], output)
    if as_json:
        print_json({name: result.as_dict() for name, result in found.items()})
    else:
        for result in found.values():
            _print(result)


def _draw(found: Reproduction, folder: Path) -> None:
    from ampi.papers.figures import FIGURES
    from ampi.report.figures.style import save_figure

    save_figure(folder / f"{found.paper}.png", FIGURES[found.paper](found), "ampi reproduce")


def _print(found: Reproduction) -> None:
    table = Table("", "paper", "ours, same method", "ours, our method", "must hold", "")
    table.title = found.title
    for row in found.rows:
        verdict = "" if row.holds is None else "yes" if row.holds else Text("no", "bold red")
        cells = (row.quantity, row.paper, row.same_method, row.our_method, row.must_hold)
        table.add_row(*cells, verdict)
    out.print(table)
    for row in found.rows:
        if row.note:
            out.print(f"  {escaped(row.quantity)}: {escaped(row.note)}")
