"""The field of optima of a table: which of them passes through a state at an instant.

Through every state of a field of optima leads one of them, and it is the optimum from there on: a flight
that has left its reference finds the next one in the table, where its entry parameters would have been.
Held at the nodes of the grid are the six states at fixed instants; between them each axis has the
polynomial through all its points (of three points that of the order quadratic). The entry parameters are

    min over q   ‖(x(t_k; q, f) − x) / s‖² + ‖(q − q₀) / (w · width)‖²,     q in the box of the grid,      (1)

f the factors, q₀ the entry parameters that were measured. The second term decides where the first does
not: a flight's entry state is forgotten on the way to the target. Gauss–Newton, a fixed number of steps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.onboard.plausibility import on_turn_of
from ampi.onboard.row_layout import N_STATES
from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]

N_MOVED = N_STATES - 1  # the bank angle is steered to: it is no part of a match
LONGITUDE, AZIMUTH = 1, 5


class OptimumField:
    """States of all optima of a table at fixed `instants` (s); parameters `free` of it are sought.

    Parameters
    ----------
    table
        Of d parameters.
    instants
        (k,), s since the entry interface; after a case's end its last state stands.
    free
        Numbers of the axes that (1) moves; the others are given.
    """

    def __init__(
        self, table: GuidanceTable, instants: ArrayLike, free: Sequence[int]
    ) -> None:
        self.instants = np.array(instants, dtype=float)
        self.free = tuple(free)
        self.given = tuple(i for i in range(len(table.axes)) if i not in self.free)
        self._axes = [table.axes[i] for i in (*self.given, *self.free)]
        self.low = np.array([table.axes[i][0] for i in self.free])
        self.high = np.array([table.axes[i][-1] for i in self.free])
        self.states = _states_at(table, self.instants, (*self.given, *self.free))
        self.states.setflags(write=False)

    def matched(
        self,
        instant: int,
        state: Array,
        measured: Array,
        scale: Array,
        trust: float,
        steps: int = 4,
    ) -> tuple[Array, Array]:
        """Parameters (n, d) of the optima nearest to `state` (6, n), and what is left (6, n).

        `measured` (n, d) holds q₀ and the factors; `scale` (6,) is s, `trust` w.
        """
        given = measured[:, self.given]
        start = measured[:, self.free]
        table = self._at_factors(instant, given)
        width = self.high - self.low
        q = np.clip(start, self.low, self.high)
        for _ in range(steps):
            value, slopes = self._value_and_slopes(table, q)
            miss = _difference(value, state.T) / scale
            jacobian = slopes * (width / scale[:, None])  # (n, 6, f), of shares of the width
            pull = (q - start) / width / trust
            normal = (jacobian[:, :, :, None] * jacobian[:, :, None, :]).sum(axis=1)
            normal += np.eye(len(self.free)) / trust**2
            right = (jacobian * miss[:, :, None]).sum(axis=1) + pull / trust
            q = q - width * _solved(normal, right)
            q = np.clip(q, self.low, self.high)
        value, _ = self._value_and_slopes(table, q)
        found = measured.copy()
        found[:, self.free] = q
        return found, _difference(state.T, value).T

    def _at_factors(self, instant: int, given: Array) -> Array:
        """States (n, free axes…, 6) of the grid's optima with these factors (n, g)."""
        n = len(given)
        table = np.broadcast_to(self.states[instant], (n, *self.states[instant].shape))
        for i in range(len(self.given)):
            weights = _weights(self._axes[i], given[:, i])[0]
            table = _contracted(table, weights)
        return table

    def _value_and_slopes(self, table: Array, q: Array) -> tuple[Array, Array]:
        """States (n, 6) and their derivatives (n, 6, f) at the parameters q (n, f)."""
        value, slopes = table, []
        for i in range(len(self.free)):
            weights, own = _weights(self._axes[len(self.given) + i], q[:, i])
            slopes = [_contracted(slope, weights) for slope in slopes]
            slopes.append(_contracted(value, own))
            value = _contracted(value, weights)
        return value, np.stack(slopes, axis=-1)


def _contracted(table: Array, weights: Array) -> Array:
    """Σ_j w_j table[:, j]; one after the other: a flight has the same bits alone and in company."""
    shape = (len(weights), *(1,) * (table.ndim - 2))
    total = weights[:, 0].reshape(shape) * table[:, 0]
    for j in range(1, weights.shape[1]):
        total = total + weights[:, j].reshape(shape) * table[:, j]
    return total


def _weights(axis: Array, p: Array) -> tuple[Array, Array]:
    """Lagrange's weights (n, k) of the points of an axis at p (n,), clipped to it, and derivatives."""
    at = np.clip(p, axis[0], axis[-1])
    weights, slopes = np.empty((2, len(p), len(axis)))
    for j, own in enumerate(axis):
        others = [x for i, x in enumerate(axis) if i != j]
        weight, slope = np.ones_like(at), np.zeros_like(at)
        for x in others:
            slope = (slope * (at - x) + weight) / (own - x)
            weight = weight * (at - x) / (own - x)
        weights[:, j], slopes[:, j] = weight, slope
    return weights, slopes


def _difference(state: Array, other: Array) -> Array:
    """(n, 6); of longitudes and azimuths the short way."""
    error = state - other
    for row in (LONGITUDE, AZIMUTH):
        error[:, row] = on_turn_of(error[:, row], 0.0)
    return error


def _solved(matrix: Array, right: Array) -> Array:
    """x of A x = b for A (n, f, f), positive definite, and b (n, f)."""
    return np.linalg.solve(matrix, right[:, :, None])[:, :, 0]


def _states_at(table: GuidanceTable, instants: Array, order: tuple[int, ...]) -> Array:
    """(k, axes in `order`…, 6)."""
    shape = tuple(len(axis) for axis in table.axes)
    nodes = np.swapaxes(table.values[..., table.layout.states, :], -1, -2)
    nodes = np.ascontiguousarray(nodes.reshape(-1, *nodes.shape[-2:]))
    final = table.final_time.ravel()
    moved = (*order, len(shape))
    return np.stack(
        [
            np.ascontiguousarray(
                table.segments.at(final, nodes, np.full(len(final), t))[:N_MOVED]
                .T.reshape(*shape, N_MOVED)
                .transpose(moved)
            )
            for t in instants
        ]
    )
