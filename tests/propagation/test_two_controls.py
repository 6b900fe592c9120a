"""A flight under two controls flown again, against plain integration, and what it says of limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.state import ANGLE_OF_ATTACK, BANK, SPEED
from ampi.propagation.adaptive_step import Accuracy
from ampi.propagation.bank_profile import fly_to_speed
from ampi.propagation.reintegration import flight_checks, reintegrate, reintegrate_many
from ampi.propagation.segment_flight import fly_segment
from ampi.trajectory import Trajectory
from tests.support.steered import steered_flight, steered_mission


@pytest.fixture(scope="module")
def mission() -> Mission:
    return steered_mission()


@pytest.fixture(scope="module")
def flight(mission: Mission) -> Trajectory:
    return steered_flight(mission)


def test_a_true_flight_is_found_true(mission: Mission, flight: Trajectory) -> None:
    """One after the other and all together; the witness is plain DOP853 under both polynomials."""
    check = reintegrate(mission, flight)
    assert check.position_error[0] < 5e-3
    assert check.speed_error[0] < 1e-4
    many = reintegrate_many(
        MissionFamily.of([mission] * 200),
        flight.mesh,
        np.repeat(flight.states[None], 200, axis=0),
        np.full(200, flight.final_time),
    )
    assert many.states[7] == pytest.approx(check.states[0], rel=1e-9)
    assert np.array_equal(
        many.fine_states[0, ANGLE_OF_ATTACK], check.fine_states[0, ANGLE_OF_ATTACK]
    )


def test_an_angle_of_attack_that_was_not_flown_is_found_out(
    mission: Mission, flight: Trajectory
) -> None:
    states = flight.states.copy()
    states[ANGLE_OF_ATTACK] += np.radians(0.1)
    assert reintegrate(mission, replace(flight, states=states)).position_error[0] > 500.0


def test_limits_of_the_angle_are_read_between_the_nodes(
    mission: Mission, flight: Trajectory
) -> None:
    """A polynomial that keeps its bounds and its rate at the nodes alone."""
    segment = flight.mesh.segments[3]
    states = flight.states.copy()
    states[ANGLE_OF_ATTACK, segment.nodes] = np.radians(26.0 + 15.9 * np.cos(np.pi * np.arange(15)))
    assert np.degrees(states[ANGLE_OF_ATTACK]).max() < 42.0
    family, final_time = MissionFamily.of([mission]), np.array([flight.final_time])
    (check,) = flight_checks(family, flight.mesh, states[None], final_time)
    assert set(check.use) == set(PathLimits.of(mission).names)
    assert {"angle_of_attack", "angle_of_attack_rate"} <= set(check.exceeded)
    (check,) = flight_checks(family, flight.mesh, flight.states[None], final_time)
    rate = np.abs(flight.angle_of_attack_rate).max() / np.radians(5.0)
    assert check.use["angle_of_attack_rate"] == pytest.approx(rate, rel=0.01)


def test_segments_and_profiles_are_flown_under_both_angles(
    mission: Mission, flight: Trajectory
) -> None:
    model, final_time = mission.flight_model, np.array([flight.final_time])
    segment, accuracy = flight.mesh.segments[4], Accuracy(relative=1e-9)
    nodal = flight.states[:, segment.nodes]
    flown = fly_segment(
        model, segment, nodal[BANK:, None], nodal[None, :BANK, 0], final_time, 5.0, accuracy
    )
    assert flown.states[0][:, flown.at_nodes] == pytest.approx(nodal, rel=1e-7, abs=1e-8)
    assert flown.rates[1, 0, flown.at_nodes][1:] == pytest.approx(
        flight.angle_of_attack_rate[segment.nodes][1:], rel=1e-6, abs=1e-9
    )
    speed, entry = flight.states[SPEED, -1] + 1.0, flight.states[:BANK, 0][None]
    angles = flight.states[BANK:][None]
    end = fly_to_speed(model, flight.mesh, angles, entry, final_time, np.array([speed]), 10.0)
    assert end[0, SPEED] == pytest.approx(speed, abs=1e-6)
    assert end[0, :3] == pytest.approx(flight.states[:3, -1], rel=2e-2)
    others = angles - [[[0.0], [np.radians(2.0)]]]
    lower = fly_to_speed(model, flight.mesh, others, entry, final_time, np.array([speed]), 60.0)
    assert abs(lower[0, 1] - end[0, 1]) > 1e-3  # rad


def test_rates_at_the_nodes_are_those_of_the_polynomials(flight: Trajectory) -> None:
    """Of a cubic on every segment exactly; a node between two has that of the one that ends there."""
    times = flight.times
    matrix = flight.mesh.derivative(flight.final_time)
    assert matrix @ times**3 == pytest.approx(3.0 * times**2, rel=1e-9, abs=1e-3)
    kink = np.maximum(times, flight.mesh.segments[2].start[0])
    at = flight.mesh.segments[2].nodes
    assert (matrix @ kink)[at.start] == pytest.approx(0.0, abs=1e-9)
    assert (matrix @ kink)[at.start + 1] == pytest.approx(1.0)
