"""Lagrange interpolation through arbitrary nodes, in barycentric form.

The product form of Sagliano et al. 2016, Eqs. (23) and (32), overflows and cancels for large N. The
second barycentric form of the same polynomial is stable for Radau nodes at any N:

    P_i(τ) = [λ_i / (τ − τ_i)] / Σ_k [λ_k / (τ − τ_k)],   λ_i = 1 / Π_{k≠i} (τ_i − τ_k).   (1)

References
----------
Berrut & Trefethen (2004), SIAM Review 46(3). Schneider & Werner (1986), Math. Comp. 47.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def barycentric_weights(nodes: ArrayLike) -> Array:
    """Weights λ of Eq. (1), scaled to max |λ| = 1 (a common factor cancels in Eq. (1)).

    The products are formed as sums of logarithms, so that no N overflows.
    """
    tau = np.asarray(nodes, dtype=float)
    difference = tau[:, None] - tau[None, :]
    np.fill_diagonal(difference, 1.0)
    if np.any(difference == 0.0):
        raise ValueError(f"nodes: must be distinct, got {tau}")
    log_size = -np.log(np.abs(difference)).sum(axis=1)
    sign = np.prod(np.sign(difference), axis=1)
    return np.asarray(sign * np.exp(log_size - log_size.max()))


def differentiation_matrix(nodes: ArrayLike, weights: ArrayLike) -> Array:
    """Square matrix that takes nodal values to the interpolant's derivative at the nodes.

    D_ij = (λ_j/λ_i) / (τ_i − τ_j); the diagonal is minus the sum of its row, so that a constant
    has derivative zero to rounding.
    """
    tau, lam = np.asarray(nodes, dtype=float), np.asarray(weights, dtype=float)
    difference = tau[:, None] - tau[None, :]
    np.fill_diagonal(difference, 1.0)
    matrix = (lam[None, :] / lam[:, None]) / difference
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return np.asarray(matrix)


def interpolation_matrix(nodes: ArrayLike, weights: ArrayLike, points: ArrayLike) -> Array:
    """Matrix P (points × nodes) with P_mi = P_i(τ̃_m): the transpose of Eq. (32)'s P_FRP.

    Rows sum to one; a point that coincides with a node gives that node's unit row.
    """
    tau, lam = np.asarray(nodes, dtype=float), np.asarray(weights, dtype=float)
    x = np.asarray(points, dtype=float)
    difference = x[:, None] - tau[None, :]
    on_node = difference == 0.0
    difference[on_node] = 1.0
    terms = lam / difference
    matrix = terms / terms.sum(axis=1, keepdims=True)
    hit = on_node.any(axis=1)
    matrix[hit] = on_node[hit]
    return np.asarray(matrix)
