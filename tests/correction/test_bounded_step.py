"""The step in bounds against SciPy's bounded least squares of the same quadratic."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from ampi.correction.bounded_step import bounded_step

Array = NDArray[np.float64]
M, N = 18, 40


def problems(seed: int, tightness: float) -> tuple[Array, Array, Array, Array]:
    """A (18, 18, n), b, p and B (18, n): three strong rows and a weak damping, as of a flight."""
    rng = np.random.default_rng(seed)
    rows = 100.0 * rng.standard_normal((N, 3, M))
    bends = np.diff(np.eye(M), 2, axis=0)
    matrix = np.einsum("nki,nkj->ijn", rows, rows) + (0.2 * np.eye(M) + bends.T @ bends)[:, :, None]
    right = np.einsum("nki,nk->in", rows, 20.0 * rng.standard_normal((N, 3)))
    bound = np.full((M, N), 1.0)
    values = np.clip(rng.uniform(-1.0, 1.0, (M, N)) * tightness, -1.0, 1.0)
    return matrix, right, values, bound


def optima(matrix: Array, right: Array, values: Array, bound: Array) -> Array:
    """By SciPy, one after the other."""
    found = []
    for i in range(matrix.shape[2]):
        upper = np.linalg.cholesky(matrix[:, :, i]).T
        ends = -bound[:, i] - values[:, i] - 1e-12, bound[:, i] - values[:, i] + 1e-12
        given = np.linalg.solve(upper.T, right[:, i])
        found.append(lsq_linear(upper, given, ends, method="bvls", tol=1e-14).x)
    return np.array(found).T


def test_a_step_that_meets_no_bound_is_the_solution() -> None:
    matrix, right, values, bound = problems(1, 0.5)
    step = bounded_step(matrix, right, values, 1e6 * bound)
    for i in range(N):
        expected = np.linalg.solve(matrix[..., i], right[:, i])
        np.testing.assert_allclose(step[:, i], expected, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("tightness", [0.7, 1.0, 1.6, 2.5])
def test_a_step_in_bounds_is_that_of_scipy(tightness: float) -> None:
    given = problems(2, tightness)
    _, _, values, bound = given
    step, best = bounded_step(*given), optima(*given)
    assert (np.abs(values + step) <= bound * (1.0 + 1e-12)).all()
    np.testing.assert_allclose(step, best, atol=1e-9)


def test_what_is_held_is_drawn_outwards_and_the_rest_not_at_all() -> None:
    matrix, right, values, bound = problems(3, 1.0)
    values[:9] = np.where(right[:9] >= 0.0, 1.0, -1.0)
    step = bounded_step(matrix, right, values, bound)
    slope = np.einsum("ijn,jn->in", matrix, step) - right
    end = values + step
    at_bound = np.abs(end) >= 1.0 - 1e-12
    assert at_bound.any() and (slope[at_bound] * end[at_bound] <= 0.0).all()
    np.testing.assert_allclose(slope[~at_bound], 0.0, atol=1e-6 * np.abs(right).max())


def test_flights_in_company_step_as_they_do_alone() -> None:
    given = problems(4, 1.5)
    together = bounded_step(*given)
    for i in range(N):
        alone = bounded_step(*(part[..., [i]] for part in given))
        np.testing.assert_array_equal(together[:, i], alone[:, 0])
