"""The literature's methods over time with a second control, the rate of the angle of attack.

The optima are those that IPOPT finds of the same transcription; DOP853 flies them again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.missions import Mission
from ampi.missions.loading import parse_mission
from ampi.physics.state import ANGLE_OF_ATTACK, BANK
from ampi.propagation.reintegration import flown_again
from ampi.scp.literature.methods import METHODS, Solution, solve_by
from ampi.scp.literature.starts import flown, straight_line, uniform
from ampi.scp.literature.successive import StateChange
from ampi.scp.literature.time_domain import TimeDomain
from ampi.trajectory import Status
from tests.support.missions import steered_reentry
from tests.support.sparse_witness import Transcription, witness
from tests.support.witness import scale_of

TIGHT = StateChange((5.0, 1e-5, 1e-5, 0.2, 1e-5, 1e-4, 1e-3, 1e-3))
RADAU = replace(
    METHODS["wang2020"],
    start=flown(uniform(6, 6)),
    trust_region=METHODS["liu2024"].trust_region,
    convergence=TIGHT,
)
GIVEN = {
    "bank_angle_deg": -5.0,
    "bank_rate_deg_per_s": 0.02,
    "angle_of_attack_deg": 35.0,
    "angle_of_attack_rate_deg_per_s": 0.05,
}
BY_SPEED = {"lower_deg": [12.0, 25.0], "upper_deg": [20.0, 45.0], "over": '"speed"'} | {
    "at": [1500.0, 5000.0]
}
FREE = {"position": '"free"', "speed_range_m_per_s": [900.0, 1100.0]}
CASES = {
    "given at the entry": steered_reentry(entry=GIVEN),
    "bounds over speed": steered_reentry(angle_of_attack=BY_SPEED),
    "final state": steered_reentry(
        target=FREE, objective={"cross_range": 0.01, "final_speed": 0.01}
    ),
}


def solved(mission: Mission) -> Solution:
    found = solve_by(mission, RADAU)
    assert found is not None
    return found


@pytest.mark.parametrize("mission", CASES.values(), ids=CASES)
def test_the_optimum_is_that_of_the_transcription(mission: Mission) -> None:
    solution = solved(mission)
    optimum = witness(mission, Transcription(radau=True), solution.iterate)
    assert solution.trajectory.status is Status.SOLVED
    assert optimum.status in ("Solve_Succeeded", "Error_In_Step_Computation"), optimum.status
    assert solution.trajectory.cost == pytest.approx(optimum.cost, rel=1e-5)
    error = np.abs(solution.iterate.states * scale_of(mission) - optimum.states).max(axis=0)
    print(error, solution.trajectory.cost/optimum.cost-1)
