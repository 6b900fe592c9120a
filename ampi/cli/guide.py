"""`ampi guide`: from measured parameters to the reference that flies."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ampi.cli.console import error_out, out, print_json
from ampi.cli.endings import refusals
from ampi.cli.node_table import HEADER, write_nodes
from ampi.cli.options import (
    ONE_MODE,
    DatabaseArgument,
    Force,
    HolesOption,
    Json,
    key_and_value,
    member,
    one_of,
)
from ampi.cli.output_files import check_figure, check_output

if TYPE_CHECKING:
    from ampi.guidance import Guidance
    from ampi.missions.mission import Mission
    from ampi.onboard.certificate import Certificate
    from ampi.onboard.reference import Reference


def _at_entry(unit: str) -> Any:
    return typer.Option(help=f"Measured at the entry interface ({unit}); nominal if not given.")


def guide(
    path: DatabaseArgument,
    altitude_km: Annotated[float | None, _at_entry("km")] = None,
    longitude_deg: Annotated[float | None, _at_entry("deg")] = None,
    latitude_deg: Annotated[float | None, _at_entry("deg")] = None,
    speed: Annotated[float | None, _at_entry("m/s")] = None,
    flight_path_angle_deg: Annotated[float | None, _at_entry("deg")] = None,
    azimuth_deg: Annotated[float | None, _at_entry("deg")] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option("--parameter", "-p", help="Any parameter of the database, KEY=VALUE."),
    ] = None,
    mode: Annotated[str, typer.Option(help=ONE_MODE)] = "ampi",
    holes: HolesOption = "refuse",
    table: Annotated[Path | None, typer.Option("--csv", help="Write the reference as CSV.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw it (PNG, PDF, SVG).")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measured parameters → the reference that the tracker flies.

    Exit status 1 where they lie outside the hypercube by more than 20 % of an axis' range.
    """
    from ampi.onboard.health import Health

    options = {
        "altitude_km": altitude_km,
        "longitude_deg": longitude_deg,
        "latitude_deg": latitude_deg,
        "speed_m_per_s": speed,
        "flight_path_angle_deg": flight_path_angle_deg,
        "azimuth_deg": azimuth_deg,
    }
    with refusals():
        check_output(table, force=force, made_by=HEADER, others=[path, plot])
        check_figure(plot, force=force, made_by="ampi guide", others=[path])
        mission, guidance = _guidance(path, mode, holes)
        reference = guidance.reference(_measured(mission, _given(options, parameter or [])))
        certificate = None if guidance.certifier is None else guidance.certificate(reference)
        if table is not None:
            write_nodes(table, reference)
        if plot is not None:
            _draw(mission, reference, plot)
    names = [p.name for p in mission.parameters]
    _warn(names, reference)
    if as_json:
        print_json({**_as_dict(names, reference), "certificate": _certified(certificate)})
    else:
        _print(names, reference)
        _print_certificate(certificate)
    if reference.health >= Health.FAR_OUTSIDE:
        raise typer.Exit(1)


def _given(options: Mapping[str, float | None], pairs: Sequence[str]) -> dict[str, float]:
    """What is measured, by key: from the options of their own and from KEY=VALUE."""
    given = {key: value for key, value in options.items() if value is not None}
    for key, value in (key_and_value(pair, "--parameter") for pair in pairs):
        if key in given:
            raise ValueError(f"{key}: given twice")
        given[key] = value
    return given


def _guidance(path: Path, mode: str, holes: str) -> tuple[Mission, Guidance]:
    from ampi.dataset import read_dataset
    from ampi.loading import HOLES, guidance_of
    from ampi.onboard.reference import Mode

    chosen = member(Mode, mode, "--mode")
    dataset = read_dataset(path)
    guidance = guidance_of(dataset, mode=chosen, holes=one_of(HOLES, holes, "--holes"))
    return dataset.mission, guidance


def _measured(mission: Mission, given: Mapping[str, float]) -> Any:
    from ampi.missions.parameters import measured_values

    return measured_values(mission, mission.parameters, given)


