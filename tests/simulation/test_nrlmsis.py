"""NRLMSIS of a day and a place against US76, and what it cannot be asked."""

from __future__ import annotations

import sys
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from ampi.physics.atmosphere import StandardAtmosphere1976
from ampi.simulation.nrlmsis import (
    NrlmsisConditions,
    nrlmsis_density,
    nrlmsis_speed_of_sound,
)

US76 = StandardAtmosphere1976()
WINTER = NrlmsisConditions(
    time=datetime(2026, 1, 15, 12),
    latitude=np.radians(70.0),
    longitude=np.radians(-30.0),
    ap=15.0,
)
SUMMER = replace(WINTER, time=datetime(2026, 7, 15, 12))
KM = np.array([20.0, 40.0, 60.0, 70.0, 80.0, 100.0])


@pytest.mark.parametrize(
    ("conditions", "percent"),
    [(WINTER, (-8, -31, -44, -44, -38, -11)), (SUMMER, (0, 15, 31, 41, 34, -52))],
)
def test_the_arctic_against_the_standard_atmosphere(
    conditions: NrlmsisConditions, percent: tuple[float, ...]
) -> None:
    # per cent of US76 at 70° N, as they were found by another program
    off = 100.0 * (nrlmsis_density(conditions, KM * 1e3) / US76.density(KM * 1e3) - 1.0)
    assert off == pytest.approx(np.array(percent), abs=2.5)


def test_its_air_is_hydrostatic_where_it_is_mixed() -> None:
    """d ln(ρ T)/dh = −g/(R T), with T of its own speed of sound."""
    h = np.arange(10e3, 70e3, 500.0)
    temperature = nrlmsis_speed_of_sound(WINTER, h) ** 2 / (1.4 * 287.053)
    slope = np.gradient(np.log(nrlmsis_density(WINTER, h) * temperature), h)
    weight = 9.826 * (6_360e3 / (6_360e3 + h)) ** 2  # at 70° N
    assert slope[2:-2] == pytest.approx((-weight / (287.053 * temperature))[2:-2], rel=5e-3)


def test_activity_is_what_is_given() -> None:
    """The Sun swells the air above 100 km and nothing below; nothing is looked up."""
    high = np.array([40e3, 130e3])
    quiet, active = (
        nrlmsis_density(replace(WINTER, f107=f107, f107_average=f107), high)
        for f107 in (70.0, 220.0)
    )
    assert active[0] == pytest.approx(quiet[0], rel=1e-6)
    assert abs(active[1] / quiet[1] - 1.0) > 0.02


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("latitude", 2.0, "latitude: expected -90 to 90 deg, got 114.592 deg"),
        ("latitude", np.nan, "latitude: expected -90 to 90 deg, got nan deg"),
        ("longitude", np.inf, "longitude: expected a finite number, got inf"),
        ("f107", 0.0, "f107: expected 50 to 1000, got 0"),
        ("f107_average", np.nan, "f107_average: expected 50 to 1000, got nan"),
        ("ap", -1.0, "ap: expected 0 to 1000, got -1"),
    ],
)
def test_conditions_that_are_none_are_refused(name: str, value: float, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        replace(WINTER, **{name: value})


def test_without_its_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymsis", None)
    with pytest.raises(ValueError, match=r"NRLMSIS needs pymsis, .* 'ampi\[atmosphere\]'"):
        nrlmsis_density(WINTER, KM * 1e3)
