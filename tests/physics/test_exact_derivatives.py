"""CasADi's derivatives of the physics against complex steps through the numpy source."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.tracing.dynamics import NodeDynamics, NodeFunction, Physics
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracing.numbers import Numbers
from tests.support.missions import SCALE

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=60)

LIMITS = (1e5, 6.5e6, 10.0)
RATE_SCALE = float(np.radians(5.0))

states = st.tuples(
    st.floats(5e3, 115e3),
    st.floats(-3.0, 3.0),
    st.floats(-1.3, 1.3),
    st.floats(300.0, 7500.0),
    st.floats(-1.2, 1.2),
    st.floats(-3.1, 3.1),
    st.floats(-3.1, 3.1),
)
times = st.floats(0.0, 57.0) | st.floats(59.0, 87.0) | st.floats(89.0, 700.0)
rates = st.floats(-1.0, 1.0)


@lru_cache(maxsize=4)
def traced(model: FlightModel) -> tuple[NodeDynamics, Numbers]:
    """The functions of a model, and its numbers."""
    functions = NodeFunctions(limits=PathLimits(loads=LIMITS))
    physics = Physics.of(model, functions, RATE_SCALE)
    return NodeDynamics(physics.structure, tuple(SCALE)), physics.numbers


def evaluated(
    function: NodeFunction, numbers: Numbers, x: Array, u: Array, t: Array, *weights: Array
) -> Iterator[list[Array]]:
    """Dense outputs (rows, columns, c, n): by numpy, then by CasADi's virtual machine."""
    for way in (function.together, function.one_by_one):
        dense = []
        for k, values in enumerate(way(x, u, t, numbers, *weights)):
            out = np.zeros((*function.function.size_out(k), *u.shape))
            for place, row in zip(function.nonzeros[k], values, strict=True):
                out[place] = row
            dense.append(out)
        yield dense


def at(
    function: NodeFunction, numbers: Numbers, point: Array, rate: float, *weights: Array
) -> Iterator[list[Array]]:
    """At one point (x, t): outputs (rows, columns), both ways."""
    x, u, t = point[:7].reshape(7, 1, 1), np.array([[rate]]), point[7:].reshape(1, 1)
    columns = [w.reshape(-1, 1, 1) for w in weights]
    for found in evaluated(function, numbers, x, u, t, *columns):
        yield [out[:, :, 0, 0] for out in found]


def away_from_kinks(model: FlightModel, state: tuple[float, ...]) -> bool:
    """Whether no kink of the schedule and no knot of a table is within the difference stencil."""
    schedule, speed = model.vehicle.angle_of_attack, state[3]
    kinks = [schedule.start, schedule.end] if schedule.variable == "speed" else []
    if any(abs(speed - kink) < 5.0 for kink in kinks):
        return False
    if model.vehicle.aerodynamics.needs_mach:
        mach = speed / model.atmosphere.speed_of_sound(state[0])
        knots = np.array([2.0, 2.75, 3.5, 5.0, 8.0, 10.0, 15.0, 20.0, 23.0, 24.5, 26.0])
        degrees = np.degrees(schedule(0.0, speed))
        if np.abs(mach - knots).min() < 0.02 or abs(degrees - 15.0) < 0.05:
            return False
    return True


def source(model: FlightModel, points: Array, rate: float) -> Array:
    """f (7) and g (3), (10, …), of scaled points (x, t), (8, …), through numpy."""
    physical = [points[i] * SCALE[i] for i in range(7)]
    f = equations_of_motion(model, physical, rate * RATE_SCALE, points[7])
    g = path_constraints(model, physical, points[7])
    rows = [r / s for r, s in zip((*f, *g), (*SCALE, *LIMITS), strict=True)]
    return np.stack(np.broadcast_arrays(*rows))


def complex_step_jacobian(model: FlightModel, points: Array, rate: float) -> Array:
    """∂(f, g)/∂(x, t), (10, 8, …), of points (8, …)."""
    along = np.eye(8).reshape(8, 8, *[1] * (points.ndim - 1))
    return source(model, points[:, None] + 1e-20j * along, rate).imag / 1e-20


def scaled(state: tuple[float, ...], time: float) -> Array:
    """The point (x, t) in scaled units."""
    return np.append(np.array(state) / SCALE, time)