def _draw(mission: Mission, reference: Reference, path: Path) -> None:
    from ampi.report.figures.single import reference_figure
    from ampi.report.figures.style import save_figure

    flown = mission.with_parameters(reference.parameters)
    save_figure(path, reference_figure(flown, reference), "ampi guide")


def _excess(names: Sequence[str], reference: Reference) -> dict[str, float]:
    """How far outside the hypercube, of what is outside, as shares of its axis' range."""
    return {n: share for n, share in zip(names, reference.excess, strict=True) if share > 0}


def _outside(names: Sequence[str], reference: Reference) -> list[str]:
    return [name for name, clipped in zip(names, reference.clipped, strict=True) if clipped]


def _warn(names: Sequence[str], reference: Reference) -> None:
    import numpy as np

    from ampi.onboard.health import Health

    for name, share in _excess(names, reference).items():
        by = np.format_float_positional(100 * share, precision=3, fractional=False, trim="-")
        error_out.print(f"warning: {name} lies outside the hypercube by {by} % of its axis' range")
    if reference.health >= Health.HOLE_REFERENCE:
        error_out.print(f"warning: {reference.health}: {reference.health.sentence}")


def _as_dict(names: Sequence[str], reference: Reference) -> dict[str, Any]:
    return {
        "parameters": dict(zip(names, reference.parameters, strict=True)),
        "cell": reference.cell,
        "outside": _outside(names, reference),
        "excess": _excess(names, reference),
        "health": str(reference.health),
        "hole": reference.hole,
        "final_time_s": reference.final_time,
        "bank_angle_at_entry_deg": math.degrees(reference.states[6, 0]),
        **{f"{k.replace(' ', '_')}_at_entry_deg": v for k, v in _angle_at_entry(reference).items()},
    }


def _angle_at_entry(reference: Reference) -> dict[str, float]:
    """The angle of attack (deg) there, of a vehicle that steers it."""
    row = reference.layout.angle_of_attack
    return {} if row is None else {"angle of attack": math.degrees(reference.rows[row, 0])}


def _print(names: Sequence[str], reference: Reference) -> None:
    out.print(
        f"cell ({', '.join(map(str, reference.cell))}), final time {reference.final_time:.2f} s, "
        f"bank angle at entry {math.degrees(reference.states[6, 0]):.2f} deg"
        + "".join(f", {name} {value:.2f} deg" for name, value in _angle_at_entry(reference).items())
    )
    outside = _outside(names, reference)
    if outside:
        out.print(f"outside the hypercube in {', '.join(outside)}: boundary trajectory")
    if reference.hole:
        out.print("in a cell with an unsolved case: the nearest solved one stands for it")


def _certified(certificate: Certificate | None) -> dict[str, Any] | None:
    """What is known of the reference before it is flown; None where the model on board cannot tell."""
    if certificate is None:
        return None
    at_nodes, between = certificate.defect.tolist()
    return {
        "verdict": str(certificate.verdict),
        "sentence": certificate.verdict.sentence,
        "defect_at_nodes": at_nodes,
        "defect_between": between,
        "predicted_miss_m": dict(
            zip(("east", "north", "up"), certificate.miss.tolist(), strict=True)
        )
        if math.isfinite(certificate.horizontal_miss)
        else None,
        "margins": dict(zip(certificate.limits, certificate.margins.tolist(), strict=True)),
    }


def _print_certificate(certificate: Certificate | None) -> None:
    if certificate is None:
        return
    least = int(certificate.margins.argmin())
    miss = certificate.horizontal_miss
    end = (
        f"end {miss / 1e3:.2f} km from the target, {certificate.miss[2]:+.0f} m in altitude"
        if math.isfinite(miss)
        else "not reach the target speed"
    )
    out.print(
        f"flown without a tracker it would {end}; least margin "
        f"{100.0 * certificate.margins[least]:.1f} %, {certificate.limits[least].replace('_', ' ')}"
    )
    out.print(f"{certificate.verdict}: {certificate.verdict.sentence}")
