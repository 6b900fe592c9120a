"""The sparse subproblem: Clarabel's form and cvxpy's agree; one more constraint binds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import load_mission
from ampi.papers.liu2015 import liu2015_case
from ampi.scp.cone_program import ConeSolution, ConeStatus, solve_cone_program
from ampi.scp.literature import sparse_subproblem
from ampi.scp.literature.methods import METHODS, _assemble
from ampi.scp.literature.sparse_subproblem import SparseSubproblem, solve_sparse_subproblem
from ampi.scp.literature.sparse_subproblem_cvxpy import solve_sparse_subproblem_cvxpy
from ampi.scp.literature.starts import flown, uniform

Array = NDArray[np.float64]


def first(name: str) -> SparseSubproblem:
    """The first subproblem of a method on its own mission, on a smaller mesh where it can be."""
    method = METHODS[name]
    mission = {
        "zhou2021": lambda: load_mission("cavh_zhou2021"),
        "liu2015": lambda: liu2015_case("minimum time"),
        "wang2020": lambda: load_mission("cavh_wang2020"),
        "liu2024": lambda: load_mission("rlv_liu2024"),
    }[name]()
    begin = flown(uniform(10, 10)) if name in ("wang2020", "liu2024") else method.start
    start = begin(mission)
    assert start is not None
    successive = _assemble(mission, method, start.formulation, solve_sparse_subproblem)
    rule = method.transcribe(start.iterate.mesh)
    return successive.builder.subproblem(rule, start.iterate, 0.1)


@pytest.mark.parametrize("name", ["zhou2021", "liu2015", "wang2020", "liu2024"])
def test_both_forms_agree(name: str) -> None:
    problem = first(name)
    ours, theirs = solve_sparse_subproblem(problem), solve_sparse_subproblem_cvxpy(problem)
    assert ours.usable
    assert theirs.usable
    assert ours.objective == pytest.approx(theirs.objective, rel=1e-4)
    assert np.abs(ours.states - theirs.states).max() < 2e-2
    stacked = np.concatenate([ours.states.ravel(), ours.controls.ravel(), [ours.final]])
    assert np.abs(problem.dynamics @ stacked + problem.residual).max() < 1e-5
    assert ours.final == pytest.approx(theirs.final, abs=5e-2)


def test_a_constraint_of_ones_own_binds() -> None:
    problem = first("wang2020")
    free = solve_sparse_subproblem(problem)
    north = float((problem.states + free.states)[:, 2].max())

    def south(x: cp.Expression, u: cp.Expression) -> list[cp.Constraint]:
        return [x[1:, 2] <= north - 0.01]

    held = solve_sparse_subproblem_cvxpy(problem, extra_constraints=south)
    assert held.usable
    assert (problem.states + held.states)[1:, 2].max() == pytest.approx(north - 0.01, abs=1e-5)
    assert held.objective > free.objective


def test_an_unknown_solver_is_named() -> None:
    with pytest.raises(ValueError, match=r"solver: expected one of .*got 'ABACUS'"):
        solve_sparse_subproblem_cvxpy(first("wang2020"), solver="ABACUS")


def test_a_program_at_which_the_arithmetic_stops_is_tried_unscaled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scaled = []

    def stops_at_first(*args: Any, equilibrated: bool, **options: Any) -> ConeSolution:
        scaled.append(equilibrated)
        found = solve_cone_program(*args, equilibrated=equilibrated, **options)
        return replace(found, status=ConeStatus.NUMERICAL_ERROR) if equilibrated else found

    problem = first("wang2020")
    expected = solve_sparse_subproblem(problem)
    monkeypatch.setattr(sparse_subproblem, "solve_cone_program", stops_at_first)
    found = solve_sparse_subproblem(problem)
    assert scaled == [True, False]
    assert found.usable
    assert found.objective == pytest.approx(expected.objective, rel=1e-5)
