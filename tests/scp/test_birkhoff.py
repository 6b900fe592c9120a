"""Birkhoff interpolation: exact for polynomials, and an error that shrinks with the degree."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.scp.literature.birkhoff import birkhoff_error, chebyshev_gauss_lobatto, integration_matrix


@pytest.mark.parametrize("count", [2, 5, 12, 30])
def test_polynomials_are_integrated_exactly(count: int) -> None:
    tau = chebyshev_gauss_lobatto(count)
    for power in range(count):
        integral = (tau ** (power + 1) - (-1.0) ** (power + 1)) / (power + 1)
        assert np.abs(integration_matrix(count) @ tau**power - integral).max() < 1e-12


def test_a_solution_has_no_error_and_a_wrong_one_has_its_own() -> None:
    tau = chebyshev_gauss_lobatto(20)
    x = np.exp(2.0 * (1.0 + tau))[:, None]  # x' = x over a half-length of 2
    assert birkhoff_error(x, x, 2.0, np.ones(1)) < 1e-9
    wrong = x + 0.3 * (1.0 + tau[:, None])
    assert birkhoff_error(wrong, x, 2.0, np.ones(1)) == pytest.approx(0.6, rel=1e-6)


def test_one_point_is_refused() -> None:
    with pytest.raises(ValueError, match="count: expected at least 2 points, got 1"):
        chebyshev_gauss_lobatto(1)
