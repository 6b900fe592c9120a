"""Solution error on an interval by Birkhoff interpolation (Liu et al. 2024, Section 3.3).

Only the outline of that section survives; the derivation here is ours. A Birkhoff interpolant on
[−1, 1] is fixed by its value at −1 and its derivative at points τ_0 … τ_M:

    x_B(τ) = x(−1) + Σ_j f_j ∫_{−1}^{τ} ℓ_j(s) ds = x(−1) + Σ_j B_j(τ) f_j           (1)

with ℓ_j Lagrange's polynomials of the points; B = [B_j(τ_i)] is its integration matrix. Let X, U be the
polynomials of a collocated solution on an interval of half-length h. With f_j = h f(X(τ_j), U(τ_j)) at
Chebyshev–Gauss–Lobatto points richer than the collocation points, x_B is the solution integrated once
more with its own rates (a Picard step), explicitly, with no integrator and no new unknown, and

    e = max_ij |x_B,i(τ_j) − X_i(τ_j)| / scale_i                                    (2)

vanishes only where X satisfies the dynamics everywhere on the interval, not at its collocation points
alone.

References
----------
Wang, Samson, Zhao (2014), SIAM J. Sci. Comput. 36, for Birkhoff interpolation at Gauss-type points.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

Array = NDArray[np.float64]


def chebyshev_gauss_lobatto(count: int) -> Array:
    """`count` points τ_j = −cos(π j / (count − 1)), ends included."""
    if count < 2:
        raise ValueError(f"count: expected at least 2 points, got {count}")
    return np.asarray(-np.cos(np.pi * np.arange(count) / (count - 1)))


@lru_cache(maxsize=64)
def integration_matrix(count: int) -> Array:
    """B of Eq. (1) at the Chebyshev–Gauss–Lobatto points, (count, count).

    By Chebyshev coefficients: values → coefficients (the points' Vandermonde matrix, which is well
    conditioned), each term integrated from −1, evaluated at the points.
    """
    tau = chebyshev_gauss_lobatto(count)
    to_coefficients = np.linalg.inv(chebyshev.chebvander(tau, count - 1))
    integrals = np.column_stack(
        [
            chebyshev.chebval(tau, chebyshev.chebint(np.eye(count)[k], lbnd=-1.0))
            for k in range(count)
        ]
    )
    matrix = integrals @ to_coefficients
    matrix.setflags(write=False)
    return np.asarray(matrix)


def birkhoff_error(states: Array, rates: Array, half_length: float, scale: Array) -> float:
    """e of Eq. (2).

    Parameters
    ----------
    states
        X at the Chebyshev–Gauss–Lobatto points, (M, n_x).
    rates
        f(X, U) there, (M, n_x), per unit of the independent variable.
    half_length
        h of the interval.
    scale
        (n_x,): an error of this size counts as one.
    """
    again = states[0] + half_length * integration_matrix(len(states)) @ rates
    return float((np.abs(again - states) / scale).max())
