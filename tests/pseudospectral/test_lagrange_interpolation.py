"""Barycentric interpolation: partition of unity, exactness, an independent library, no Runge."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import legendre
from scipy.interpolate import BarycentricInterpolator

from ampi.pseudospectral.lagrange import (
    barycentric_weights,
    differentiation_matrix,
    interpolation_matrix,
)
from ampi.pseudospectral.radau import flipped_radau

degrees = st.integers(1, 100)
points = st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=20)
laws = settings(deadline=None, max_examples=60)


def runge(tau: np.ndarray) -> np.ndarray:
    """The example function of Sagliano et al. 2016, Figs. 9 and 10."""
    return 1.0 / (1.0 + 25.0 * tau**2)


def runge_error(nodes: np.ndarray) -> float:
    """Greatest interpolation error of `runge` through `nodes`."""
    tau = np.linspace(-1.0, 1.0, 2001)
    matrix = interpolation_matrix(nodes, barycentric_weights(nodes), tau)
    return float(np.abs(matrix @ runge(nodes) - runge(tau)).max())


@laws
@given(degree=degrees, tau=points)
def test_partition_of_unity(degree: int, tau: list[float]) -> None:
    rule = flipped_radau(degree)
    matrix = interpolation_matrix(rule.nodes, rule.barycentric, tau)
    assert matrix.shape == (len(tau), degree + 1)
    assert np.abs(matrix.sum(axis=1) - 1.0).max() < 1e-12


@laws
@given(degree=degrees, tau=points)
def test_polynomials_up_to_the_degree_are_reproduced(degree: int, tau: list[float]) -> None:
    rule = flipped_radau(degree)
    matrix = interpolation_matrix(rule.nodes, rule.barycentric, tau)
    got = matrix @ legendre.legvander(rule.nodes, degree)
    assert np.abs(got - legendre.legvander(np.array(tau), degree)).max() < 1e-10


@laws
@given(degree=degrees, tau=points, seed=st.integers(0, 2**32 - 1))
def test_agreement_with_scipy(degree: int, tau: list[float], seed: int) -> None:
    rule = flipped_radau(degree)
    values = np.random.default_rng(seed).uniform(-1.0, 1.0, degree + 1)
    interpolator = BarycentricInterpolator(rule.nodes, values, rng=np.random.default_rng(0))
    matrix = interpolation_matrix(rule.nodes, rule.barycentric, tau)
    assert np.abs(matrix @ values - interpolator(np.array(tau))).max() < 1e-9


@pytest.mark.parametrize("degree", [1, 2, 7, 64, 100])
def test_nodes_give_unit_rows(degree: int) -> None:
    rule = flipped_radau(degree)
    matrix = interpolation_matrix(rule.nodes, rule.barycentric, rule.nodes)
    assert np.array_equal(matrix, np.eye(degree + 1))


@pytest.mark.parametrize("count", [2, 5, 20, 300])
def test_weights_satisfy_their_definition(count: int) -> None:
    # Chebyshev points: λ_i = (−1)^i, halved at the ends, up to a common factor.
    nodes = -np.cos(np.pi * np.arange(count) / (count - 1))
    known = (-1.0) ** np.arange(count)
    known[[0, -1]] *= 0.5
    weights = barycentric_weights(nodes)
    assert np.abs(weights).max() == 1.0
    assert weights * np.sign(weights[0]) == pytest.approx(known / np.abs(known).max(), rel=1e-8)


def test_derivative_on_arbitrary_nodes() -> None:
    nodes = np.array([-0.9, -0.35, 0.1, 0.2, 1.7])
    matrix = differentiation_matrix(nodes, barycentric_weights(nodes))
    powers = nodes[:, None] ** np.arange(5)
    exact = np.arange(5) * nodes[:, None] ** np.maximum(np.arange(5) - 1, 0)
    assert matrix @ powers == pytest.approx(exact, abs=1e-12)


def test_coincident_nodes_are_refused() -> None:
    with pytest.raises(ValueError, match="nodes: must be distinct, got"):
        barycentric_weights([0.0, 0.5, 0.5, 1.0])


def test_runge_growth_on_uniform_nodes() -> None:
    # Figs. 9(a), 9(b): the oscillations at the edges grow with the number of nodes.
    assert 1.0 < runge_error(np.linspace(-1.0, 1.0, 11)) < 3.0
    assert runge_error(np.linspace(-1.0, 1.0, 25)) > 100.0


def test_no_runge_growth_on_flipped_radau_nodes() -> None:
    # Figs. 10(a), 10(b), further refined; the poles ±i/5 fix the rate at 0.82 per node.
    errors = [runge_error(flipped_radau(count - 1).nodes) for count in (11, 25, 50, 100)]
    assert errors[0] < 0.25
    assert errors[1] < 0.02
    assert errors[2] < 2e-4
    assert errors[3] < 2e-8
    rate = (errors[3] / errors[1]) ** (1.0 / 75.0)
    assert rate == pytest.approx(5.0 / (1.0 + np.sqrt(26.0)), rel=0.02)
