"""`ampi atmosphere`: the air of a day and a place as a table that a mission may name."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ampi.cli.console import out, print_json
from ampi.cli.endings import refusals
from ampi.cli.options import Force, Json
from ampi.cli.output_files import check_output

if TYPE_CHECKING:
    from ampi.simulation.nrlmsis import NrlmsisConditions

MADE_BY = "ampi atmosphere"
METRES = 1e3  # per km
TOP, STEP = (
    130.0,
    2.0,
)  # km: the highest entry that a mission may have, and a third of a scale height


def atmosphere(
    path: Annotated[Path, typer.Argument(metavar="OUT.csv", help="The table to write.")],
    date: Annotated[str, typer.Option(help="Day, YYYY-MM-DD.")],
    latitude: Annotated[float, typer.Option(help="Geodetic latitude (deg).")],
    longitude: Annotated[float, typer.Option(help="Longitude (deg), positive to the east.")],
    hour: Annotated[float, typer.Option(min=0.0, max=24.0, help="Of the day, UTC.")] = 12.0,
    f107: Annotated[float, typer.Option(help="Solar radio flux of the day before (sfu).")] = 150.0,
    f107a: Annotated[
        float | None, typer.Option(help="Its mean over 81 days; as --f107 if not given.")
    ] = None,
    ap: Annotated[float, typer.Option(help="Geomagnetic activity Ap of the day.")] = 4.0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """The air by NRLMSIS 2.1, from 0 to 130 km, as a CSV: altitude, density, speed of sound.

    A mission flies in it by model = "table" and file = "OUT.csv" in its atmosphere. It needs pymsis;
    nothing is downloaded. The speed of sound is that of air as it is on the ground.
    """
    with refusals():
        check_output(path, ".csv", force=force, made_by=MADE_BY)
        import numpy as np

        from ampi.missions.air_table import air_table_text
        from ampi.physics.atmosphere import StandardAtmosphere1976
        from ampi.simulation.nrlmsis import (
            NrlmsisConditions,
            nrlmsis_density,
            nrlmsis_speed_of_sound,
        )

        conditions = NrlmsisConditions(
            time=_day(date) + timedelta(hours=hour),
            latitude=float(np.radians(latitude)),
            longitude=float(np.radians(longitude)),
            f107=f107,
            f107_average=f107 if f107a is None else f107a,
            ap=ap,
        )
        altitude = np.arange(0.0, TOP + STEP, STEP, dtype=np.float64) * METRES
        density = nrlmsis_density(conditions, altitude)
        sound = nrlmsis_speed_of_sound(conditions, altitude)
        text = air_table_text([altitude, density, sound], _comments(conditions))
        path.write_text(text, encoding="utf-8")
    ratio = density / StandardAtmosphere1976().density(altitude)
    if as_json:
        print_json({"path": str(path), **_columns(altitude, density, sound, ratio)})
    else:
        _print(path, altitude, ratio)


def _day(date: str) -> datetime:
    try:
        return datetime.strptime(date, "%Y-%m-%d")
    except ValueError:
        raise ValueError(f"--date: expected a day, YYYY-MM-DD, got {date!r}") from None


def _comments(conditions: NrlmsisConditions) -> list[str]:
    from math import degrees

    where = f"{degrees(conditions.latitude):g} N, {degrees(conditions.longitude):g} E"
    return [
        f"NRLMSIS 2.1, {conditions.time:%Y-%m-%d %H:%M} UTC, {where}, F10.7 {conditions.f107:g} "
        f"(81 days {conditions.f107_average:g}), Ap {conditions.ap:g}; by `{MADE_BY}`"
    ]


def _columns(altitude: Any, density: Any, sound: Any, ratio: Any) -> dict[str, list[float]]:
    return {
        "altitude_m": altitude.tolist(),
        "density_kg_per_m3": density.tolist(),
        "speed_of_sound_m_per_s": sound.tolist(),
        "density_over_us76": ratio.tolist(),
    }


def _print(path: Path, altitude: Any, ratio: Any) -> None:
    out.print(f"{path}: {len(altitude)} altitudes up to {altitude[-1] / METRES:g} km")
    out.print("density against US76:")
    for h, share in zip(altitude[::10], ratio[::10], strict=True):
        out.print(f"  {h / METRES:4.0f} km  {100.0 * (share - 1.0):+6.1f} %")
