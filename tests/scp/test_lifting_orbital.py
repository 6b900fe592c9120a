"""A family of optima on their heat-flux limit, held through Newton's steps; IPOPT is the witness."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from ampi.missions.family import MissionFamily
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.scp.guess import from_trajectory
from ampi.scp.solve import optimum, solve_family
from ampi.trajectory import Status, Trajectory
from tests.support.witness import nlp

pytestmark = pytest.mark.slow

SAMPLE = 20


@pytest.fixture(scope="module")
def family() -> MissionFamily[Mission]:
    mission = load_mission("lifting_orbital")
    return mission.family(np.array(list(product(*mission.grid_axes))))


@pytest.fixture(scope="module")
def optima(family: MissionFamily[Mission]) -> list[Trajectory | None]:
    """All cases from the nominal optimum, in one go."""
    nominal = optimum(family.mission)
    assert nominal.status is Status.SOLVED
    return solve_family(family, [nominal] * len(family))


def heat_flux(mission: Mission, flown: Trajectory) -> np.ndarray:
    limits = PathLimits.of(mission)
    use = limits.use(mission.flight_model, flown.states, flown.bank_rate, flown.times)
    return np.asarray(use[limits.names.index("heat_flux")])


def test_most_cases_are_solved_together_with_the_limit_held(
    family: MissionFamily[Mission], optima: list[Trajectory | None]
) -> None:
    solved = [(k, flown) for k, flown in enumerate(optima) if flown is not None]
    assert len(solved) >= 0.8 * len(family)
    share = family.mission.limits.share("heat_flux")
    for case, flown in solved:
        use = heat_flux(family.member(case), flown)
        assert flown.status is Status.SOLVED
        assert use.max() <= share * (1.0 + 1e-6)
        assert np.count_nonzero(use > share * (1.0 - 1e-6)) >= 2


def test_ipopt_finds_the_same_optima(
    family: MissionFamily[Mission], optima: list[Trajectory | None]
) -> None:
    solved = [k for k, flown in enumerate(optima) if flown is not None]
    for case in np.random.default_rng(15).choice(solved, SAMPLE, replace=False):
        mission, ours = family.member(int(case)), optima[case]
        assert ours is not None
        designed = {"heat_flux": mission.limits.designed("heat_flux"), "heat_flux_margin": 0.0}
        limits = mission.limits.model_copy(update=designed)
        without_margin = mission.model_copy(update={"limits": limits})
        guess = from_trajectory(ours, mission)
        witness = nlp(without_margin, guess, near=True, bank=ours.states[6])
        assert witness.status == "Solve_Succeeded"
        assert ours.cost == pytest.approx(witness.cost, rel=1e-6)
