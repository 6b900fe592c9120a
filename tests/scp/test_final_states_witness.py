"""Final states free, in ranges and fixed, and costs of them: our optima against IPOPT's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ampi.missions import Mission, load_mission
from ampi.missions.final_states import TargetMiss, final_states
from ampi.missions.sections import TARGET_WEIGHTS
from ampi.physics.state import ALTITUDE, BANK, LATITUDE, SPEED
from ampi.scp.guess import ConstantBank, constant_bank_guess
from ampi.scp.solve import optimum
from ampi.trajectory import Status
from tests.support.witness import nlp

pytestmark = pytest.mark.slow

ENDS: dict[str, tuple[dict[str, Any], dict[str, float]]] = {
    "ranges": (
        {
            "altitude_range": (22e3, 25e3),
            "speed_range": (590.0, 650.0),
            "bank_angle": (0.0, 0.0),
        },
        {"bank_rate_effort": 1e-2},
    ),
    "free, and fast": (
        {"free": ("speed", "latitude"), "altitude_range": (23e3, 24e3)},
        {"bank_rate_effort": 1e-2, "final_speed": -1e-3},
    ),
    "to the right": (
        {"position": "free", "flight_path_angle": (-0.5, -0.1)},
        {"bank_rate_effort": 1e-2, "cross_range": 1e-2},
    ),
}


def mission_of(ends: dict[str, Any], terms: dict[str, float]) -> Mission:
    """SHEFEX-3 with other ends, met exactly."""
    mission = load_mission("shefex3")
    objective = dict.fromkeys(TARGET_WEIGHTS) | terms
    return mission.model_copy(
        update={
            "target": mission.target.model_copy(update=ends),
            "objective": mission.objective.model_copy(update=objective),
        }
    ).checked()


@pytest.mark.parametrize("ends", ENDS)
def test_an_end_is_that_of_ipopt(ends: str) -> None:
    mission = mission_of(*ENDS[ends])
    guess = ConstantBank(np.radians(30.0))
    flown = constant_bank_guess(mission, guess)
    assert flown is not None
    ours = optimum(mission, guess=guess)
    witness = nlp(mission, flown, bank=ours.states[BANK])
    assert (ours.status, witness.status) == (Status.SOLVED, "Solve_Succeeded")
    assert ours.cost == pytest.approx(witness.cost, rel=1e-6)
    held = final_states(mission)
    for one in held:
        assert one.beyond(float(ours.states[one.state, -1])) == pytest.approx(0.0, abs=1e-2)
    assert TargetMiss.of(mission, ours.states[:, -1]).is_met
    if ends == "ranges":
        assert [one.state for one in held][-1] == BANK
        middle = [one.middle for one in held if one.state in (ALTITUDE, SPEED)]
        assert np.all(np.abs(ours.states[[ALTITUDE, SPEED], -1] - middle) > 1.0)
    if ends == "free, and fast":
        assert LATITUDE not in [one.state for one in held]
        assert ours.states[SPEED, -1] > 1.5 * mission.target.speed
