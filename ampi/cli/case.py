"""`ampi fly --case N`: one flight of a campaign again, bit for bit, cycle by cycle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ampi.cli.console import out, print_json
from ampi.cli.output_files import check_figure, check_output

if TYPE_CHECKING:
    from ampi.missions.mission import Mission
    from ampi.simulation.closed_loop import Observer
    from ampi.simulation.correction_log import CorrectionLog
    from ampi.simulation.flights import Flights
    from ampi.simulation.monte_carlo import CampaignOptions, Scheme

KILO = 1e3
MADE_BY = "ampi fly"


@dataclass(frozen=True, kw_only=True)
class CaseFiles:
    """What is read and written of one flight."""

    recorded: Path | None  # the file of its campaign; None: it is drawn again
    table: Path | None
    plot: Path | None
    corrections: Path | None
    force: bool


def fly_case(
    mission: Mission,
    schemes: Mapping[str, Scheme],
    case: int,
    options: CampaignOptions,
    files: CaseFiles,
    *,
    as_json: bool,
) -> None:
    """Fly it by every scheme and tell of it.

    Raises
    ------
    ValueError
        If the file has no such flight, or was flown by other schemes; or a file cannot be written.
    """

    from ampi.simulation.correction_log import CorrectionNotes, write_correction_log
    from ampi.simulation.flight_log import write_log

    _check(schemes, files)
    notes = None if files.corrections is None else CorrectionNotes()
    flown = _flown(mission, schemes, case, options, files.recorded, notes)
    log = None if notes is None else notes.log(mission, next(iter(flown.values())))
    if files.table is not None:
        write_log(files.table, flown)
    if files.corrections is not None and log is not None:
        write_correction_log(files.corrections, log)
    if files.plot is not None:
        _draw(files.plot, mission, flown, case, log)
    _tell(flown, case, as_json=as_json, recorded=files.recorded is not None)


def _check(schemes: Mapping[str, Scheme], files: CaseFiles) -> None:
    """Refuse, before it is flown, what cannot be written or told."""
    from ampi.simulation.correction_log import require_corrected

    force, others = files.force, [files.recorded]
    check_output(files.table, force=force, made_by="time_s,", others=others)
    check_output(
        files.corrections, force=force, made_by="time_s,outcome,", others=[*others, files.table]
    )
    check_figure(
        files.plot, force=force, made_by=MADE_BY, others=[*others, files.table, files.corrections]
    )
    for option, path in (("--plot", files.plot), ("--corrections", files.corrections)):
        if path is not None and len(schemes) > 1:
            raise ValueError(
                f"{option}: expected one world, law, mode and correction, got {', '.join(schemes)}"
            )
    if files.corrections is not None:
        require_corrected(next(iter(schemes.values())).guidance)


def _draw(
    path: Path,
    mission: Mission,
    flown: Mapping[str, Flights],
    case: int,
    log: CorrectionLog | None,
) -> None:
    """The flight, or the plans that it flew where its corrections are told of."""
    from ampi.report.figures.correction import corrections_figure
    from ampi.report.figures.single import flight_figure
    from ampi.report.figures.style import save_figure

    ((name, flights),) = flown.items()
    title = f"flight {case}, {name}"
    if log is None:
        figure = flight_figure(mission, flights, title)
    else:
        figure = corrections_figure(mission, log, title)
    save_figure(path, figure, MADE_BY)


def _flown(
    mission: Mission,
    schemes: Mapping[str, Scheme],
    case: int,
    options: CampaignOptions,
    recorded: Path | None,
    observer: Observer | None,
) -> dict[str, Flights]:
    from ampi.simulation.flights_file import load_campaigns
    from ampi.simulation.monte_carlo import fly_again, fly_one

    if recorded is None:
        return {
            name: fly_one(mission, one, case, observer=observer, **options)
            for name, one in schemes.items()
        }
    campaigns, flown = load_campaigns(recorded), {}
    for name, scheme in schemes.items():
        if name not in campaigns:
            raise ValueError(
                f"--case: expected a campaign called {name!r} in {recorded}, it has "
                f"{', '.join(map(repr, campaigns))}; name its world, law and modes"
            )
        flown[name] = fly_again(mission, scheme.guidance, case, campaigns[name], observer=observer)
        if flown[name].final_states.tobytes() != campaigns[name].final_states[case].tobytes():
            raise ValueError(
                f"--case: flight {case} of {name!r} ends elsewhere than in {recorded}: it was flown by "
                "other software or on another kind of processor"
            )
    return flown


def _tell(flown: Mapping[str, Flights], case: int, *, as_json: bool, recorded: bool) -> None:
    from ampi.simulation.estimates.failures import FailureClass
    from ampi.simulation.plant import FlightStatus
    from ampi.simulation.uncertainties import CATALOGUE

    told, shown = {}, None
    for name, flights in flown.items():
        numbers = zip(CATALOGUE, flights.numbers[0].tolist(), strict=True)
        told[name] = one = {
            "case": case,
            "status": FlightStatus(int(flights.status[0])).name,
            "failure": FailureClass(int(flights.failures[0])).name,
            "miss_m": float(flights.miss[0]),
            "along_m": float(flights.along[0]),
            "across_m": float(flights.across[0]),
            "altitude_error_m": float(flights.altitude_error[0]),
            "speed_error_m_per_s": float(flights.speed_error[0]),
            "final_time_s": float(flights.final_time[0]),
            "saturation": float(flights.saturation[0]),
            "parameters": flights.parameters[0].tolist(),
            "truth": {u.name: value for u, value in numbers if value != u.nominal},
        }
        if as_json:
            continue
        if one["truth"] != shown:
            shown = one["truth"]
            for uncertainty in (u for u in CATALOGUE if u.name in shown):
                unit = "" if uncertainty.dimension is None else f" {uncertainty.unit}"
                out.print(f"{uncertainty.name} {shown[uncertainty.name]:.6g}{unit}")
        out.print(
            f"flight {case}, {name}: {one['status']}, {one['failure']}; miss "
            f"{one['miss_m'] / KILO:.3f} km, altitude {one['altitude_error_m']:+.0f} m, "
            f"{one['final_time_s']:.2f} s{'; as recorded, to the bit' if recorded else ''}"
        )
    if as_json:
        print_json(told)
