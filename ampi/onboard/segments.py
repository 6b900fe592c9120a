"""The polynomials of a reference, segment by segment: Sagliano et al. 2016, Eq. (30), at one point.

With nodes τ_j and weights w_i = 1/Π_{j≠i} (τ_i − τ_j) the basis of a segment is

    P_i(τ) = w_i Π_{j<i} (τ − τ_j) Π_{j>i} (τ − τ_j),                           (1)

formed by running products from the left and from the right: no division, so no node is singular, and
of every segment the same number of operations. Up to a hundred nodes nothing overflows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Segments:
    """s segments of k nodes at most; times are a + b t_f. Padded where a segment has fewer nodes."""

    first_node: NDArray[np.intp]  # (s,), among all nodes of a reference
    start: Array  # (2, s): a, b of each segment's begin
    half_length: Array  # (2, s)
    nodes: Array  # (s, k), τ in [−1, 1]; the last one again where padded
    weights: Array  # (s, k), of Eq. (1); 0 where padded
    counts: NDArray[np.intp]  # (s,), nodes of each

    @classmethod
    def of(
        cls,
        nodes: Sequence[ArrayLike],
        start: Sequence[ArrayLike],
        half_length: Sequence[ArrayLike],
    ) -> Segments:
        """From the nodes τ of each segment, and the (a, b) of its begin and of half its length.

        A segment begins with the node with which the one before it ends.

        Raises
        ------
        ValueError
            If a segment has fewer than two nodes, or they do not increase from −1 to 1.
        """
        own = [np.asarray(tau, dtype=float) for tau in nodes]
        for tau in own:
            if len(tau) < 2 or np.any(np.diff(tau) <= 0.0) or tau[0] < -1.0 or tau[-1] > 1.0:
                raise ValueError(
                    f"segments: nodes: expected two or more that increase in [−1, 1], got {tau}"
                )
        counts = np.array([len(tau) for tau in own], dtype=np.intp)
        most = int(counts.max())
        padded = np.stack([np.append(tau, np.full(most - len(tau), tau[-1])) for tau in own])
        weights = np.zeros_like(padded)
        for row, tau in zip(weights, own, strict=True):
            difference = tau[:, None] - tau[None, :]
            np.fill_diagonal(difference, 1.0)
            row[: len(tau)] = 1.0 / difference.prod(axis=1)
        found = cls(
            first_node=np.concatenate([[0], np.cumsum(counts - 1)[:-1]]).astype(np.intp),
            start=np.array(start, dtype=float).T.copy(),
            half_length=np.array(half_length, dtype=float).T.copy(),
            nodes=padded,
            weights=weights,
            counts=counts,
        )
        for array in (found.first_node, found.start, found.half_length, padded, weights, counts):
            array.setflags(write=False)
        return found

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def n_nodes(self) -> int:
        """Of a whole reference."""
        return int(self.first_node[-1] + self.counts[-1])

    def at(self, final_time: Array, values: Array, time: Array) -> Array:
        """Rows (r, n) of the polynomials through `values` (n, nodes, r) at `time` (n,), one each.

        `final_time` (n,) is that of each reference; before its begin and after its end it is held.
        """
        starts = self.start[0] + self.start[1] * final_time[:, None]
        inside = np.minimum(np.maximum(time, starts[:, 0]), final_time)
        segment = (starts[:, 1:] <= inside[:, None]).sum(axis=1)
        half = self.half_length[0][segment] + self.half_length[1][segment] * final_time
        start = self.start[0][segment] + self.start[1][segment] * final_time
        basis = self._basis(segment, (inside - start) / half - 1.0)
        last = self.counts[segment] - 1
        slots = np.minimum(np.arange(len(basis))[:, None], last)  # padding reads the last node
        n, nodes, rows = values.shape
        own = values.reshape(n * nodes, rows)
        terms = own.take(self.first_node[segment] + slots + np.arange(n) * nodes, axis=0)
        terms *= basis[:, :, None]
        # node after node, whatever the number of flights: the same bits in company, alone, and in C
        return np.ascontiguousarray(np.add.reduce(terms, axis=0).T)

    def _basis(self, segment: NDArray[np.intp], tau: Array) -> Array:
        """Eq. (1), (k, n)."""
        k = self.nodes.shape[1]
        real = np.arange(k)[:, None] < self.counts[segment]
        factors = np.where(real, tau - self.nodes[segment].T, 1.0)
        basis, right = self.weights[segment].T.copy(), np.ones_like(factors)
        left = np.ones_like(tau)
        for i in range(1, k):
            left = left * factors[i - 1]
            basis[i] *= left
            np.multiply(right[k - i], factors[k - i], out=right[k - 1 - i])
        basis *= right
        return basis
