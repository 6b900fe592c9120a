"""The vectorised evaluation of traced functions against CasADi's own."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from ampi.missions import load_mission
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.tracing.vectorised import VectorisedFunction


@pytest.mark.parametrize(
    "name", ["shefex3", "cavh_wang2020", "cavh_liu2015", "rlv_liu2024", "x33_liu2015"]
)
def test_physics_and_derivatives_of_every_mission(name: str) -> None:
    problem = OptimalControlProblem.of(load_mission(name))
    traced, numbers = problem.dynamics.traced, np.array(problem.numbers)
    mu = ca.SX.sym("mu", 7)
    hessian = ca.hessian(ca.dot(mu, traced.f), ca.vertcat(traced.x, traced.t))[0]
    inputs = [traced.x, traced.u, traced.t, traced.p, mu]
    outputs = [ca.densify(traced.f), ca.densify(traced.g), traced.jacobian, hessian]
    rng, points = np.random.default_rng(3), 50
    x = np.concatenate([problem.entry, [0.5]])[:, None] * rng.uniform(0.6, 1.0, (7, points))
    given = [
        x,
        rng.uniform(-1, 1, (1, points)),
        rng.uniform(0, 500, (1, points)),
        numbers[:, None] * np.ones(points),
        rng.normal(size=(7, points)),
    ]
    function = VectorisedFunction(ca.Function("vectorised", inputs, outputs))
    found = function(*given)
    direct = ca.Function("direct", inputs, outputs)
    nonzeros = [list(zip(*out.sparsity().get_triplet(), strict=True)) for out in outputs]
    for k in range(points):
        expected = direct(*(values[:, k] for values in given))
        for out, entries, values in zip(expected, nonzeros, found, strict=True):
            dense = np.array(out)
            assert np.count_nonzero(dense) <= len(entries)
            at = np.array([dense[i, j] for i, j in entries])
            scale = np.abs(dense).max() + 1e-30
            assert values[:, k] == pytest.approx(at, rel=1e-9, abs=1e-12 * scale)
    # a number that all points share is the same, once, and so are the bits of what depends on it
    shared = [float(n) if k % 3 else np.full(points, n) for k, n in enumerate(numbers)]
    for mixed in (list(map(float, numbers)), shared):
        again = function(*given[:3], mixed, given[4])
        for one, other in zip(again, found, strict=True):
            assert np.array_equal(one, other, equal_nan=True)


def test_a_point_does_not_depend_on_its_company() -> None:
    x = ca.SX.sym("x", 2)
    function = VectorisedFunction(
        ca.Function("f", [x], [ca.vertcat(ca.sin(x[0]) * ca.exp(x[1]), x[0] ** 3.5)])
    )
    points = np.random.default_rng(1).uniform(0.1, 2.0, (2, 333))
    (together,) = function(points)
    for first, last in ((0, 1), (5, 12), (100, 333)):
        assert np.array_equal(function(points[:, first:last].copy())[0], together[:, first:last])


def test_conditions_and_constants() -> None:
    x = ca.SX.sym("x")
    expressions = ca.vertcat(ca.if_else(x > 1.0, x, 2.0), ca.fmax(x, 0.0), 7.0, ca.fabs(x), 2 * x)
    function = VectorisedFunction(ca.Function("f", [x], [ca.densify(expressions)]))
    (found,) = function(np.array([[-3.0, 0.5, 4.0]]))
    expected = [[2, 2, 4], [0, 0.5, 4], [7, 7, 7], [3, 0.5, 4], [-6, 1, 8]]
    assert found.tolist() == expected


def test_an_unknown_operation_is_named() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(NotImplementedError, match="no ufunc for CasADi's operation"):
        VectorisedFunction(ca.Function("f", [x], [ca.erf(x)]))


def test_shared_and_own_numbers_give_equal_bits() -> None:
    """In every mixture, one after the other: a program is made for each."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p", 3)
    shared = p[0] ** 1.5 * ca.exp(p[1])  # of numbers alone
    expressions = ca.vertcat(
        shared * ca.sin(x),
        ca.if_else(p[2] > 1.0, shared, x) + p[1],
        shared,
        p[2],
        1.0 / p[0] + x,
        (p[0] > 1.0) - (p[2] > 1.0),
        (p[0] < 1.0) + (p[2] > 1.0),
    )
    function = VectorisedFunction(ca.Function("f", [x, p], [ca.densify(expressions)]))
    points, numbers = np.random.default_rng(4).uniform(0.5, 2.0, (1, 37)), (0.7, -1.3, 1.1)
    (expected,) = function(points, np.array(numbers)[:, None] * np.ones(37))
    for own in range(8):
        mixed = [np.full(37, n) if own >> k & 1 else n for k, n in enumerate(numbers)]
        assert np.array_equal(function(points, mixed)[0], expected)
    other = [0.9, np.linspace(0.1, 0.2, 37), 0.8]  # the numbers of the last call are not kept
    (found,) = function(points, other)
    assert found[2] == pytest.approx(0.9**1.5 * np.exp(other[1]), rel=1e-15)
    assert np.array_equal(found[3], np.full(37, 0.8))