@laws
@given(state=states, time=times, rate=rates)
def test_values_and_first_derivatives(
    model: FlightModel, state: tuple[float, ...], time: float, rate: float
) -> None:
    assume(away_from_kinks(model, state))
    point = scaled(state, time)
    values = source(model, point, rate)
    exact = complex_step_jacobian(model, point, rate)
    dynamics, numbers = traced(model)
    for f, over_x, over_t, g, over_xt in at(dynamics.first, numbers, point, rate):
        assert f[:, 0] == pytest.approx(values[:7], rel=1e-9, abs=1e-14)
        assert g[:, 0] == pytest.approx(values[7:], rel=1e-9, abs=1e-14)
        jacobian = np.vstack([np.column_stack([over_x, over_t]), over_xt])
        size = np.abs(exact).max(axis=1, keepdims=True)
        assert np.all(np.abs(jacobian - exact) <= 1e-9 * np.abs(exact) + 1e-11 * size)
    for (over_x,) in at(dynamics.jacobian, numbers, point, rate):
        size = np.abs(exact).max(axis=1, keepdims=True)[:7]
        wanted = exact[:7, :7]
        assert np.all(np.abs(over_x - wanted) <= 1e-9 * np.abs(wanted) + 1e-11 * size)


@laws
@given(state=states, time=times, rate=rates)
def test_values_without_derivatives(
    model: FlightModel, state: tuple[float, ...], time: float, rate: float
) -> None:
    point = scaled(state, time)
    values = source(model, point, rate)
    dynamics, numbers = traced(model)
    for f, g in at(dynamics.values, numbers, point, rate):
        assert f[:, 0] == pytest.approx(values[:7], rel=1e-9, abs=1e-14)
        assert g[:, 0] == pytest.approx(values[7:], rel=1e-9, abs=1e-14)


@laws
@given(state=states, time=times, rate=rates, seed=st.integers(0, 2**32 - 1))
def test_second_derivatives(
    model: FlightModel, state: tuple[float, ...], time: float, rate: float, seed: int
) -> None:
    # Fourth-order differences of the complex-step gradient.
    assume(away_from_kinks(model, state))
    point = scaled(state, time)
    weights = np.random.default_rng(seed).uniform(-1.0, 1.0, 10)

    step = 1e-3
    stencil = point[:, None, None] + step * np.eye(8)[:, :, None] * np.array([-2, -1, 1, 2])
    gradient = np.einsum("i,ij...->j...", weights, complex_step_jacobian(model, stencil, rate))
    near, far = gradient[..., 2] - gradient[..., 1], gradient[..., 3] - gradient[..., 0]
    differenced = (8.0 * near - far) / (12.0 * step)
    dynamics, numbers = traced(model)
    for (got,) in at(dynamics.second, numbers, point, rate, weights[:7], weights[7:]):
        assert got == pytest.approx(got.T, rel=1e-12, abs=1e-12 * np.abs(got).max())
        assert np.abs(got - differenced).max() < 1e-7 * max(1e-3, np.abs(got).max())


def test_control_enters_the_bank_row_alone(model: FlightModel) -> None:
    point = scaled((50e3, 0.1, 0.2, 4000.0, -0.1, 1.0, 0.3), 100.0)
    dynamics, numbers = traced(model)
    low, high = (at(dynamics.values, numbers, point, u) for u in (-1.0, 0.5))
    for (before, _), (after, _) in zip(low, high, strict=True):
        change = (after - before)[:, 0]
        assert change[6] == pytest.approx(1.5 * RATE_SCALE, rel=1e-14)
        assert np.all(change[:6] == 0.0)


def test_nodes_and_cases_do_not_touch_each_other(model: FlightModel) -> None:
    """A point is the same alone, among the nodes of a case, and among cases."""
    rng, shape = np.random.default_rng(2), (3, 5)
    nodes = np.array([50e3, 0.1, 0.2, 4000.0, -0.1, 1.0, 0.3]) / SCALE
    x = nodes[:, None, None] * rng.uniform(0.9, 1.1, (7, *shape))
    u, t = rng.uniform(-1.0, 1.0, shape), rng.uniform(100.0, 500.0, shape)
    mu, nu = rng.normal(size=(7, *shape)), rng.normal(size=(3, *shape))
    dynamics, numbers = traced(model)
    for function, weights in ((dynamics.first, ()), (dynamics.second, (mu, nu))):
        together = evaluated(function, numbers, x, u, t, *weights)
        for way, outputs in enumerate(together):
            for case, node in np.ndindex(*shape):
                one = np.s_[..., case : case + 1, node : node + 1]
                given = (x[one], u[one], t[one], *(w[one] for w in weights))
                alone = list(evaluated(function, numbers, *given))[way]
                for whole, part in zip(outputs, alone, strict=True):
                    if way == 0:
                        assert np.array_equal(whole[one], part)
                    else:
                        assert whole[one] == pytest.approx(part, rel=1e-13, abs=1e-14)
