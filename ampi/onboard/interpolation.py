"""Tensor-product spline interpolation: Sagliano et al. 2016, Eq. (16) and Algorithm 2 (Table 4).

One axis at a time: A ← Σ_j w_j A[first + j], so that d passes over ever smaller arrays are left, the
first one over the subspace of k^d vertices. All intermediate arrays are allocated once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class TensorProductInterpolator:
    """Evaluates a table (n_1 … n_d, size) at one point of parameter space."""

    def __init__(self, values: Array, order: int) -> None:
        self.values = values
        self.widths = tuple(min(order, n) for n in values.shape[:-1])
        d, size = len(self.widths), values.shape[-1]
        shapes = [(*self.widths[i + 1 :], size) for i in range(d)]
        self._partial = [np.zeros(shape) for shape in shapes]
        self._term = [np.zeros(shape) for shape in shapes]

    def __call__(self, first: list[int], weights: Array) -> Array:
        """Interpolated row (size,); the array is overwritten by the next call.

        Parameters
        ----------
        first
            First index of the subspace on each axis.
        weights
            (d, ≥ k), from `select_subspace`.
        """
        window = tuple(slice(i, i + k) for i, k in zip(first, self.widths, strict=True))
        current: Array = self.values[window]
        for axis, width in enumerate(self.widths):
            out, term = self._partial[axis], self._term[axis]
            # copy, then scale in place: numpy buffers a strided operand of `multiply`, 45 kB of it
            np.copyto(out, current[0])
            np.multiply(out, weights[axis, 0], out=out)
            for j in range(1, width):
                np.copyto(term, current[j])
                np.multiply(term, weights[axis, j], out=term)
                np.add(out, term, out=out)
            current = out
        return current
