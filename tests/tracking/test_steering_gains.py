"""Gains of two controls: the least cost of the linear model, against its discretisation in numpy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.tracing.dynamics import Physics, node_dynamics
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracker_design.riccati_gains import (
    GainSettings,
    SteeringSettings,
    steering_gains,
    vertex_gains,
)
from ampi.tracker_design.second_control import angle_of_attack_effect
from ampi.trajectory import Trajectory
from tests.support.steered import steered_flight, steered_mission

Array = NDArray[np.float64]
SETTINGS = SteeringSettings()
STEP = 0.25  # s
SCALE = np.array([1e4, 1e-2, 1e-2, 1e2, 1e-2, 1e-2, 1e-2])  # sizes of errors: m, rad, m/s


@pytest.fixture(scope="module")
def steered() -> Mission:
    return steered_mission()


@pytest.fixture(scope="module")
def flight(steered: Mission) -> Trajectory:
    return steered_flight(steered)


def both(mission: Mission, flight: Trajectory, settings: SteeringSettings = SETTINGS) -> Array:
    """(14, n)."""
    at = (flight.mesh, flight.states[None], np.array([flight.final_time]))
    return steering_gains(MissionFamily.of([mission]), *at, settings)[0]


class Linear:
    """δx over steps of `STEP` along a flight: A and both columns of B by differences of the physics."""

    def __init__(self, mission: Mission, flight: Trajectory) -> None:
        self.flight, self.model = flight, mission.flight_model
        self.count = int(np.ceil(flight.final_time / STEP))
        self.dt = flight.final_time / self.count
        radius = self.model.planet.equatorial_radius
        states, _ = flight.at((np.arange(self.count) + 0.5) * self.dt)
        times = (np.arange(self.count) + 0.5) * self.dt
        self.a = np.zeros((self.count, 7, 7))
        for column in range(7):
            step = np.zeros((8, 1))
            step[column] = 1e-4 * SCALE[column]
            self.a[:, :, column] = self._slope(states, step, times) / step[column]
        step = np.zeros((8, 1))
        step[7] = 1e-5
        self.by_angle = self._slope(states, step, times) / 1e-5
        final, last = flight.states[:, -1], flight.final_time
        rate = np.array(equations_of_motion(self.model, final, 0.0, last), dtype=float)[:7]
        sizes = [SETTINGS.altitude_error, SETTINGS.horizontal_miss, SETTINGS.horizontal_miss]
        self.miss = np.zeros((3, 7))
        self.miss[:, :3] = np.eye(3)
        self.miss[:, 3] = -rate[:3] / rate[3]
        self.miss *= (np.array([1.0, radius * np.cos(final[2]), radius]) / sizes)[:, None]

    def _slope(self, states: Array, step: Array, times: Array) -> Array:
        up, down = (
            np.stack(equations_of_motion(self.model, x, np.zeros_like(times), times)[:7], axis=1)
            for x in (states + step, states - step)
        )
        return 0.5 * (up - down)

    def gains(self) -> Array:
        """K of every step (count, 2, 7) by dynamic programming."""
        last = self.flight.final_time
        sizes = np.array([SETTINGS.bank_rate, SETTINGS.angle_of_attack_change])
        cost, found = self.miss.T @ self.miss, np.zeros((self.count, 2, 7))
        running = np.zeros((7, 7))
        running[6, 6] = 1.0 / (SETTINGS.bank_deviation**2 * last)
        for k in reversed(range(self.count)):
            b = np.stack([np.eye(7)[6], self.by_angle[k]], axis=1)
            to_go = last - (k + 0.5) * self.dt
            late = np.array([0.0, (SETTINGS.last_seconds / to_go) ** 2])
            # the midpoint rule, the control held over the step
            half = 0.5 * self.dt * self.a[k]
            phi = np.eye(7) + 2.0 * half + 2.0 * half @ half
            gamma = self.dt * (b + half @ b)
            r = self.dt * np.diag((1.0 + late) / (sizes**2 * last))
            gain = np.linalg.solve(r + gamma.T @ cost @ gamma, gamma.T @ cost @ phi)
            cost = self.dt * running + phi.T @ cost @ (phi - gamma @ gain)
            cost = 0.5 * (cost + cost.T)
            found[k] = gain
        return found

    def final_miss(self, gains: Array, error: Array) -> float:
        """Acceptable misses at the end of a flight that begins with `error` (7,) under its gains."""
        x = error
        for k in range(self.count):
            u = -gains[k] @ x
            pushed = u[0] * np.eye(7)[6] + u[1] * self.by_angle[k]
            x_middle = x + 0.5 * self.dt * (self.a[k] @ x + pushed)
            x = x + self.dt * (self.a[k] @ x_middle + pushed)
        return float(np.linalg.norm(self.miss @ x))

    def sampled(self, gains: Array) -> Array:
        """Gains at the nodes (14, n) at the middle of every step, (count, 2, 7)."""
        matrix = self.flight.mesh.conversion(
            (np.arange(self.count) + 0.5) * self.dt, self.flight.final_time
        )
        return (gains @ matrix.T).T.reshape(self.count, 2, 7)


@pytest.fixture(scope="module")
def linear(steered: Mission, flight: Trajectory) -> Linear:
    return Linear(steered, flight)


def test_they_are_those_of_dynamic_programming(
    steered: Mission, flight: Trajectory, linear: Linear
) -> None:
    """At the nodes, before the last seconds, in which a step of the witness is no small one."""
    found, witness = both(steered, flight), linear.gains()
    early = np.flatnonzero(flight.times < flight.final_time - 15.0)
    step = np.clip((flight.times[early] / linear.dt).astype(int), 0, linear.count - 1)
    expected = witness[step].reshape(len(step), 14).T
    size = np.abs(expected).max(axis=1, keepdims=True)
    assert np.all(np.abs(found[:, early] - expected) < 0.05 * size)


def test_the_linear_flight_misses_by_less_with_both(
    steered: Mission, flight: Trajectory, linear: Linear
) -> None:
    at = (flight.mesh, flight.states[None], np.array([flight.final_time]))
    alone = vertex_gains(MissionFamily.of([steered]), *at, GainSettings())[0]
    alone = np.concatenate([alone, np.zeros_like(alone)])
    for error in np.diag(SCALE[:6] * [0.05, 0.1, 0.1, 0.1, 0.1, 0.1]):
        start = np.append(error, 0.0)
        one, two = (
            linear.final_miss(linear.sampled(gains), start)
            for gains in (alone, both(steered, flight))
        )
        free = linear.final_miss(np.zeros((linear.count, 2, 7)), start)
        assert two < one < free


def test_an_angle_that_may_not_change_leaves_the_bank_alone(
    steered: Mission, flight: Trajectory
) -> None:
    at = (flight.mesh, flight.states[None], np.array([flight.final_time]))
    alone = vertex_gains(MissionFamily.of([steered]), *at, GainSettings())[0]
    dear = both(steered, flight, SteeringSettings(angle_of_attack_change=1e-9))
    assert dear[:7] == pytest.approx(alone, rel=1e-9, abs=1e-12 * np.abs(alone).max())
    assert np.abs(dear[7:] * SCALE[:, None]).max() < 1e-9


def test_what_the_angle_does_is_the_column_of_the_jacobian(
    steered: Mission, flight: Trajectory
) -> None:
    """Of the traced equations, where it is a state; of a schedule, the same column at its angles."""
    family, final_time = MissionFamily.of([steered]), np.array([flight.final_time])
    effect = angle_of_attack_effect(family, flight.mesh, flight.states[None], final_time)[0]
    physics = Physics.of(family.flight_model(), NodeFunctions(), 1.0)
    function = node_dynamics(physics.structure, (1.0,) * 8).jacobian
    x, still = np.ascontiguousarray(flight.states[:, None]), np.zeros((2, 1, flight.mesh.n_nodes))
    (found,) = function.together(x, still, flight.times[None], physics.numbers)
    column = {i: v[0] for (i, j), v in zip(function.nonzeros[0], found, strict=True) if j == 7}
    assert sorted(column) == [3, 4, 5]
    for row, values in column.items():
        assert effect[:, row] == pytest.approx(values, rel=1e-12, abs=1e-15)


def test_a_schedule_has_them_too(mission: Mission, nominal: Trajectory, gains: Array) -> None:
    """The same bank rates as ever for the bank alone; others for both, and smaller at the end."""
    found = both(mission, nominal)
    assert found.shape == (14, nominal.mesh.n_nodes)
    assert np.abs(found[3, -8:]).max() < np.abs(gains[3, -8:]).max()
    assert np.all(np.abs(found[10, 20:-1]) > 0.0)
    assert np.all(found[:, -1] == 0.0)
