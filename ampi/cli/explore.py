"""`ampi explore`: a database, its flights and wrong models in one page, moved by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ampi.cli.console import escaped, out
from ampi.cli.endings import refusals
from ampi.cli.options import DatabaseArgument, Force
from ampi.cli.output_files import check_output


def explore(
    path: DatabaseArgument,
    campaigns: Annotated[
        Path | None, typer.Argument(help="Flights kept by 'ampi fly --output', to be shown.")
    ] = None,
    output: Annotated[Path, typer.Option(help="HTML file to write.")] = Path("explore.html"),
    force: Force = False,
) -> None:
    """Write one HTML file in which references and flights follow sliders; it needs no network."""
    with refusals():
        check_output(output, force=force, made_by="ampi explore", others=[path, campaigns])
        from ampi.dataset import read_dataset
        from ampi.explorer.explorer import explore as page_of
        from ampi.simulation.flights_file import load_campaigns

        dataset = read_dataset(path)
        page = page_of(dataset, None if campaigns is None else load_campaigns(campaigns))
        output.write_text(page, encoding="utf-8")
    out.print(f"{escaped(output)}: {output.stat().st_size / 1e6:.2f} MB")
