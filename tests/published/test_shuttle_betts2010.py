"""The Space Shuttle's greatest cross-range by two controls: Betts (2010), Section 6.1.

Both printed optima, through the mission file and `ampi.solve`, and the same transcription by IPOPT,
which starts from the mission's own guess, too.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest

from ampi.missions import Mission
from ampi.missions.path_limits import PathLimits
from ampi.papers.betts2010 import CASES, WITHIN, betts2010, betts2010_case
from ampi.papers.figures import FIGURES
from ampi.papers.table import Reproduction
from ampi.physics.state import ALTITUDE, FLIGHT_PATH_ANGLE, LATITUDE, SPEED
from ampi.scp.guess import ConstantBank, constant_bank_guess, default_guess
from ampi.trajectory import Status, Trajectory
from tests.support.witness import Optimum, nlp

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Case:
    printed: float  # degrees
    mission: Mission
    ours: Trajectory


@pytest.fixture(scope="module")
def found() -> Reproduction:
    return betts2010()


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest, found: Reproduction) -> Case:
    return Case(CASES[request.param], betts2010_case(request.param), found.ours[request.param])


@pytest.fixture(scope="module")
def witness(case: Case) -> Optimum:
    begin = default_guess(case.mission)
    assert isinstance(begin, ConstantBank)
    flown = constant_bank_guess(case.mission, begin)
    assert flown is not None
    return nlp(case.mission, flown)


def test_the_table_of_ampi_reproduce(found: Reproduction) -> None:
    assert found.holds
    again = json.loads(json.dumps(found.as_dict(), default=float))
    assert [row["holds"] for row in again["rows"]] == [True, None, True] * 2
    figure = FIGURES["betts2010"](found)
    assert len(figure.axes) == 4
    assert all(axes.get_xlabel() and axes.get_ylabel() for axes in figure.axes)


def test_the_final_latitude_is_the_printed_one(case: Case) -> None:
    assert case.ours.status is Status.SOLVED
    assert np.degrees(case.ours.states[LATITUDE, -1]) == pytest.approx(case.printed, abs=WITHIN)


def test_the_flight_ends_where_it_is_asked_to(case: Case) -> None:
    target, final = case.mission.target, case.ours.states[:, -1]
    assert final[ALTITUDE] == pytest.approx(target.altitude, abs=1e-3)
    assert final[SPEED] == pytest.approx(target.speed, abs=1e-4)
    assert np.degrees(final[FLIGHT_PATH_ANGLE]) == pytest.approx(-5.0, abs=1e-6)


def test_ipopt_finds_the_same(case: Case, witness: Optimum) -> None:
    assert witness.status == "Solve_Succeeded"
    assert case.ours.cost == pytest.approx(witness.cost, rel=1e-6)
    latitudes = [np.degrees(one.states[LATITUDE, -1]) for one in (case.ours, witness)]
    assert latitudes[0] == pytest.approx(latitudes[1], abs=1e-4)


def test_the_heating_limit_alone_binds(case: Case) -> None:
    """Neither the rates nor any other limit that Betts has not."""
    flight = case.ours.statistics.flight
    assert flight is not None
    assert list(flight.use) == list(PathLimits.of(case.mission).names)
    use = dict(flight.use)
    heat = use.pop("heat_flux")
    assert max(use.values()) < 0.9
    assert heat < 0.1 or heat == pytest.approx(1.0, abs=1e-3)
