"""The draws of the world `arctic`: ampi/simulation/worlds/arctic_draws.csv.

A row is the air over 70° N, 30° W at one half-month, hour and activity of the Sun, all combinations:

    24 half-months × 4 hours (UTC) × 3 activities (F10.7, Ap) = (70, 4), (150, 15), (220, 40)

day_of_year, hour, f107, ap
    Of which the air is. The flux is its own mean over 81 days.
density_0km … density_130km
    Density by NRLMSIS 2.1 [P] over that of the smooth US76 (ampi/physics/atmosphere.py), which beyond
    120 km goes on with the slope of its edge.
wind_east_0km … wind_east_130km, wind_north_0km … wind_north_130km
    Mean wind (m/s). [X], a surrogate of the polar vortex and no model of a day's wind: the mean over all
    longitudes is eastward in winter, 60 m/s at 55 km on 15 January, and westward in summer, 25 m/s at
    65 km on 15 July, each a Gaussian over altitude of 20 km standard deviation that fades as the cosine
    of the day of the year; nothing blows to the north.

Needs pymsis (`ampi[atmosphere]`). The same numbers come out every time.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from importlib import resources
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.physics.atmosphere import StandardAtmosphere1976
from ampi.simulation.nrlmsis import NrlmsisConditions, nrlmsis_density

Array = NDArray[np.float64]

KILOMETRES = np.arange(0, 131, 5)
LATITUDE, LONGITUDE = np.radians(70.0), np.radians(-30.0)
HALF_MONTHS = 24
DAYS = 365.0
HOURS = (0, 6, 12, 18)
ACTIVITIES = ((70.0, 4.0), (150.0, 15.0), (220.0, 40.0))
MIDWINTER = 15.0  # day of the year; midsummer half a year later
WINTER_JET, SUMMER_JET = (60.0, 55.0), (-25.0, 65.0)  # m/s towards the east, at km
WIDTH = 20.0  # km
YEAR = 2026  # of which NRLMSIS reads the day alone


def days() -> list[int]:
    """The middle day of every half-month."""
    return [round((k + 0.5) * DAYS / HALF_MONTHS) for k in range(HALF_MONTHS)]


def wind_east(day: float) -> Array:
    """(k,) at `KILOMETRES`, m/s."""
    season = np.cos(2.0 * np.pi * (day - MIDWINTER) / DAYS)
    speed, height = WINTER_JET if season > 0.0 else SUMMER_JET
    jet: Array = np.exp(-0.5 * ((KILOMETRES - height) / WIDTH) ** 2)
    return abs(season) * speed * jet


def rows() -> Iterator[list[float]]:
    """The draws."""
    standard = StandardAtmosphere1976().density(KILOMETRES * 1e3)
    for day, hour, (f107, ap) in product(days(), HOURS, ACTIVITIES):
        conditions = NrlmsisConditions(
            time=datetime(YEAR, 1, 1) + timedelta(days=day - 1, hours=hour),
            latitude=LATITUDE,
            longitude=LONGITUDE,
            f107=f107,
            f107_average=f107,
            ap=ap,
        )
        density = nrlmsis_density(conditions, KILOMETRES * 1e3) / standard
        yield [day, hour, f107, ap, *density, *wind_east(day), *np.zeros(len(KILOMETRES))]


def main() -> None:
    """Write the table."""
    columns = ("density", "wind_east", "wind_north")
    names = [f"{column}_{km}km" for column in columns for km in KILOMETRES]
    lines = [",".join(["day_of_year", "hour", "f107", "ap", *names])]
    lines += [",".join(f"{value:.4g}" for value in row) for row in rows()]
    path = Path(str(resources.files("ampi.simulation"))) / "worlds" / "arctic_draws.csv"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{path}: {len(lines) - 1} draws, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
