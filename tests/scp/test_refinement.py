"""Mesh refinement: the estimate, the rule for the next mesh, the caps, and a mission refined."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from ampi.missions import Mission
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import LOADS
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.guess import ConstantBank
from ampi.scp.refinement import RefinementSettings, mesh_error, refine, refined_mesh
from ampi.scp.solve import optimum, solve
from ampi.trajectory import Status, Trajectory

GUESS = ConstantBank(np.radians(-30.0))
LOOSE = RefinementSettings(tolerance=1e-5)
MESH = Mesh(
    (Phase((5, 8), 58.0), Phase((8,), 88.0), Phase((10, 12, 6), None, (0.0, 0.2, 0.7, 1.0)))
)


def on_coarse_mesh(mission: Mission) -> Mission:
    """SHEFEX-3 with a last phase that is too coarse."""
    first, second = mission.pseudospectral_mesh.phases[:2]
    return mission.with_mesh(Mesh((first, second, Phase((8, 8, 8)))))


@pytest.fixture(scope="module")
def coarse(mission: Mission) -> Trajectory:
    return optimum(on_coarse_mesh(mission), guess=GUESS)


def test_the_error_is_small_on_a_fine_mesh_and_large_on_a_coarse_one(
    mission: Mission, nominal: Trajectory, coarse: Trajectory
) -> None:
    fine, rough = mesh_error(mission, nominal, LOOSE), mesh_error(mission, coarse, LOOSE)
    assert len(fine.state) == len(nominal.mesh.segments)
    assert fine.state.max() < 5e-4 < rough.state.max()
    assert np.all(rough.ratio(LOOSE) >= rough.state / LOOSE.tolerance)


def test_a_peak_between_the_nodes_is_seen(mission: Mission, nominal: Trajectory) -> None:
    # Every limit at its nodal peak: between the nodes one of them is exceeded, by little.
    nodal = path_constraints(mission.flight_model, nominal.states, nominal.times)
    peaks = {name: float(value.max()) for name, value in zip(LOADS, nodal, strict=True)}
    tight = mission.model_copy(update={"limits": mission.limits.model_copy(update=peaks)})
    assert 0.0 < mesh_error(tight, nominal, LOOSE).excess.max() < 0.02
    assert mesh_error(mission, nominal, LOOSE).excess.max() < 0.0


@hypothesis_settings(deadline=None, max_examples=200)
@given(st.lists(st.floats(0.0, 1e9) | st.just(np.inf), min_size=6, max_size=6))
def test_the_next_mesh_keeps_what_is_good_and_splits_within_its_segments(
    ratio: list[float],
) -> None:
    mesh = refined_mesh(MESH, np.array(ratio), LOOSE)
    assert [p.end for p in mesh.phases] == [58.0, 88.0, None]
    old = [(s.start, s.rule.degree) for s in MESH.segments]
    new = [(s.start, s.rule.degree) for s in mesh.segments]
    final_time = 600.0
    for k, s in enumerate(MESH.segments):
        if ratio[k] <= 1.0:
            assert any(np.allclose(a, old[k][0]) and d == old[k][1] for a, d in new)
        assert any(np.allclose(a, s.start) for a, _ in new)  # every old boundary stays
    if max(ratio) > 1.0:
        assert mesh.n_nodes > MESH.n_nodes or len(new) > len(old)
    assert max(d for _, d in new) <= LOOSE.greatest_degree
    assert mesh.times(final_time)[-1] == pytest.approx(final_time)


def test_degree_first_then_cut() -> None:
    one = Mesh((Phase((8,)),))
    assert refined_mesh(one, np.array([5.0]), LOOSE).phases[0].degrees == (10,)
    assert refined_mesh(one, np.array([8.0**5]), LOOSE).phases[0].degrees == (13,)
    assert refined_mesh(one, np.array([8.0**9]), LOOSE).phases[0].degrees == (4, 4, 4)


def test_a_coarse_mesh_is_refined_until_it_is_good(mission: Mission, nominal: Trajectory) -> None:
    refined = solve(on_coarse_mesh(mission), guess=GUESS, refinement=LOOSE)
    rounds = refined.statistics.rounds
    assert refined.status is Status.SOLVED
    assert len(rounds) > 1
    assert [r.nodes for r in rounds] == sorted({r.nodes for r in rounds})
    assert rounds[-1].state_error <= LOOSE.tolerance < rounds[0].state_error
    assert mesh_error(mission, refined, LOOSE).state.max() == rounds[-1].state_error
    assert refined.statistics.iterations == sum(r.iterations for r in rounds)
    assert rounds[1].iterations < rounds[0].iterations  # from the last solution
    assert refined.cost == pytest.approx(nominal.cost, rel=1e-2)


@pytest.mark.parametrize(
    "cap",
    [{"max_rounds": 1}, {"max_nodes": 50}, {"max_segments": 6}, {"max_seconds": 1e-9}],
)
def test_every_cap_ends_in_its_status(
    mission: Mission, coarse: Trajectory, cap: dict[str, Any]
) -> None:
    strict = RefinementSettings(tolerance=1e-12, greatest_degree=8, **cap)
    solves = []

    def solve_on(mission: Mission, guess: Any) -> Trajectory:
        solves.append(guess)
        return coarse

    ended = refine(on_coarse_mesh(mission), solve_on, settings=strict)
    assert ended.status is Status.REFINEMENT_LIMIT
    assert solves == [None]
    assert np.array_equal(ended.states, coarse.states)


def test_a_solve_that_fails_is_not_refined(mission: Mission, coarse: Trajectory) -> None:
    missed = replace(coarse, status=Status.TARGET_MISSED)
    ended = refine(on_coarse_mesh(mission), lambda *_: missed, settings=LOOSE)
    assert ended.status is Status.TARGET_MISSED
    assert len(ended.statistics.rounds) == 1


def test_settings_are_checked() -> None:
    with pytest.raises(ValueError, match=r"refinement\.tolerance: must be positive, got 0"):
        RefinementSettings(tolerance=0.0)
    with pytest.raises(ValueError, match="expected 1 ≤ least_degree ≤ greatest_degree"):
        RefinementSettings(least_degree=9, greatest_degree=8)
