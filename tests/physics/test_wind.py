"""Wind and an offset of the angle of attack: Galilean invariance, signs, still air to the bit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.missions import load_mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import (
    FlightModel,
    aerodynamic_acceleration,
    equations_of_motion,
)
from ampi.physics.path_constraints import path_constraints
from ampi.physics.vehicle import air_loads
from ampi.tracing.dynamics import NodeDynamics, Physics
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracing.numbers import taken_apart

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=100)
TIME = 70.0
states = st.tuples(
    st.floats(5e3, 100e3),
    st.floats(-3.0, 3.0),
    st.floats(-1.3, 1.3),
    st.floats(400.0, 7500.0),
    st.floats(-1.2, 1.2),
    st.floats(-3.1, 3.1),
    st.floats(-3.1, 3.1),
)


@dataclass(frozen=True)
class ConstantWind:
    """The same wind at every altitude; numbers or arrays over flights."""

    east: Any  # m/s
    north: Any  # m/s

    def components(self, altitude: Any) -> tuple[Any, Any]:
        """(w_E, w_N) (m/s)."""
        return self.east, self.north


winds = st.builds(ConstantWind, st.floats(-150.0, 150.0), st.floats(-150.0, 150.0))
HEADING_WEST = np.array([40e3, -0.2, 1.2, 3000.0, -0.05, -0.5 * np.pi, 0.3])


def over_time(model: FlightModel) -> FlightModel:
    """The model with a schedule that knows no speed: that over the ground is no Galilean quantity."""
    schedule = load_mission("shefex3").flight_model.vehicle.angle_of_attack
    return replace(model, vehicle=replace(model.vehicle, angle_of_attack=schedule))


def axes(state: Array) -> Array:
    """Along, up and right of the track as rows of north, east, up."""
    fpa, azimuth = state[4], state[5]
    north, east = np.cos(azimuth), np.sin(azimuth)
    return np.array(
        [
            [np.cos(fpa) * north, np.cos(fpa) * east, np.sin(fpa)],
            [-np.sin(fpa) * north, -np.sin(fpa) * east, np.cos(fpa)],
            [-east, north, 0.0],
        ]
    )


def in_north_east_up(model: FlightModel, state: Array) -> Array:
    return np.array(aerodynamic_acceleration(model, state, TIME)) @ axes(state)


def with_velocity(state: Array, velocity: Array) -> Array:
    """The state with a velocity (north, east, up) in the place of its own."""
    speed = np.linalg.norm(velocity)
    moved = state.copy()
    moved[3:6] = speed, np.arcsin(velocity[2] / speed), np.arctan2(velocity[1], velocity[0])
    return moved


@laws
@given(state=states, wind=winds)
def test_the_air_knows_its_own_velocity_alone(
    model: FlightModel, state: tuple[float, ...], wind: ConstantWind
) -> None:
    """With wind w at V as in still air at V − w: vectors in axes that do not turn with the track."""
    model, x = over_time(model), np.array(state)
    velocity = x[3] * axes(x)[0] - np.array([wind.north, wind.east, 0.0])
    assume(np.hypot(velocity[0], velocity[1]) > 0.05 * np.linalg.norm(velocity))
    carried = with_velocity(x, velocity)
    expected = in_north_east_up(model, carried)
    blown = replace(model, wind=wind)
    assert in_north_east_up(blown, x) == pytest.approx(
        expected, rel=1e-9, abs=1e-10 * np.linalg.norm(expected)
    )
    loads, still = path_constraints(blown, x, TIME), path_constraints(model, carried, TIME)
    assert loads == pytest.approx(still, rel=1e-9)


@laws
@given(state=states, wind=winds)
def test_the_rates_differ_by_the_sensed_acceleration_alone(
    model: FlightModel, state: tuple[float, ...], wind: ConstantWind
) -> None:
    blown, x = replace(model, wind=wind), np.array(state)
    rates = np.array(equations_of_motion(blown, x, 0.02, TIME))
    still = np.array(equations_of_motion(model, x, 0.02, TIME))
    sensed = np.array(aerodynamic_acceleration(blown, x, TIME))
    sensed -= aerodynamic_acceleration(model, x, TIME)
    over = np.array([1.0, x[3], x[3] * np.cos(x[4])])
    assert (rates - still)[3:6] == pytest.approx(sensed / over, rel=1e-7, abs=1e-11)
    assert np.array_equal(rates[[0, 1, 2, 6]], still[[0, 1, 2, 6]])


@laws
@given(state=states)
def test_in_still_air_an_accelerometer_senses_drag_and_banked_lift(
    model: FlightModel, state: tuple[float, ...]
) -> None:
    air = air_loads(model.vehicle, model.atmosphere, state[0], state[3], TIME)
    bank = state[6]
    expected = (-air.drag, air.lift * np.cos(bank), air.lift * np.sin(bank))
    assert aerodynamic_acceleration(model, state, TIME) == expected
    calm = replace(model, wind=ConstantWind(0.0, 0.0), angle_of_attack_offset=0.0)
    size = np.hypot(air.drag, air.lift)
    assert aerodynamic_acceleration(calm, state, TIME) == pytest.approx(expected, abs=1e-12 * size)
    assert path_constraints(calm, state, TIME) == pytest.approx(
        path_constraints(model, state, TIME), rel=1e-12
    )


def test_a_headwind_raises_drag_by_the_square() -> None:
    # in level flight to the west, 60 m/s from the west: (3060 / 3000)² = 1.0404
    model = load_mission("shefex3").flight_model
    level = HEADING_WEST.copy()
    level[4] = 0.0
    still, ahead, behind = (
        np.array(aerodynamic_acceleration(replace(model, wind=wind), level, TIME))
        for wind in (None, ConstantWind(60.0, 0.0), ConstantWind(-60.0, 0.0))
    )
    assert ahead == pytest.approx(still * 1.0404, rel=1e-12)
    assert behind == pytest.approx(still * 0.98**2, rel=1e-12)
    pressure, heat, load = (
        np.divide(*(path_constraints(replace(model, wind=w), level, TIME)[k] for w in (wind, None)))
        for k, wind in ((k, ConstantWind(60.0, 0.0)) for k in range(3))
    )
    assert (pressure, heat, load) == pytest.approx((1.0404, 1.02**3, 1.0404), rel=1e-12)


@pytest.mark.parametrize("azimuth", [-1.5, 0.2, 2.5])
def test_a_cross_wind_pushes_downwind(azimuth: float) -> None:
    model = load_mission("shefex3").flight_model
    state = HEADING_WEST.copy()
    state[5:] = azimuth, 0.0
    right = np.array([-np.sin(azimuth), np.cos(azimuth)])  # north, east
    for speed in (50.0, -50.0):
        wind = ConstantWind(east=speed * right[1], north=speed * right[0])
        pushed = aerodynamic_acceleration(replace(model, wind=wind), state, TIME)[2]
        drag = -aerodynamic_acceleration(model, state, TIME)[0]
        assert np.sign(pushed) == np.sign(speed)
        assert pushed == pytest.approx(drag * speed / state[3], rel=0.1)


def test_the_drag_floor_sees_the_speed_through_the_air() -> None:
    model, limits = load_mission("shefex3").flight_model, PathLimits(drag_floor=(10.0, 5000.0))
    level = HEADING_WEST.copy()
    level[4] = 0.0
    drag = [
        2.0 - limits.path(m, level, TIME)[3]
        for m in (model, replace(model, wind=ConstantWind(60.0, 0.0)))
    ]
    assert drag[1] == pytest.approx(1.0404 * drag[0], rel=1e-12)


@laws
@given(state=states, offset=st.floats(-0.1, 0.1))
def test_an_offset_is_a_schedule_that_is_shifted(
    model: FlightModel, state: tuple[float, ...], offset: float
) -> None:
    schedule = model.vehicle.angle_of_attack
    angles = {name: getattr(schedule, name) + offset for name in ("start_angle", "end_angle")}
    shifted = replace(
        model, vehicle=replace(model.vehicle, angle_of_attack=replace(schedule, **angles))
    )
    moved = replace(model, angle_of_attack_offset=offset)
    for of in (aerodynamic_acceleration, path_constraints):
        assert of(moved, state, TIME) == pytest.approx(of(shifted, state, TIME), rel=1e-9)


def test_flights_in_their_own_winds_together_and_alone_are_the_same(model: FlightModel) -> None:
    rng, n = np.random.default_rng(4), 9
    x = HEADING_WEST[:, None] * rng.uniform(0.9, 1.1, (7, n))
    east, north, offset = rng.normal(0.0, 40.0, n), rng.normal(0.0, 40.0, n), rng.normal(0, 0.02, n)
    together = replace(model, wind=ConstantWind(east, north), angle_of_attack_offset=offset)
    found = np.stack(np.broadcast_arrays(*equations_of_motion(together, x, 0.0, TIME)))
    for k in range(n):
        own = replace(model, wind=ConstantWind(east[k], north[k]), angle_of_attack_offset=offset[k])
        alone = equations_of_motion(own, x[:, k], 0.0, TIME)
        assert found[:, k] == pytest.approx(alone, rel=1e-12, abs=1e-15)


def test_still_air_is_no_number_of_a_structure() -> None:
    """What was traced before there was wind is traced as it was."""
    model = load_mission("shefex3").flight_model
    numbers = taken_apart((model.planet, model.atmosphere, model.vehicle))[1]
    assert taken_apart(model)[1] == numbers
    blown = replace(model, wind=ConstantWind(10.0, -20.0), angle_of_attack_offset=0.01)
    assert taken_apart(blown)[1] == [*numbers, 10.0, -20.0, 0.01]


def test_wind_is_traced_with_its_derivatives() -> None:
    """CasADi's values and Jacobian against numpy and complex steps; wind and offset are numbers."""
    base = load_mission("shefex3").flight_model
    model = replace(base, wind=ConstantWind(35.0, -50.0), angle_of_attack_offset=0.02)
    physics = Physics.of(model, NodeFunctions(), 1.0)
    function = NodeDynamics(physics.structure, (1.0,) * 7).first
    values = function.together(
        HEADING_WEST.reshape(7, 1, 1), np.zeros((1, 1)), np.full((1, 1), TIME), physics.numbers
    )
    expected = equations_of_motion(model, HEADING_WEST, 0.0, TIME)
    assert values[0][:, 0, 0] == pytest.approx(expected, rel=1e-11, abs=1e-14)
    limits = [row[0, 0] for row in values[3]]
    assert limits == pytest.approx(path_constraints(model, HEADING_WEST, TIME), rel=1e-11)
    jacobian = np.zeros((7, 7))
    for place, row in zip(function.nonzeros[1], values[1], strict=True):
        jacobian[place] = row[0, 0]
    steps = HEADING_WEST[:, None] + 1e-20j * np.eye(7)
    exact = np.stack(np.broadcast_arrays(*equations_of_motion(model, steps, 0.0 * steps[0], TIME)))
    size = np.abs(exact.imag / 1e-20).max(axis=1, keepdims=True)
    assert np.all(np.abs(jacobian - exact.imag / 1e-20) <= 1e-10 * size)


def test_a_wind_may_be_a_symbol() -> None:
    """The slope of the azimuth's rate over an east wind."""
    model, east = load_mission("shefex3").flight_model, ca.SX.sym("east")
    mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)
    try:
        blown = replace(model, wind=ConstantWind(east, 12.0))
        turning = equations_of_motion(blown, ca.SX(HEADING_WEST), 0.0, TIME)[5]
    finally:
        ca.GlobalOptions.setNumpyMode(mode)
    slope = ca.Function("slope", [east], [ca.jacobian(turning, east)])
    for at in (0.0, 40.0):
        sides = [
            equations_of_motion(
                replace(model, wind=ConstantWind(at + side, 12.0)), HEADING_WEST, 0.0, TIME
            )[5]
            for side in (1.0, -1.0)
        ]
        assert float(slope(at)) == pytest.approx(0.5 * (sides[0] - sides[1]), rel=1e-4)
