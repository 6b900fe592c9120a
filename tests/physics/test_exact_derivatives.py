"""CasADi's derivatives of the physics against complex steps through the numpy source."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.tracing.derivatives import ScaledDynamics
from ampi.tracing.node_functions import NodeFunctions

Array = NDArray[np.float64]
laws = settings(deadline=None, max_examples=60)

SCALE = np.array([1e4, 1.0, 1.0, 1e3, 1.0, 1.0, 1.0])
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
def traced(model: FlightModel) -> ScaledDynamics:
    """CasADi functions of one node."""
    return ScaledDynamics(
        model, NodeFunctions(limits=PathLimits(loads=LIMITS)), tuple(SCALE), RATE_SCALE, 1
    )


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


def source(model: FlightModel, point: Array, rate: complex) -> Array:
    """f (7) and g (3) of a scaled point (x, t), through numpy."""
    physical = [point[i] * SCALE[i] for i in range(7)]
    f = equations_of_motion(model, physical, rate * RATE_SCALE, point[7])
    g = path_constraints(model, physical, point[7])
    return np.concatenate([np.array(f) / SCALE, np.array(g) / LIMITS])


def complex_step_jacobian(model: FlightModel, point: Array, rate: float) -> Array:
    """∂(f, g)/∂(x, t), (10, 8)."""
    columns = []
    for k in range(8):
        shifted = point.astype(complex)
        shifted[k] += 1e-20j
        columns.append(source(model, shifted, rate).imag / 1e-20)
    return np.stack(columns, axis=-1)


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
    got = traced(model).first(point[None, :7], np.array([rate]), np.array([time]))
    assert got.rates[0] == pytest.approx(values[:7], rel=1e-9, abs=1e-14)
    assert got.path[0] == pytest.approx(values[7:], rel=1e-9, abs=1e-14)
    jacobian = np.vstack(
        [np.column_stack([got.state_jacobian[0], got.time_derivative[0]]), got.path_jacobian[0]]
    )
    size = np.abs(exact).max(axis=1, keepdims=True)
    assert np.all(np.abs(jacobian - exact) <= 1e-9 * np.abs(exact) + 1e-11 * size)


@laws
@given(state=states, time=times, rate=rates)
def test_values_without_derivatives(
    model: FlightModel, state: tuple[float, ...], time: float, rate: float
) -> None:
    point = scaled(state, time)
    values = source(model, point, rate)
    f, g = traced(model).values(point[None, :7], np.array([rate]), np.array([time]))
    assert f[0] == pytest.approx(values[:7], rel=1e-9, abs=1e-14)
    assert g[0] == pytest.approx(values[7:], rel=1e-9, abs=1e-14)


@laws
@given(state=states, time=times, rate=rates, seed=st.integers(0, 2**32 - 1))
def test_second_derivatives(
    model: FlightModel, state: tuple[float, ...], time: float, rate: float, seed: int
) -> None:
    # Fourth-order differences of the complex-step gradient.
    assume(away_from_kinks(model, state))
    point = scaled(state, time)
    weights = np.random.default_rng(seed).uniform(-1.0, 1.0, 10)

    def gradient(at: Array) -> Array:
        return weights @ complex_step_jacobian(model, at, rate)

    step = 1e-3
    columns = []
    for k in range(8):
        e = np.zeros(8)
        e[k] = step
        near = gradient(point + e) - gradient(point - e)
        far = gradient(point + 2.0 * e) - gradient(point - 2.0 * e)
        columns.append((8.0 * near - far) / (12.0 * step))
    differenced = np.stack(columns, axis=-1)
    got = traced(model).hessian(
        point[None, :7], np.array([rate]), np.array([time]), weights[None, :7], weights[None, 7:]
    )[0]
    assert got == pytest.approx(got.T, rel=1e-12, abs=1e-12 * np.abs(got).max())
    assert np.abs(got - differenced).max() < 1e-7 * max(1e-3, np.abs(got).max())


def test_control_enters_the_bank_row_alone(model: FlightModel) -> None:
    point = scaled((50e3, 0.1, 0.2, 4000.0, -0.1, 1.0, 0.3), 100.0)
    rows = [
        traced(model).values(point[None, :7], np.array([u]), np.array([100.0]))[0][0].copy()
        for u in (-1.0, 0.5)
    ]
    change = rows[1] - rows[0]
    assert change[6] == pytest.approx(1.5 * RATE_SCALE, rel=1e-14)
    assert np.all(change[:6] == 0.0)


def test_nodes_do_not_touch_each_other(model: FlightModel) -> None:
    rng = np.random.default_rng(2)
    nodes = np.array([50e3, 0.1, 0.2, 4000.0, -0.1, 1.0, 0.3]) / SCALE
    x = nodes * rng.uniform(0.9, 1.1, (5, 7))
    u, t = rng.uniform(-1.0, 1.0, 5), rng.uniform(100.0, 500.0, 5)
    mu, nu = rng.normal(size=(5, 7)), rng.normal(size=(5, 3))
    together = ScaledDynamics(
        model, NodeFunctions(limits=PathLimits(loads=LIMITS)), tuple(SCALE), RATE_SCALE, 5
    )
    first, second = together.first(x, u, t), together.hessian(x, u, t, mu, nu).copy()
    for k in range(5):
        one = slice(k, k + 1)
        alone = traced(model).first(x[one], u[one], t[one])
        assert first.state_jacobian[k] == pytest.approx(alone.state_jacobian[0], rel=1e-13)
        assert first.path_jacobian[k] == pytest.approx(alone.path_jacobian[0], rel=1e-13)
        assert first.time_derivative[k] == pytest.approx(alone.time_derivative[0], rel=1e-13)
        hessian = traced(model).hessian(x[one], u[one], t[one], mu[one], nu[one])
        assert second[k] == pytest.approx(hessian[0], rel=1e-12, abs=1e-14)
