"""Before the entry: a reference that is interpolated ends aside of the target, polished it does not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import ampi
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard.health import Health
from ampi.onboard.reference import NodalReference
from ampi.onboard.row_layout import LINEAR_TRACKING, RowKind
from ampi.physics.state import BANK
from ampi.replanning.front_door import replan
from ampi.replanning.outcome import ReplanOutcome
from ampi.scp.solve import optimum
from ampi.simulation.certificate_truth import flown_miss

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def mission() -> Mission:
    return ampi.load_mission("shefex3")


@pytest.fixture(scope="module")
def interpolated(mission: Mission) -> NodalReference:
    """Half way between the optima of two entries."""
    away = np.array([0.0, 0.005, 0.0, 60.0, 0.006, 0.0])
    ends = [optimum(mission.with_entry(mission.entry_state + side * away)) for side in (-1, 1)]
    states = 0.5 * (ends[0].states + ends[1].states)
    rate = 0.5 * (ends[0].bank_rate + ends[1].bank_rate)
    parts = {
        RowKind.STATE: states,
        RowKind.CONTROL: rate[None],
        RowKind.GAIN: np.zeros_like(states),
    }
    return NodalReference(
        nodal=LINEAR_TRACKING.stacked(parts),
        layout=LINEAR_TRACKING,
        final_time=0.5 * (ends[0].final_time + ends[1].final_time),
        cell=(0,) * 6,
        clipped=(False,) * 6,
        excess=(0.0,) * 6,
        hole=False,
        parameters=tuple(mission.entry_state.tolist()),
        health=Health.GOOD,
    )


def miss(mission: Mission, bank: Array, final_time: float) -> float:
    family = MissionFamily.of([mission])
    return float(np.linalg.norm(flown_miss(family, bank[None], np.array([final_time]))))


def test_a_polished_reference_ends_on_the_target(
    mission: Mission, interpolated: NodalReference
) -> None:
    found = replan(mission, mission.entry_state, interpolated, time=0.0)
    assert found.status is ReplanOutcome.REPLANNED and found.trajectory is not None
    assert miss(mission, interpolated.nodal[BANK], interpolated.final_time) > 300.0
    assert miss(mission, found.trajectory.states[BANK], found.trajectory.final_time) < 30.0


def test_a_reference_is_left_as_it_was(mission: Mission, interpolated: NodalReference) -> None:
    before = interpolated.nodal.copy()
    away = np.array([100.0, 0.0, 0.0, 10.0, 0.0, 0.0])
    replan(mission, mission.entry_state + away, interpolated, time=0.0)
    np.testing.assert_array_equal(interpolated.nodal, before)


def test_a_reference_of_another_table_is_told(
    mission: Mission, interpolated: NodalReference
) -> None:
    other = ampi.load_mission("lifting_orbital")
    found = replan(other, other.entry_state, interpolated, time=0.0)
    assert found.status is ReplanOutcome.ANOTHER_PLAN
