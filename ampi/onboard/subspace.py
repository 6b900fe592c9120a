"""Selection of the reference subspace: Sagliano et al. 2016, Algorithm 1 (Table 3).

On each axis the cell [p_j, p_{j+1}] that holds the measured parameter; outside the hypercube the
outermost cell, with the parameter moved to the boundary: the boundary trajectory, flagged, and never an
extrapolation (Section V.A). The algorithm's signs and differences amount to a count of the axis points
at or below the parameter.

For a spline of order 3 (Eq. (16) with k = 3) the subspace is the cell and the nearer of its
neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def select_subspace(axis: Array, parameter: float, order: int, weights: Array) -> tuple[int, bool]:
    """First index of the subspace on one axis, and whether the parameter was clipped.

    Parameters
    ----------
    axis
        Strictly increasing points (n,).
    parameter
        Measured value; not-a-number counts as outside and falls back to the axis' middle point.
    order
        Points of the subspace: 2 (multilinear) or 3 (quadratic); fewer if the axis has fewer.
    weights
        Overwritten with the interpolation weights of the subspace, zero-padded.
    """
    n = len(axis)
    k = min(order, n)
    inside = min(max(parameter, axis[0]), axis[-1])  # NaN compares false: yields axis[0]
    clipped = bool(inside != parameter)
    if parameter != parameter:
        inside = axis[n // 2]
    below = 0
    for j in range(n - 1):  # bounded: one pass over the axis
        if axis[j] <= inside:
            below = j
    first = min(below, n - k)
    # the cell's two points and the nearer of their outer neighbours: never an extrapolation
    if k == 3 and 0 < first == below and inside - axis[first - 1] < axis[first + 2] - inside:
        first -= 1
    for i in range(len(weights)):
        weights[i] = 0.0
    for i in range(k):
        weight = 1.0
        for j in range(k):
            if j != i:
                weight *= (inside - axis[first + j]) / (axis[first + i] - axis[first + j])
        weights[i] = weight
    return first, clipped
