"""The collocation equations of a reference on board: slopes of its polynomials, and what they miss.

On a segment with nodes τ_0 … τ_k, weights w of `segments` and half-length h the polynomial x(τ) has

    ẋ(τ_i) = (1/h) Σ_j D_ij x_j,   D_ij = (w_j/w_i) / (τ_i − τ_j),   Σ_j D_ij = 0,               (1)

and a flight has the defect ẋ − f(x, u, t) zero at the collocated nodes τ_1 … τ_k. The optima of a table
do. Interpolated between them it is not quite zero there; between the nodes it never is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.segments import Segments

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SegmentRule:
    """One segment: k collocated nodes after its first, and the k points midway between its nodes."""

    nodes: slice  # all k + 1 of them, among those of a reference
    slopes: Array  # (k, k + 1): D at the collocated nodes
    middle: Array  # (k, k + 1): from nodal values to those at the midpoints
    middle_slopes: Array  # (k, k + 1)
    start: tuple[float, float]  # (a, b) of a + b t_f
    half_length: tuple[float, float]
    middles: Array  # (k,): τ of the midpoints

    @property
    def collocated(self) -> slice:
        """The nodes after the first."""
        return slice(self.nodes.start + 1, self.nodes.stop)

    def half(self, final_time: Array) -> Array:
        """Half-lengths (s) of n references."""
        return self.half_length[0] + self.half_length[1] * final_time

    def middle_times(self, final_time: Array) -> Array:
        """Times (n, k) of the midpoints."""
        start = self.start[0] + self.start[1] * final_time
        return np.asarray(start[:, None] + self.half(final_time)[:, None] * (1.0 + self.middles))


@dataclass(frozen=True, eq=False)
class Collocation:
    """The rules of all segments, and the times a + b t_f of all nodes."""

    rules: tuple[SegmentRule, ...]
    node_time: tuple[Array, Array]

    @classmethod
    def of(cls, segments: Segments) -> Collocation:
        """Those of a table's segments."""
        rules = tuple(_rule(segments, s) for s in range(len(segments)))
        fixed, free = np.zeros(segments.n_nodes), np.zeros(segments.n_nodes)
        for s, rule in enumerate(rules):
            along = 1.0 + segments.nodes[s, : segments.counts[s]]
            fixed[rule.nodes] = rule.start[0] + rule.half_length[0] * along
            free[rule.nodes] = rule.start[1] + rule.half_length[1] * along
        return cls(rules, (fixed, free))

    def times(self, final_time: Array) -> Array:
        """Times (n, nodes) of n references."""
        return np.asarray(self.node_time[0] + self.node_time[1] * final_time[:, None])


def _rule(segments: Segments, s: int) -> SegmentRule:
    count, first = int(segments.counts[s]), int(segments.first_node[s])
    nodes, weights = segments.nodes[s, :count], segments.weights[s, :count]
    difference = nodes[:, None] - nodes
    np.fill_diagonal(difference, 1.0)
    slopes = weights / weights[:, None] / difference
    np.fill_diagonal(slopes, 0.0)
    np.fill_diagonal(slopes, -slopes.sum(axis=1))
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    away = np.repeat((middles[:, None] - nodes)[:, None, :], count, axis=1)
    away[:, range(count), range(count)] = 1.0
    middle = weights * away.prod(axis=2)
    return SegmentRule(
        nodes=slice(first, first + count),
        slopes=slopes[1:],
        middle=middle,
        middle_slopes=middle @ slopes,  # the derivative is a polynomial through its nodal values
        start=(float(segments.start[0, s]), float(segments.start[1, s])),
        half_length=(float(segments.half_length[0, s]), float(segments.half_length[1, s])),
        middles=middles,
    )
