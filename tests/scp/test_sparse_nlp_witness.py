"""The literature's methods over time end at the optima of their transcriptions, as IPOPT finds them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.missions import load_mission
from ampi.scp.literature.methods import METHODS, Solution, solve_by
from ampi.scp.literature.starts import Start, straight_line
from ampi.scp.literature.subproblem_builder import StateTrustRegion
from ampi.scp.literature.successive import StateChange
from ampi.trajectory import Status
from tests.support.missions import SCALE
from tests.support.sparse_witness import Optimum, Transcription, witness

pytestmark = pytest.mark.slow

RADAU_WITH_MARGIN = Transcription(radau=True, limit_margin=METHODS["liu2024"].limit_margin)
CASES = {
    "wang2020_scp": ("cavh_wang2020", Transcription(radau=False)),
    "wang2020": ("cavh_wang2020", Transcription(radau=True)),
    "liu2024": ("rlv_liu2024", RADAU_WITH_MARGIN),
    "liu2024_hp": ("rlv_liu2024", RADAU_WITH_MARGIN),
}
ZHOU = Transcription(radau=False, per_second=True, final_bounds=METHODS["zhou2021"].final_bounds)


def assert_the_same(solution: Solution, optimum: Optimum, tolerance: StateChange) -> None:
    """The objective to 1e-4, the states to the tolerance at which the method stopped."""
    assert solution.trajectory.status is Status.SOLVED
    assert optimum.status == "Solve_Succeeded"
    assert solution.trajectory.cost == pytest.approx(optimum.cost, rel=1e-4)
    assert solution.iterate.final == pytest.approx(optimum.final_time, rel=1e-4)
    error = np.abs(solution.iterate.states * SCALE - optimum.states).max(axis=0)
    assert np.all(error <= tolerance.tolerance[: len(error)])


@pytest.mark.parametrize("name", CASES)
def test_the_method_ends_at_an_optimum_of_its_transcription(name: str) -> None:
    mission, asked = load_mission(CASES[name][0]), CASES[name][1]
    method, tolerance = METHODS[name], METHODS[name].convergence
    assert isinstance(tolerance, StateChange)
    if name == "wang2020_scp":  # its last steps shrink slowly: one is no bound on what is left
        finer = StateChange(tuple(0.1 * t for t in tolerance.tolerance))
        method = replace(method, convergence=finer, max_iterations=80)
    solution = solve_by(mission, method)
    assert solution is not None
    assert_the_same(solution, witness(mission, asked, solution.iterate), tolerance)


@pytest.fixture(scope="module")
def as_printed() -> Solution:
    """Zhou's method on 101 points."""
    method = replace(METHODS["zhou2021_fixed"], start=straight_line(101, 1700.0))
    found = solve_by(load_mission("cavh_zhou2021"), method)
    assert found is not None
    return found


def test_a_fixed_trust_region_leads_zhou_to_the_optimum_of_the_trapezoid(
    as_printed: Solution,
) -> None:
    region = StateTrustRegion(METHODS["zhou2021"].trust_region.radius)
    tight = StateChange((5.0, 1e-5, 1e-5, 0.2, 1e-5, 1e-4, 1e-3))
    method = replace(
        METHODS["zhou2021_fixed"],
        start=lambda mission: Start(as_printed.formulation, as_printed.iterate),
        trust_region=region,
        convergence=tight,
    )
    mission = load_mission("cavh_zhou2021")
    solution = solve_by(mission, method)
    assert solution is not None
    assert_the_same(solution, witness(mission, ZHOU, solution.iterate), tight)


def test_the_price_of_its_trust_region_stops_zhou_short_of_an_optimum(
    as_printed: Solution,
) -> None:
    # c_η η is an exact penalty on the step: a step that gains less than it costs is not taken
    optimum = witness(load_mission("cavh_zhou2021"), ZHOU, as_printed.iterate)
    assert optimum.status == "Solve_Succeeded"
    assert as_printed.trajectory.status is Status.SOLVED
    assert as_printed.trajectory.cost > 2.0 * optimum.cost
