"""Not-a-number in, not-a-number out: wherever a result depends on an input, clipped or not."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.physics.aerodynamics import TabulatedAerodynamics
from ampi.physics.atmosphere import StandardAtmosphere1976
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.path_constraints import no_fly_zone, path_constraints
from ampi.physics.planet import bearing, destination, great_circle_distance
from ampi.tracing.dynamics import NodeDynamics, Physics
from ampi.tracing.node_functions import NodeFunctions

Array = NDArray[np.float64]

# under, within and over the tables and the schedules
REGIMES = [
    np.array([altitude, 0.3, 0.2, speed, -0.1, 0.4, 0.5, time])
    for altitude, speed, time in product(
        (-1e3, 50e3, 130e3), (200.0, 4500.0, 7900.0), (0.0, 70.0, 900.0)
    )
]


def everything(model: FlightModel, point: Array) -> Array:
    """What the physics says at a state and time."""
    state, time = point[:7], point[7]
    return np.array(
        [
            *equations_of_motion(model, state, 0.0, time)[:6],
            *path_constraints(model, state, time),
            model.atmosphere.density(state[0]),
            model.vehicle.angle_of_attack(time, state[3]),
            no_fly_zone(state[1], state[2], (0.1, 0.2, 0.01)),
            great_circle_distance(state[1], state[2], 0.1, 0.2, 1.0),
            bearing(state[1], state[2], 0.1, 0.2),
            *destination(state[1], state[2], state[5], 0.1),
        ]
    )


def test_every_result_that_depends_on_it_is_none(model: FlightModel) -> None:
    depends = np.zeros((8, len(everything(model, REGIMES[0]))), dtype=bool)
    for point in REGIMES:
        here = everything(model, point)
        assert np.all(np.isfinite(here))
        for k in range(8):
            depends[k] |= (
                everything(model, point + 1e-3 * np.eye(8)[k] * max(1.0, point[k])) != here
            )
    assert depends.sum() > 25
    for point in REGIMES:
        for k in range(8):
            lost = point.copy()
            lost[k] = np.nan
            assert np.all(np.isnan(everything(model, lost)[depends[k]]))


def test_the_speed_of_sound_of_no_altitude_is_none(model: FlightModel) -> None:
    for atmosphere in (model.atmosphere, StandardAtmosphere1976()):
        assert np.isnan(atmosphere.speed_of_sound(np.nan))


def test_a_table_knows_nothing_of_no_angle_and_no_mach_number() -> None:
    table = TabulatedAerodynamics(
        angle_of_attack=(0.1, 0.2),
        mach=(1.0, 5.0),
        lift=((0.1, 0.2), (0.3, 0.4)),
        drag=((1, 2),) * 2,
    )
    for angle, mach in ((np.nan, 3.0), (0.15, np.nan)):
        assert np.all(np.isnan(table.coefficients(angle, mach)))


def test_a_traced_function_passes_it_on(model: FlightModel) -> None:
    physics = Physics.of(model, NodeFunctions(), 1.0)
    function = NodeDynamics(physics.structure, (1.0,) * 7).values
    point = REGIMES[13]
    lost = point.copy()
    lost[0] = np.nan

    def by(way: Any, at: Array) -> list[Array]:
        x, t = at[:7].reshape(7, 1, 1), at[7:].reshape(1, 1)
        return list(way(x, np.zeros((1, 1)), t, physics.numbers))

    assert np.all(np.isfinite(by(function.together, point)[1]))
    assert np.all(np.isnan(by(function.together, lost)[1]))
    # CasADi's own minimum and maximum drop what is not a number: the rates have it by the radius
    rates, expected = by(function.one_by_one, lost)[0], by(function.together, lost)[0]
    assert np.all(np.isfinite(by(function.one_by_one, point)[0]))
    assert np.isnan(rates[1:6]).all()
    assert np.array_equal(np.isnan(rates), np.isnan(expected))
