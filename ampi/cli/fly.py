"""`ampi fly`: closed-loop flights and their verdict."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ampi.cli.console import print_json
from ampi.cli.endings import refusals
from ampi.cli.options import DatabaseArgument, Force, HolesOption, Jobs, Json, member, one_of
from ampi.cli.output_files import check_output
from ampi.cli.progress import progress

if TYPE_CHECKING:
    from ampi.missions.mission import Mission
    from ampi.simulation.flights import Flights


def fly(
    path: DatabaseArgument,
    n: Annotated[int, typer.Option("-n", "--flights", min=1, help="Flights per mode.")] = 1000,
    modes: Annotated[
        str, typer.Option(help="Comma-separated: nominal, mpi, ampi, quadratic.")
    ] = "nominal,mpi,ampi,quadratic",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the campaign.")] = 2016,
    distribution: Annotated[str, typer.Option(help="normal, uniform or corners.")] = "normal",
    holes: HolesOption = "refuse",
    output: Annotated[Path | None, typer.Option(help="Keep the flights (HDF5) for report.")] = None,
    table: Annotated[
        Path | None, typer.Option("--csv", help="Write a row for each flight as CSV.")
    ] = None,
    cycle: Annotated[
        float | None, typer.Option(help="Guidance cycle (s); 0.5 if not given.")
    ] = None,
    *,
    jobs: Jobs,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fly closed-loop entries, the same draws in every mode, and give the verdict."""
    from ampi.dataset import read_dataset
    from ampi.loading import HOLES, guidance_of
    from ampi.onboard.reference import Mode
    from ampi.simulation.dispersions import Dispersions, Distribution
    from ampi.simulation.monte_carlo import fly_modes

    with refusals():
        check_output(output, force=force, others=[path])
        check_output(table, force=force, others=[path, output])
        dataset = read_dataset(path)
        mission = dataset.mission
        guidance = guidance_of(dataset, holes=one_of(HOLES, holes, "--holes"))
        names = dict.fromkeys(name.strip() for name in modes.split(","))
        chosen = [member(Mode, name, "--modes") for name in names]
        law = member(Distribution, distribution, "--distribution")
        with progress("flying", n * len(chosen)) as advance:
            flown = fly_modes(
                mission,
                guidance,
                chosen,
                Dispersions.from_mission(mission, law),
                n,
                seed=seed,
                n_jobs=jobs,
                cycle=cycle,
                advance=advance,
            )
        campaigns = {mode.value: flights for mode, flights in flown.items()}
        _keep(mission, campaigns, output, table)
    if as_json:
        print_json(_as_dict(mission, campaigns))
    else:
        from ampi.report.text import verdict_text

        sys.stdout.write(verdict_text(mission, campaigns) + "\n")


def _keep(
    mission: Mission, campaigns: Mapping[str, Flights], output: Path | None, table: Path | None
) -> None:
    from ampi.simulation.flights_csv import write_flights_csv
    from ampi.simulation.flights_file import save_campaigns

    if output is not None:
        save_campaigns(output, campaigns)
    if table is not None:
        write_flights_csv(table, mission, campaigns)


def _as_dict(mission: Mission, campaigns: Mapping[str, Flights]) -> dict[str, Any]:
    from ampi.simulation.statistics import judge, ratio_to_nominal

    verdicts = {}
    for name, flights in campaigns.items():
        ratio = ratio_to_nominal(flights, campaigns)
        verdicts[name] = {
            **judge(flights).as_dict(),
            "drawn": flights.dispersions.in_words(mission),
            "footprint_ratio": None if ratio is None else asdict(ratio),
        }
    return verdicts
