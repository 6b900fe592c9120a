"""Laws of the flipped Radau rule up to degree 100, and the closed forms of low degree.

Abramowitz & Stegun 25.4.31 (mirrored); Hairer & Wanner, Solving ODEs II, Table IV.5.5 (Radau IIA).
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.special import roots_jacobi

from ampi.pseudospectral.radau import FlippedRadau, flipped_radau

DEGREES = range(1, 101)
SIX = np.sqrt(6.0)


def node_polynomial(degree: int) -> np.ndarray:
    """Legendre coefficients of P_N − P_{N−1} (Sagliano et al. 2016, Eq. (14))."""
    series = np.zeros(degree + 1)
    series[degree - 1 :] = -1.0, 1.0
    return series


@pytest.mark.parametrize("degree", DEGREES)
def test_quadrature_is_exact_to_degree_2n_minus_2(degree: int) -> None:
    rule = flipped_radau(degree)
    integrals = rule.weights @ legendre.legvander(rule.nodes[1:], 2 * degree - 2)
    exact = np.zeros(2 * degree - 1)
    exact[0] = 2.0
    assert np.abs(integrals - exact).max() < 1e-12


@pytest.mark.parametrize("degree", DEGREES)
def test_quadrature_of_monomials(degree: int) -> None:
    rule = flipped_radau(degree)
    power = np.arange(2 * degree - 1)
    integrals = rule.weights @ rule.nodes[1:, None] ** power
    exact = np.where(power % 2 == 0, 2.0 / (power + 1), 0.0)
    assert np.abs(integrals - exact).max() < 1e-12


@pytest.mark.parametrize("degree", DEGREES)
def test_quadrature_is_not_exact_at_degree_2n_minus_1(degree: int) -> None:
    # (P_N − P_{N−1}) P_{N−1} vanishes at every node; its integral is −2 / (2N − 1).
    rule = flipped_radau(degree)
    tau = rule.nodes[1:]
    basis = np.zeros(degree)
    basis[-1] = 1.0
    values = legendre.legval(tau, node_polynomial(degree)) * legendre.legval(tau, basis)
    error = rule.weights @ values - (-2.0 / (2 * degree - 1))
    assert error == pytest.approx(2.0 / (2 * degree - 1), rel=1e-9)


@pytest.mark.parametrize("degree", DEGREES)
def test_derivative_matrix_is_exact_to_degree_n(degree: int) -> None:
    rule = flipped_radau(degree)
    for k in range(degree + 1):
        series = np.zeros(k + 1)
        series[-1] = 1.0
        got = rule.derivative @ legendre.legval(rule.nodes, series)
        exact = legendre.legval(rule.nodes[1:], legendre.legder(series))
        assert np.abs(got - exact).max() < 1e-9 * max(1.0, 0.5 * k * (k + 1))


@pytest.mark.parametrize("degree", DEGREES)
def test_derivative_matrix_is_not_exact_at_degree_n_plus_1(degree: int) -> None:
    # (1 + τ)(P_N − P_{N−1}) vanishes at every node, its derivative does not.
    rule = flipped_radau(degree)
    vanishing = legendre.legmul([1.0, 1.0], node_polynomial(degree))
    got = rule.derivative @ legendre.legval(rule.nodes, vanishing)
    exact = legendre.legval(rule.nodes[1:], legendre.legder(vanishing))
    assert np.abs(got).max() < 1e-9
    assert np.abs(exact).min() > 0.1


@pytest.mark.parametrize("degree", DEGREES)
def test_rows_of_the_derivative_matrix_sum_to_zero(degree: int) -> None:
    rule = flipped_radau(degree)
    assert rule.derivative.shape == (degree, degree + 1)
    assert np.abs(rule.derivative.sum(axis=1)).max() < 1e-11


@pytest.mark.parametrize("degree", DEGREES)
def test_nodes_are_the_roots_of_p_n_minus_p_n_minus_1(degree: int) -> None:
    rule = flipped_radau(degree)
    assert rule.nodes[0] == -1.0
    assert np.abs(legendre.legval(rule.nodes[1:], node_polynomial(degree))).max() < 1e-12
    roots = np.sort(legendre.legroots(node_polynomial(degree)).real)
    assert np.abs(rule.nodes[1:] - roots).max() < 1e-10


@pytest.mark.parametrize("degree", DEGREES[1:])
def test_interior_nodes_are_those_of_scipy(degree: int) -> None:
    witness, _ = roots_jacobi(degree - 1, 1.0, 0.0)
    assert np.abs(flipped_radau(degree).nodes[1:-1] - witness).max() < 2e-15


@pytest.mark.parametrize("degree", DEGREES)
def test_weights_are_the_interpolatory_ones(degree: int) -> None:
    # An independent source: ∫ P_k = 2 δ_k0 for k < N fixes the N weights.
    rule = flipped_radau(degree)
    moments = np.zeros(degree)
    moments[0] = 2.0
    vandermonde = legendre.legvander(rule.nodes[1:], degree - 1)
    assert np.abs(rule.weights - np.linalg.solve(vandermonde.T, moments)).max() < 1e-12


@pytest.mark.parametrize("degree", DEGREES)
def test_derivative_and_quadrature_are_adjoint(degree: int) -> None:
    # Σ w (p'q + pq') = p(1)q(1) − p(−1)q(−1) while the product has degree ≤ 2N − 2.
    rule = flipped_radau(degree)
    n = max(degree - 1, 0)
    p = legendre.legvander(rule.nodes, n)
    dp = rule.derivative @ p
    left = dp.T @ (rule.weights[:, None] * p[1:])
    right = np.outer(p[-1], p[-1]) - np.outer(p[0], p[0])
    assert np.abs(left + left.T - right).max() < 1e-9


@pytest.mark.parametrize(
    ("degree", "nodes", "weights"),
    [
        (1, [1.0], [2.0]),
        (2, [-1.0 / 3.0, 1.0], [1.5, 0.5]),
        (
            3,
            [-(1.0 + SIX) / 5.0, -(1.0 - SIX) / 5.0, 1.0],
            [(16.0 - SIX) / 18.0, (16.0 + SIX) / 18.0, 2.0 / 9.0],
        ),
        (4, [-0.822824, -0.181066, 0.575319, 1.0], [0.440925, 0.776387, 0.657689, 0.125000]),
    ],
)
def test_table_of_abramowitz_and_stegun(
    degree: int, nodes: list[float], weights: list[float]
) -> None:
    rule = flipped_radau(degree)
    tolerance = 1e-6 if degree == 4 else 1e-14
    assert rule.nodes[1:] == pytest.approx(nodes, abs=tolerance)
    assert rule.weights == pytest.approx(weights, abs=tolerance)


@pytest.mark.parametrize(
    ("degree", "tableau"),
    [
        (1, [[1.0]]),
        (2, [[5 / 12, -1 / 12], [3 / 4, 1 / 4]]),
        (
            3,
            [
                [(88 - 7 * SIX) / 360, (296 - 169 * SIX) / 1800, (-2 + 3 * SIX) / 225],
                [(296 + 169 * SIX) / 1800, (88 + 7 * SIX) / 360, (-2 - 3 * SIX) / 225],
                [(16 - SIX) / 36, (16 + SIX) / 36, 1 / 9],
            ],
        ),
    ],
)
def test_inverse_of_the_derivative_matrix_is_radau_iia(
    degree: int, tableau: list[list[float]]
) -> None:
    # On [0, 1] instead of [−1, 1] every integral is half as long.
    inverse = np.linalg.inv(flipped_radau(degree).derivative[:, 1:])
    assert 0.5 * inverse == pytest.approx(np.array(tableau), abs=1e-14)


@pytest.mark.parametrize("degree", [0, -3, 2.5])
def test_a_bad_degree_is_named(degree: float) -> None:
    with pytest.raises(
        ValueError, match=f"degree: expected an integer of at least 1, got {degree}"
    ):
        flipped_radau(degree)  # type: ignore[arg-type]


def test_arrays_are_locked() -> None:
    rule = flipped_radau(7)
    for array in (rule.nodes, rule.weights, rule.derivative, rule.barycentric):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


@pytest.mark.parametrize(
    ("field", "factor", "law"),
    [
        ("weights", 1.01, "the weights must sum to 2"),
        ("weights", -1.0, "the weights must be positive"),
        ("nodes", -1.0, "the nodes must increase"),
        ("derivative", None, "the rows of D̄ must sum to zero"),
    ],
)
def test_a_rule_that_breaks_its_laws_is_not_born(
    field: str, factor: float | None, law: str
) -> None:
    good = flipped_radau(4)
    fields = {
        name: getattr(good, name).copy()
        for name in ("nodes", "weights", "derivative", "barycentric")
    }
    if factor is None:
        fields[field][0, 0] += 1e-6
    elif factor == -1.0 and field == "weights":
        fields[field][0], fields[field][-1] = -0.5, fields[field][[0, -1]].sum() + 0.5
    else:
        fields[field] *= factor
    with pytest.raises(ValueError, match=law):
        FlippedRadau(degree=4, **fields)
