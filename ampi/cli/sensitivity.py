"""`ampi sensitivity`: what the miss comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ampi.cli.console import out, print_json
from ampi.cli.endings import refusals
from ampi.cli.options import (
    ONE_MODE,
    DatabaseArgument,
    HolesOption,
    Jobs,
    Json,
    LawOption,
    SeedOption,
)
from ampi.cli.progress import progress

if TYPE_CHECKING:
    from ampi.simulation.estimates.sensitivity import SobolIndices

PERCENT = 100.0


def sensitivity(
    path: DatabaseArgument,
    world: Annotated[str, typer.Option(help="A shipped world, or a .toml file.")] = "everything",
    law: LawOption = "linear_quadratic",
    mode: Annotated[str, typer.Option(help=ONE_MODE)] = "ampi",
    n: Annotated[int, typer.Option("-n", help="Rows of the design, a power of 2.")] = 64,
    seed: SeedOption = 2016,
    cycle: Annotated[float, typer.Option(help="Guidance cycle (s).")] = 0.1,
    holes: HolesOption = "refuse",
    *,
    jobs: Jobs,
    as_json: Json = False,
) -> None:
    """Sobol indices of the miss over all that a world draws, with 95 % intervals.

    Shares of the variance of ln miss: by an input alone, and with all its interactions. It flies
    n (m + 2) entries for m inputs.
    """
    from ampi.cli.fly import schemes_of
    from ampi.dataset import read_dataset
    from ampi.simulation.sobol_flights import flights_of_design, fly_sobol

    with refusals():
        dataset = read_dataset(path)
        schemes = schemes_of(dataset, world, law, mode, holes)
        if len(schemes) > 1:
            raise ValueError(f"expected one world, law and mode, got {', '.join(schemes)}")
        (scheme,) = schemes.values()
        flights = flights_of_design(dataset.mission, scheme, n)
        with progress("flying", flights) as advance:
            found = fly_sobol(
                dataset.mission,
                scheme,
                n,
                seed=seed,
                cycle=cycle,
                n_jobs=jobs,
                advance=advance,
            )
    _tell(flights, found, as_json=as_json)


def _tell(flights: int, found: SobolIndices, *, as_json: bool) -> None:
    if as_json:
        print_json(
            {
                "flights": flights,
                "lost": found.lost,
                "first": {name: vars(e) for name, e in found.first.items()},
                "total": {name: vars(e) for name, e in found.total.items()},
            }
        )
        return
    table = Table(
        title=f"{flights} flights, {found.lost} lost; per cent of the variance of ln miss"
    )
    for head in ("input", "alone", "95 %", "with interactions", "95 %"):
        table.add_column(head, justify="left" if head == "input" else "right")
    for name in sorted(found.total, key=lambda name: -found.total[name].value):
        cells = [name]
        for one in (found.first[name], found.total[name]):
            cells += [
                f"{PERCENT * one.value:.0f}",
                f"{PERCENT * one.low:.0f} to {PERCENT * one.high:.0f}",
            ]
        table.add_row(*cells)
    out.print(table)
