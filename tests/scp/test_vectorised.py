"""The vectorised evaluation of traced functions against CasADi's own."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from ampi.missions import load_mission
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.tracing.derivatives import trace
from ampi.tracing.vectorised import VectorisedFunction


@pytest.mark.parametrize(
    "name", ["shefex3", "cavh_wang2020", "cavh_liu2015", "rlv_liu2024", "x33_liu2015"]
)
def test_physics_and_derivatives_of_every_mission(name: str) -> None:
    problem = OptimalControlProblem.from_mission(load_mission(name))
    traced = trace(
        problem.model, problem.functions, problem.scaling.states, problem.bank_rate_limit
    )
    mu = ca.SX.sym("mu", 7)
    hessian = ca.hessian(ca.dot(mu, traced.f), ca.vertcat(traced.x, traced.t))[0]
    inputs = [traced.x, traced.u, traced.t, mu]
    outputs = [ca.densify(traced.f), ca.densify(traced.g), traced.jacobian, hessian]
    rng, points = np.random.default_rng(3), 50
    x = np.concatenate([problem.entry, [0.5]])[:, None] * rng.uniform(0.6, 1.0, (7, points))
    given = [
        x,
        rng.uniform(-1, 1, (1, points)),
        rng.uniform(0, 500, (1, points)),
        rng.normal(size=(7, points)),
    ]
    function = VectorisedFunction(inputs, outputs)
    found = function(*given)
    direct = ca.Function("direct", inputs, outputs)
    for k in range(points):
        expected = direct(*(values[:, k] for values in given))
        for out, entries, values in zip(expected, function.nonzeros, found, strict=True):
            dense = np.array(out)
            assert np.count_nonzero(dense) <= len(entries)
            at = np.array([dense[i, j] for i, j in entries])
            scale = np.abs(dense).max() + 1e-30
            assert values[:, k] == pytest.approx(at, rel=1e-9, abs=1e-12 * scale)


def test_a_point_does_not_depend_on_its_company() -> None:
    x = ca.SX.sym("x", 2)
    function = VectorisedFunction([x], [ca.vertcat(ca.sin(x[0]) * ca.exp(x[1]), x[0] ** 3.5)])
    points = np.random.default_rng(1).uniform(0.1, 2.0, (2, 333))
    (together,) = function(points)
    for first, last in ((0, 1), (5, 12), (100, 333)):
        assert np.array_equal(function(points[:, first:last].copy())[0], together[:, first:last])


def test_conditions_and_constants() -> None:
    x = ca.SX.sym("x")
    expressions = ca.vertcat(ca.if_else(x > 1.0, x, 2.0), ca.fmax(x, 0.0), 7.0, ca.fabs(x), 2 * x)
    (found,) = VectorisedFunction([x], [ca.densify(expressions)])(np.array([[-3.0, 0.5, 4.0]]))
    expected = [[2, 2, 4], [0, 0.5, 4], [7, 7, 7], [3, 0.5, 4], [-6, 1, 8]]
    assert found.tolist() == expected


def test_an_unknown_operation_is_named() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(NotImplementedError, match="no ufunc for CasADi's operation"):
        VectorisedFunction([x], [ca.erf(x)])
