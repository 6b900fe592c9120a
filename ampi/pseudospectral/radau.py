"""Flipped Legendre–Gauss–Radau collocation on (−1, 1].

The N collocation points are the roots of P_N − P_{N−1} (Sagliano et al. 2016, Eq. (14)): the N − 1
roots of the Jacobi polynomial P^{(1,0)}_{N−1} and τ = +1. The point τ = −1 is a node of the
interpolation, not a collocation point. With D̄ = [D₀ | D] the N × (N+1) derivative matrix,

    Σ_j D̄_ij p(τ_j) = p'(τ_i)        for every polynomial p of degree ≤ N,      (1)
    Σ_i w_i q(τ_i) = ∫_{−1}^{1} q dτ  for every polynomial q of degree ≤ 2N − 2. (2)

Those N − 1 roots are the eigenvalues of the Jacobi matrix of P^{(1,0)} (Golub & Welsch), and a Newton
step on P_N − P_{N−1} corrects their last digits. There (1 − τ²) P_n' = n (P_{n−1} − τ P_n), A&S 8.5.4,
gives

    P_N' − P_{N−1}' = 2N P_{N−1} / (1 + τ),                                                 (3)
    w = (1 + τ) / (N P_{N−1})², w_N = 2/N²        (A&S 25.4.31, mirrored).                  (4)

`scipy.special` has these roots as well, but takes longer to import than all that flies together.

References
----------
Garg et al. (2011), Comput. Optim. Appl. 49, 335–358. Golub & Welsch (1969), Math. Comp. 23, 221–230.
A&S: Abramowitz & Stegun.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.pseudospectral.lagrange import (
    barycentric_weights,
    differentiation_matrix,
    interpolation_matrix,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FlippedRadau:
    """Nodes, weights and derivative matrix of one degree. Arrays are read-only."""

    degree: int
    nodes: Array  # (N+1,), τ₀ = −1 first, τ_N = +1
    weights: Array  # (N,), quadrature over the collocation points nodes[1:]
    derivative: Array  # (N, N+1), D̄: from nodal values to derivatives at the collocation points
    barycentric: Array  # (N+1,), weights of the interpolation through all nodes

    def __post_init__(self) -> None:
        laws = {
            "the rows of D̄ must sum to zero": np.abs(self.derivative.sum(axis=1)).max() < 1e-9,
            "the weights must sum to 2": abs(self.weights.sum() - 2.0) < 1e-12,
            "the weights must be positive": bool(np.all(self.weights > 0.0)),
            "the nodes must increase from −1 to 1": bool(
                self.nodes[0] == -1.0 and self.nodes[-1] == 1.0 and np.all(np.diff(self.nodes) > 0)
            ),
        }
        for law, holds in laws.items():
            if not holds:
                raise ValueError(f"flipped Radau, degree {self.degree}: {law}")
        for array in (self.nodes, self.weights, self.derivative, self.barycentric):
            array.setflags(write=False)

    def derivative_at(self, points: Array) -> Array:
        """Matrix (points, N+1) from nodal values to the interpolant's derivative anywhere.

        The derivative is of degree N − 1: its values at the collocation points determine it.
        """
        inner = self.nodes[1:]
        return interpolation_matrix(inner, barycentric_weights(inner), points) @ self.derivative


@lru_cache(maxsize=256)
def flipped_radau(degree: int) -> FlippedRadau:
    """Flipped Radau rule with `degree` = N ≥ 1 collocation points.

    Raises
    ------
    ValueError
        If `degree` is not a positive integer.
    """
    if int(degree) != degree or degree < 1:
        raise ValueError(f"degree: expected an integer of at least 1, got {degree!r}")
    n = int(degree)
    interior = _interior_nodes(n)
    nodes = np.concatenate([[-1.0], interior, [1.0]])
    weights = np.full(n, 2.0 / n**2)
    weights[:-1] = (1.0 + interior) / (n * _legendre(n, interior)[0]) ** 2  # (4)
    barycentric = barycentric_weights(nodes)
    return FlippedRadau(
        degree=n,
        nodes=nodes,
        weights=weights,
        derivative=differentiation_matrix(nodes, barycentric)[1:],
        barycentric=barycentric,
    )


def _interior_nodes(n: int) -> Array:
    """The n − 1 roots of P_n − P_{n−1} between −1 and 1, in increasing order."""
    k = np.arange(n - 1)
    beside = np.sqrt(k[1:] * (k[1:] + 1.0)) / (2 * k[1:] + 1)
    jacobi = np.diag(-1.0 / ((2 * k + 1) * (2 * k + 3))) + np.diag(beside, -1)
    roots = np.linalg.eigvalsh(jacobi)  # reads the lower triangle
    before, last = _legendre(n, roots)
    return np.asarray(roots - (last - before) * (1.0 + roots) / (2 * n * before))  # (3)


def _legendre(n: int, points: NDArray[Any]) -> tuple[Array, Array]:
    """P_{n−1} and P_n by their three-term recurrence."""
    before, last = np.zeros_like(points), np.ones_like(points)
    for k in range(n):
        before, last = last, ((2 * k + 1) * points * last - k * before) / (k + 1)
    return before, last
