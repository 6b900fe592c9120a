"""A limit of the vehicle as a parameter: what flies keeps its own limit, not the nominal one."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import ampi
import database
from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from tests.support.missions import text_on_grid
from tests.support.references import asking
from tests.support.worlds import of_entries

DEGREE = np.pi / 180.0
LATITUDE, LIMIT = 0, 1  # places in p
GRID = """[grid]
latitude_deg = [-0.5, 0.0, 0.5]
limits.bank_angle_deg = [-2.0, 0.0, 20.0]
"""


@pytest.fixture(scope="module")
def mission() -> Mission:
    text = text_on_grid(GRID)
    return parse_mission(text.replace("bank_angle_deg = 60.0", "bank_angle_deg = 45.0"))


@pytest.fixture(scope="module")
def guidance(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Guidance:
    path = tmp_path_factory.mktemp("limits") / "limits.h5"
    assert database.build(mission, path, n_jobs=2).failures == ()
    return load_guidance(path)


def at(mission: Mission, latitude: float, limit: float) -> np.ndarray:
    return mission.nominal_parameters + np.array([latitude, limit]) * DEGREE


def test_limits_are_what_was_measured(mission: Mission, guidance: Guidance) -> None:
    assert guidance.limits.angle == pytest.approx(45.0 * DEGREE)
    for g in (guidance, pickle.loads(pickle.dumps(guidance)), guidance.in_mode(ampi.Mode.MPI)):
        own = g.limits_at(at(mission, 0.0, 20.0))
        assert float(own.angle) == pytest.approx(65.0 * DEGREE)
        assert (own.rate, own.acceleration) == (guidance.limits.rate, guidance.limits.acceleration)
    many = guidance.limits_at(np.array([at(mission, 0.0, 3.0), at(mission, 0.1, -1.0)]))
    assert np.asarray(many.angle) / DEGREE == pytest.approx([48.0, 44.0])


@pytest.mark.parametrize("fault", [np.nan, np.inf, -0.1, 0.0])
def test_a_limit_that_is_none_is_the_nominal_one(
    mission: Mission, guidance: Guidance, fault: float
) -> None:
    p = mission.nominal_parameters
    p[LIMIT] = fault
    assert float(guidance.limits_at(p).angle) == guidance.limits.angle


def test_flights_bank_to_their_own_limit(mission: Mission, guidance: Guidance) -> None:
    flights = ampi.fly(mission, guidance, of_entries("corners"), n=60, n_jobs=1, cycle=0.5)
    flown = np.nanmax(np.abs(flights.states[:, 6]), axis=1)
    own = flights.parameters[:, LIMIT]
    assert np.all(flown <= own * (1.0 + 1e-9))
    assert np.any(flown > 45.5 * DEGREE)  # those that may, do
    assert np.any(own < 45.0 * DEGREE)
    assert flights.miss.max() < 50.0
    # one that flies at its limit has nothing left to steer with; cut at 45° instead of 65°: 600 m
    assert np.abs(flights.altitude_error).max() < 20.0


def test_the_onboard_command_keeps_it_too(mission: Mission, guidance: Guidance) -> None:
    """A bank angle that asks for more than the limit: the command stops at the limit of this p."""
    for offset in (-2.0, 20.0):
        limit = (45.0 + offset) * DEGREE
        eager = asking(guidance.reference(at(mission, 0.0, offset)), 1.0)
        state = eager.states[:, 0].copy()
        state[6], rate = limit - 10.0 * DEGREE, 0.0
        greatest = 0.0
        guidance.follow(eager)
        for k in range(80):
            command = guidance.step(0.5 * k, [*state, rate])
            rate, state[6] = command.bank_rate, command.bank_angle
            greatest = max(greatest, state[6])
        assert greatest == pytest.approx(limit, abs=1e-3 * DEGREE)
