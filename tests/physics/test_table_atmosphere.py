"""A table of the air made smooth: US76 given as a table, every derivative, refusals."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.missions import load_mission
from ampi.physics.atmosphere import AIR_GAS_CONSTANT, SPECIFIC_HEAT_RATIO, TableAtmosphere
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.tracing.dynamics import NodeDynamics, Physics
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracing.numbers import taken_apart

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=60)
ROWS = np.loadtxt(
    (resources.files("ampi.physics") / "us76.csv").read_text(encoding="utf-8").splitlines(),
    delimiter=",",
    skiprows=2,
)
H, RHO = ROWS[:, 0], ROWS[:, 1]
SOUND = np.sqrt(SPECIFIC_HEAT_RATIO * AIR_GAS_CONSTANT * ROWS[:, 2])


def table(every: int = 1) -> TableAtmosphere:
    columns = (H[::every], RHO[::every], SOUND[::every])
    return TableAtmosphere.of(*(tuple(column.tolist()) for column in columns))


@pytest.mark.parametrize(("every", "most"), [(1, 0.015), (2, 0.016), (5, 0.02)])
def test_the_standard_atmosphere_as_a_table(every: int, most: float) -> None:
    """As the Chebyshev fit of US76; the worst is the tropopause, which every 5 km is between points."""
    air = table(every)
    off = air.density(H) / RHO - 1.0
    assert np.abs(off).max() < most
    assert np.sqrt(np.mean(off**2)) < 0.004
    assert np.abs(air.speed_of_sound(H) / SOUND - 1.0).max() < 0.01


def test_an_exponential_is_met_to_rounding() -> None:
    # uneven points from below the ground: ln ρ and ln c are lines there
    h = (-1e3, 0.0, 7e3, 9e3, 20e3, 50e3, 51e3, 80e3, 130e3)
    air = TableAtmosphere.of(
        h, tuple(1.2 * np.exp(-np.array(h) / 7e3)), tuple(300.0 + 0.0 * np.array(h))
    )
    at = np.linspace(-2e3, 150e3, 77)  # the slope of either edge goes on
    assert air.density(at) == pytest.approx(1.2 * np.exp(-at / 7e3), rel=1e-9)
    assert air.speed_of_sound(at) == pytest.approx(np.full(77, 300.0), rel=1e-10)
    thick = replace(air, density_factor=1.1)
    assert thick.density(at) == pytest.approx(1.1 * air.density(at), rel=1e-15)


@laws
@given(altitude=st.floats(1e3, 119e3))
def test_first_and_second_derivatives(altitude: float) -> None:
    air = table()

    def slope(h: float) -> tuple[float, float]:
        return tuple(of(h + 1e-20j).imag / 1e-20 for of in (air.density, air.speed_of_sound))

    for k, of in enumerate((air.density, air.speed_of_sound)):
        difference = (of(altitude + 10.0) - of(altitude - 10.0)) / 20.0
        assert slope(altitude)[k] == pytest.approx(difference, rel=1e-4, abs=1e-6 * of(altitude))
        near, far = (
            (slope(altitude + step)[k] - slope(altitude - step)[k]) / (2.0 * step)
            for step in (20.0, 40.0)
        )
        assert near == pytest.approx(far, rel=0.01, abs=1e-9 * of(altitude))


def test_a_table_is_structure_and_its_factor_a_number() -> None:
    model = load_mission("shefex3").flight_model
    air = replace(table(), density_factor=1.07)
    structure, numbers = taken_apart(air)
    assert numbers == [1.07]
    assert hash(structure) != hash(taken_apart(table(2))[0])
    flying = replace(model, atmosphere=air)
    physics = Physics.of(flying, NodeFunctions(), 1.0)
    x = np.array([40e3, -0.2, 1.2, 3000.0, -0.05, -1.5, 0.3])
    found = NodeDynamics(physics.structure, (1.0,) * 7).values.together(
        x.reshape(7, 1, 1), np.zeros((1, 1)), np.full((1, 1), 70.0), physics.numbers
    )
    expected = equations_of_motion(flying, x, 0.0, 70.0)
    assert found[0][:, 0, 0] == pytest.approx(expected, rel=1e-12, abs=1e-15)


GOOD = {"altitude": H[::4], "density": RHO[::4], "speed_of_sound": SOUND[::4]}
BROKEN = np.where(np.arange(31) == 15, 2.0, 1.0)
REFUSED = {
    "few": ({k: v[:7] for k, v in GOOD.items()}, "altitude: expected at least 8 altitudes, got 7"),
    "not increasing": (
        {"altitude": np.where(H[::4] == 40e3, 36e3, H[::4])},
        "altitude: expected altitudes that increase strictly, got 36000 m after 36000 m",
    ),
    "from above the ground": (
        {k: v[1:] for k, v in GOOD.items()},
        "altitude: expected a table that starts at 0 m or below, got one that starts at 4000 m",
    ),
    "a number short": (
        {"density": RHO[::4][:-1]},
        "density: expected 31 numbers, one for each altitude, got 30",
    ),
    "not positive": (
        {"density": np.where(H[::4] == 40e3, -1.0, RHO[::4])},
        "density: expected positive numbers, got -1 at 40000 m",
    ),
    "no number": (
        {"speed_of_sound": np.where(H[::4] == 8e3, np.nan, SOUND[::4])},
        "speed_of_sound: expected positive numbers, got nan at 8000 m",
    ),
    "not smooth": (
        {"density": RHO[::4] * BROKEN},
        "density: expected a table that a smooth curve follows within 5 %, got one that it leaves by ",
    ),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_what_is_no_table_of_the_air_is_refused(fault: str) -> None:
    change, said = REFUSED[fault]
    columns = {**GOOD, **change}
    with pytest.raises(ValueError, match=re.escape(f"atmosphere.{said}")) as caught:
        TableAtmosphere.of(*(tuple(column.tolist()) for column in columns.values()))
    if fault == "not smooth":
        assert "% at 60000 m; smooth it there" in str(caught.value)
