"""`ampi fly`: closed-loop flights in worlds that differ from the model, and their verdict."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ampi.cli.case import CaseFiles, fly_case
from ampi.cli.cluster import cluster
from ampi.cli.console import error_out, print_json
from ampi.cli.endings import refusals
from ampi.cli.options import (
    CorrectionOption,
    DatabaseArgument,
    EngineOption,
    Force,
    HolesOption,
    Jobs,
    Json,
    LawOption,
    ModesOption,
    ModulateOption,
    PoolOption,
    SeedOption,
    WorldOption,
    one_of,
)
from ampi.cli.output_files import check_output
from ampi.cli.progress import progress

if TYPE_CHECKING:
    from ampi.dataset import TrajectoryDataset
    from ampi.missions.mission import Mission
    from ampi.simulation.flights import Flights
    from ampi.simulation.monte_carlo import CampaignOptions, Scheme

KILO, PERCENT = 1e3, 100.0
Stop = Annotated[
    float | None,
    typer.Option(
        help="Stop when the share within --stop-radius-km is known to so many per cent, "
        "of every scheme: the width of its 95 % interval."
    ),
]


def fly(
    path: DatabaseArgument,
    n: Annotated[int, typer.Option("-n", "--flights", min=1, help="Flights per scheme.")] = 1000,
    world: WorldOption = "entry",
    law: LawOption = "linear_quadratic",
    modes: ModesOption = "nominal,mpi,ampi,quadratic",
    modulate: ModulateOption = False,
    correction: CorrectionOption = "none",
    seed: SeedOption = 2016,
    pool: PoolOption = "reported",
    holes: HolesOption = "refuse",
    output: Annotated[
        Path | None, typer.Option(help="Stream the flights to this HDF5 file; run again to resume.")
    ] = None,
    table: Annotated[
        Path | None, typer.Option("--csv", help="Write a row for each flight as CSV.")
    ] = None,
    cycle: Annotated[float, typer.Option(help="Guidance cycle (s).")] = 0.1,
    engine: EngineOption = "auto",
    stop_percent: Stop = None,
    stop_radius_km: Annotated[float, typer.Option(help="For --stop-percent.")] = 5.0,
    case: Annotated[
        int | None, typer.Option(min=0, help="Fly this one again: print it cycle by cycle.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Of --case: draw it (PNG, PDF, SVG).")] = None,
    corrections: Annotated[
        Path | None, typer.Option(help="Of --case: write a row for each correction as CSV.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a dask.distributed scheduler to fly on.")
    ] = None,
    *,
    jobs: Jobs,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fly closed-loop entries, the same draws by every scheme, and give the verdict.

    A scheme is a world, a tracking law, a reference and what corrects the plan that it begins with;
    several of each may be given, by commas. With --case one flight of the campaign is flown again, bit
    for bit, and told cycle by cycle.
    """
    options: CampaignOptions = {"seed": seed, "pool": pool, "cycle": cycle, "engine": engine}
    stop = None if stop_percent is None else (stop_radius_km * KILO, stop_percent / PERCENT)
    with refusals():
        dataset = _read(path)
        schemes = schemes_of(dataset, world, law, modes, holes, correction, modulate=modulate)
        if case is not None:
            files = CaseFiles(
                recorded=output, table=table, plot=plot, corrections=corrections, force=force
            )
            fly_case(dataset.mission, schemes, case, options, files, as_json=as_json)
            return
        _check(path, output, table, force=force)
        _check_of_case(plot, corrections)
        with cluster(scheduler) as client:
            options |= {"output": output, "resume": not force, "n_jobs": jobs, "client": client}
            campaigns = _flown(dataset.mission, schemes, n, stop, options)
        _write(table, dataset.mission, campaigns)
    _tell(dataset.mission, campaigns, as_json=as_json)


def _flown(
    mission: Mission,
    schemes: Mapping[str, Scheme],
    n: int,
    stop: tuple[float, float] | None,
    options: CampaignOptions,
) -> Mapping[str, Flights]:
    from ampi.simulation.estimates.stopping import StopRule
    from ampi.simulation.monte_carlo import fly_schemes

    _say_if_numpy(options["engine"])
    if stop is not None:
        options["stop"] = StopRule(*stop)
    with progress("flying", n * len(schemes)) as advance:
        options["advance"] = advance
        return fly_schemes(mission, schemes, n, **options)


def _say_if_numpy(engine: str) -> None:
    from ampi._native.engine import WHY_NOT, is_available

    if engine == "auto" and not is_available():
        error_out.print(f"warning: flown in numpy, some thirty times slower: {WHY_NOT}")


def _write(table: Path | None, mission: Mission, campaigns: Mapping[str, Flights]) -> None:
    if table is not None:
        from ampi.simulation.flights_csv import write_flights_csv

        write_flights_csv(table, mission, campaigns)


def _read(path: Path) -> TrajectoryDataset:
    from ampi.dataset import read_dataset

    return read_dataset(path)


def _check(path: Path, output: Path | None, table: Path | None, *, force: bool) -> None:
    check_output(output, force=force, made_by="ampi flights", others=[path])
    check_output(table, force=force, others=[path, output])


def _check_of_case(plot: Path | None, corrections: Path | None) -> None:
    if plot is not None:
        raise ValueError("--plot: expected --case with it; 'ampi report' draws a campaign")
    if corrections is not None:
        raise ValueError("--corrections: expected --case with it; they are those of one flight")


def schemes_of(
    dataset: TrajectoryDataset,
    world: str,
    law: str,
    modes: str,
    holes: str,
    correction: str = "none",
    *,
    modulate: bool = False,
) -> dict[str, Scheme]:
    """Every world × law × reference × correction, named by what they differ in."""
    from ampi.loading import CORRECTIONS, HOLES, LAWS, guidance_of
    from ampi.onboard.reference import Mode
    from ampi.simulation.monte_carlo import Scheme
    from ampi.simulation.world_loading import load_world

    asked = one_of(HOLES, holes, "--holes")
    laws = [one_of(LAWS, name, "--law") for name in _names(law)]
    chosen = [one_of([m.value for m in Mode], name, "--modes") for name in _names(modes)]
    corrections = [one_of(CORRECTIONS, name, "--correction") for name in _names(correction)]
    worlds = {loaded.name: loaded for loaded in map(load_world, _names(world))}
    guides = {
        (own, how): guidance_of(dataset, law=own, modulate=modulate, holes=asked, correction=how)
        for own in laws
        for how in corrections
    }
    found = {}
    for place, loaded in worlds.items():
        loaded.checked(dataset.mission)
        for (own, how), guide in guides.items():
            for mode in chosen:
                parts = [place] * (len(worlds) > 1) + [own] * (len(laws) > 1) + [mode]
                parts += [how] * (len(corrections) > 1)
                found[" ".join(parts)] = Scheme(guide.in_mode(mode), loaded)
    return found


def _names(text: str) -> list[str]:
    return list(dict.fromkeys(name.strip() for name in text.split(",")))


def _tell(mission: Mission, campaigns: Mapping[str, Flights], *, as_json: bool) -> None:
    if as_json:
        from ampi.report.schemes_table import schemes_as_dict

        print_json(schemes_as_dict(mission, campaigns))
    else:
        from ampi.report.text import verdict_text

        sys.stdout.write(verdict_text(mission, campaigns) + "\n")
