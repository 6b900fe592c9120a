"""The shipped draws of Arctic air: complete, of NRLMSIS, with a vortex in winter."""

from __future__ import annotations

import csv
from datetime import datetime, timedelta
from importlib import resources

import numpy as np
import pytest

from ampi.physics.atmosphere import StandardAtmosphere1976
from ampi.simulation.nrlmsis import NrlmsisConditions, nrlmsis_density

FILE = resources.files("ampi.simulation") / "worlds" / "arctic_draws.csv"
HEADER, *ROWS = csv.reader(FILE.read_text(encoding="utf-8").splitlines())
DRAWS = np.array(ROWS, dtype=float)
KM = np.arange(0, 131, 5)


def column(name: str) -> np.ndarray:
    return DRAWS[:, HEADER.index(name)]


def profile(name: str) -> np.ndarray:
    """(draws, altitudes)."""
    return np.stack([column(f"{name}_{km}km") for km in KM], axis=1)


def test_every_combination_is_drawn_once() -> None:
    assert len(HEADER) == 4 + 3 * len(KM)
    assert np.all(np.isfinite(DRAWS))
    assert len(np.unique(DRAWS[:, :4], axis=0)) == len(DRAWS) == 24 * 4 * 3
    assert [len(np.unique(DRAWS[:, k])) for k in range(4)] == [24, 4, 3, 3]
    assert len(FILE.read_bytes()) < 250_000  # it is in the package


@pytest.mark.parametrize("row", [0, 17, 150, 287])
def test_a_draw_is_the_air_of_its_hour(row: int) -> None:
    day, hour, f107, ap = DRAWS[row, :4]
    conditions = NrlmsisConditions(
        time=datetime(2026, 1, 1) + timedelta(days=day - 1, hours=hour),
        latitude=np.radians(70.0),
        longitude=np.radians(-30.0),
        f107=f107,
        f107_average=f107,
        ap=ap,
    )
    factor = nrlmsis_density(conditions, KM * 1e3) / StandardAtmosphere1976().density(KM * 1e3)
    assert profile("density")[row] == pytest.approx(factor, rel=1e-3)


def test_winter_is_thin_and_blows_to_the_east() -> None:
    density, east, north = (profile(name) for name in ("density", "wind_east", "wind_north"))
    january, july = (np.abs(column("day_of_year") - day) < 10.0 for day in (15.0, 197.0))
    at = list(KM).index
    assert np.all(density[january][:, at(60)] < 0.6)
    assert np.all(density[july][:, at(60)] > 1.2)
    assert np.all(east[january] >= 0.0)
    assert np.all(east[july] <= 0.0)
    assert east.max() == pytest.approx(60.0, rel=0.02)
    assert east.min() == pytest.approx(-25.0, rel=0.02)
    assert KM[east[january].argmax(axis=1)] == pytest.approx(55.0)
    assert not north.any()
