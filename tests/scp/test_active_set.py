"""The active set against Clarabel on the subproblems of real solves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ampi.scp.condensed.exact_hessian as loop
from ampi.missions import Mission
from ampi.scp.condensed.active_set import solve_active_set
from ampi.scp.condensed.subproblem import ConvexSubproblem, Step, solve_subproblem
from ampi.scp.solve import solve
from ampi.trajectory import Trajectory


def test_it_solves_what_clarabel_solves(
    mission: Mission, nominal: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[float] = []

    def both(problem: ConvexSubproblem) -> Step | None:
        step = solve_active_set(problem)
        if step is not None:
            other = solve_subproblem(problem)
            seen.append(float(np.abs(step.z - other.z).max()))
            assert step.target_multiplier == pytest.approx(
                other.target_multiplier, rel=1e-3, abs=1e-3
            )
        return step

    monkeypatch.setattr(loop, "solve_active_set", both)
    corner = mission.with_parameters([axis[-1] for axis in mission.grid_axes])
    unknown = replace(nominal, target_multipliers=None)  # else Newton's iteration does without
    assert solve(corner, guess=unknown).status.ok
    assert len(seen) >= 3
    assert max(seen) < 1e-6
