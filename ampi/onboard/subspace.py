"""Selection of the reference subspace: Sagliano et al. 2016, Algorithm 1 (Table 3), for every order.

On each axis the cell [p_j, p_{j+1}] that holds the measured parameter; outside the hypercube the
outermost cell, with the parameter moved to the boundary: the boundary trajectory, flagged, and never an
extrapolation (Section V.A). The algorithm's signs and differences amount to a count of the axis points
at or below the parameter.

An order is a method for one axis: the tensor-product splines of Eqs. (16)–(19) leave each dimension its
own. With s = (p − p_j)/h and h = p_{j+1} − p_j, in the cell:

    nearest              the value at the nearer point                            order 1 in Eq. (16)
    linear               (1 − s) f_j + s f_{j+1}, the paper's                     order 2
    quadratic            the parabola through three points                        order 3
    cubic                the cubic through four points                            order 4
    second differences   linear + ½ s (s − 1) h² ((1 − s) f''_j + s f''_{j+1})                     (1)
    Hermite              linear + s (1 − s) ((1 − s) (h f'_j − Δ) + s (Δ − h f'_{j+1})),
                         Δ = f_{j+1} − f_j, f' = ∂f/∂p stored with the table                       (2)

Order k takes k points: a fixed triple 2i, 2i + 1, 2i + 2 where it is quadratic, and the two points of
the cell and one to each side where it is cubic, at an edge of the axis the outermost. So the two pieces
that meet at a point have the same value there: every order but nearest is continuous. (The nearer of the
outer neighbours for the third point would not be: the reference would jump in mid-cell.) An axis with
fewer points takes what it has.

f''_j in (1) is twice the divided difference of p_{j−1}, p_j, p_{j+1}; the outermost points take that of
their neighbour. The correction is that of one axis; along all others it is interpolated as they are
without theirs. So each axis adds one tensor product, not a factor: 2^d vertices and a few beyond, where
cubic order needs 4^d.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Order(Enum):
    """How a table is interpolated along one axis."""

    NEAREST = "nearest"
    LINEAR = "linear"
    QUADRATIC = "quadratic"
    CUBIC = "cubic"
    SECOND_DIFFERENCES = "second_differences"  # corrected by Eq. (1)
    HERMITE = "hermite"  # corrected by Eq. (2); needs the table's sensitivities

    @property
    def points(self) -> int:
        """Points of the subspace on an axis that has as many, a correction aside."""
        return _POINTS.get(self, 2)


_POINTS = {Order.NEAREST: 1, Order.QUADRATIC: 3, Order.CUBIC: 4}


def located(axis: Sequence[float], parameter: float) -> tuple[float, int, bool]:
    """Where the parameter is looked up, the first point of its cell, and whether it was clipped.

    Parameters
    ----------
    axis
        Strictly increasing points (n,).
    parameter
        Measured value; not-a-number counts as outside and falls back to the axis' middle point.
    """
    n = len(axis)
    inside = min(max(parameter, axis[0]), axis[-1])
    clipped = inside != parameter
    if parameter != parameter:
        inside = axis[n // 2]
    return inside, max(min(bisect_right(axis, inside) - 1, n - 2), 0), clipped


def point_weights(
    axis: Sequence[float], inside: float, below: int, points: int, weights: Array
) -> int:
    """Weights (points,) of the subspace of `points` points; returns its first.

    Parameters
    ----------
    axis
        Strictly increasing points (n,), `points` of them at least.
    inside, below
        From `located`.
    points
        1 (nearest), or order of the Lagrange polynomial: 2, 3 or 4.
    weights
        Overwritten.
    """
    if points == 1:
        weights[0] = 1.0
        if below + 1 < len(axis) and inside - axis[below] > axis[below + 1] - inside:
            return below + 1
        return below
    first = _first(below, points, len(axis))
    for i in range(first, first + points):
        weight = 1.0
        for j in range(first, first + points):
            if j != i:
                weight *= (inside - axis[j]) / (axis[i] - axis[j])
        weights[i - first] = weight
    return first


def _first(below: int, points: int, n: int) -> int:
    """First of the points that interpolate the cell of `below`, of an axis of n."""
    if points == 3:
        below -= below % 2
    elif points == 4:
        below = max(below - 1, 0)
    return min(below, n - points)


def second_difference_weights(
    axis: Sequence[float], inside: float, below: int, weights: Array
) -> int:
    """Weights of the correction of Eq. (1); returns the first of its points.

    Parameters
    ----------
    axis
        Strictly increasing points (n,), at least 3.
    inside, below
        From `located`.
    weights
        (3,) if n = 3, else (4,); overwritten.
    """
    n = len(axis)
    first = _first(below, len(weights), n) if len(weights) == 4 else 0
    h = axis[below + 1] - axis[below]
    s = (inside - axis[below]) / h
    bubble = s * (s - 1.0) * (h * h)  # the half, and the two of the divided difference
    weights[:] = 0.0
    for node, share in ((below, 1.0 - s), (below + 1, s)):
        j = min(max(node, 1), n - 2)
        left, right = axis[j] - axis[j - 1], axis[j + 1] - axis[j]
        both = left + right
        part = bubble * share
        weights[j - 1 - first] += part / (left * both)
        weights[j - first] -= part / (left * right)
        weights[j + 1 - first] += part / (right * both)
    return first


def hermite_weights(
    axis: Sequence[float], inside: float, below: int, of_values: Array, of_slopes: Array
) -> int:
    """Weights (2,) of values and of slopes in the correction of Eq. (2); returns the cell's first point.

    `axis` has at least 2 points; `inside` and `below` are from `located`.
    """
    h = axis[below + 1] - axis[below]
    s = (inside - axis[below]) / h
    bubble = s * (1.0 - s)
    even = bubble * (1.0 - 2.0 * s)
    of_values[0] = even
    of_values[1] = -even
    of_slopes[0] = bubble * (1.0 - s) * h
    of_slopes[1] = -(bubble * s * h)
    return below
