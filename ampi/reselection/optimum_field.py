"""The field of optima of a table: which of them passes nearest to a state at an instant.

Through a state leads one optimum of the field, and from there on it is the optimum: a flight that has
left its reference finds the next one in the table, by the entry parameters that it would have had. With
x the state at the instant, f the factors, q₀ the measured entry parameters,

    min over q   ‖(x̂(q, f) − x) / s‖² + ‖(q − q₀) / (w · width)‖²,    q in the box of the grid.    (1)

The second term decides where the first does not: on the way to the target a flight forgets where it has
entered. x̂ is between the nodes of each axis the polynomial through all of them (of three the order
quadratic); Gauss–Newton, a fixed number of steps. One clock: all flights look at one instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.plausibility import on_turn_of
from ampi.onboard.row_layout import N_STATES
from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]

N_MATCHED = N_STATES - 1  # all but the bank angle, which is steered to
ANGLES_ON_A_TURN = (1, 5)  # longitude and azimuth


@dataclass(frozen=True, eq=False)
class MatchWeights:
    """What (1) weighs by."""

    scale: Array  # (6,) s: altitude (m), longitude, latitude (rad), speed (m/s), two angles (rad)
    entry: float  # w
    steps: int


class OptimumField:
    """Of a table of d parameters, those numbered `given` are factors and told; the others are sought."""

    def __init__(self, table: GuidanceTable, given: Sequence[int]) -> None:
        self.given = tuple(given)
        self.free = tuple(i for i in range(len(table.axes)) if i not in self.given)
        order = (*self.given, *self.free)
        self._table, self._axes = table, [table.axes[i] for i in order]
        self._shape = tuple(len(axis) for axis in self._axes)
        values = np.moveaxis(table.values, order, range(len(order)))
        values = values[..., table.layout.states, :][..., :N_MATCHED, :]
        nodes = values.reshape(-1, *values.shape[-2:])
        self._nodes = np.ascontiguousarray(np.swapaxes(nodes, 1, 2))
        self._final_time = np.moveaxis(table.final_time, order, range(len(order))).ravel()
        self._low = np.array([table.axes[i][0] for i in self.free])
        self._high = np.array([table.axes[i][-1] for i in self.free])

    def states(self, time: float) -> Array:
        """Those of all optima at `time` (s): (given axes…, free axes…, 6); held after an end."""
        times = np.full(len(self._final_time), time)
        found = self._table.segments.at(self._final_time, self._nodes, times)
        return np.ascontiguousarray(found.T).reshape(*self._shape, N_MATCHED)

    def matched(self, time: float, state: Array, asked: Array, weights: MatchWeights) -> Array:
        """Parameters (n, d) of the optima nearest to `state` (6, n) at `time` (s), Eq. (1).

        `asked` (n, d) holds q₀ and the factors; beyond the grid both count as its edge. What is no
        number comes out as none.
        """
        table = self._at_factors(self.states(time), asked[:, self.given])
        start, width = asked[:, self.free], self._high - self._low
        at, share = np.clip(start, self._low, self._high), 1.0 / weights.entry
        prior = np.eye(len(self.free)) * (share * share)
        for _ in range(weights.steps):
            value, slopes = self._value_and_slopes(table, at)
            miss = _difference(value, state.T) / weights.scale
            slopes = slopes * (width / weights.scale[:, None])
            matrix = prior + _summed(slopes[:, :, :, None] * slopes[:, :, None, :])
            right = (at - start) / width * (share * share) + _summed(slopes * miss[:, :, None])
            at = np.clip(at - width * _solved(matrix, right), self._low, self._high)
        found = asked.copy()
        found[:, self.free] = at
        return found

    def _at_factors(self, states: Array, given: Array) -> Array:
        """States (n, free axes…, 6) of the grid's optima with these factors (n, g)."""
        table = np.broadcast_to(states, (len(given), *states.shape))
        for axis, factor in zip(self._axes, given.T, strict=False):
            table = _contracted(table, lagrange_weights(axis, factor)[0])
        return table

    def _value_and_slopes(self, table: Array, at: Array) -> tuple[Array, Array]:
        """States (n, 6) at the parameters (n, f), and their derivatives (n, 6, f)."""
        value, slopes = table, list[Array]()
        for axis, parameter in zip(self._axes[len(self.given) :], at.T, strict=True):
            weights, derivatives = lagrange_weights(axis, parameter)
            slopes = [_contracted(slope, weights) for slope in slopes]
            slopes.append(_contracted(value, derivatives))
            value = _contracted(value, weights)
        return value, np.stack(slopes, axis=-1)


def lagrange_weights(axis: Array, at: Array) -> tuple[Array, Array]:
    """Weights (n, k) of the k points of an axis at parameters (n,), and their derivatives.

    Parameters beyond the axis count as its edge.
    """
    at = np.clip(at, axis[0], axis[-1])
    weights, slopes = np.ones((len(at), len(axis))), np.zeros((len(at), len(axis)))
    for j, own in enumerate(axis):
        for other in np.delete(axis, j):
            slopes[:, j] = (slopes[:, j] * (at - other) + weights[:, j]) / (own - other)
            weights[:, j] *= (at - other) / (own - other)
    return weights, slopes


def _contracted(table: Array, weights: Array) -> Array:
    """Σ_j w_j table[:, j], one after the other: the same bits alone and in company."""
    shape = (len(weights), *(1,) * (table.ndim - 2))
    total = weights[:, 0].reshape(shape) * table[:, 0]
    for j in range(1, weights.shape[1]):
        total = total + weights[:, j].reshape(shape) * table[:, j]
    return total


def _summed(terms: Array) -> Array:
    """Over the states, the second axis, one after the other."""
    total = terms[:, 0]
    for k in range(1, terms.shape[1]):
        total = total + terms[:, k]
    return total


def _difference(state: Array, other: Array) -> Array:
    error = state - other
    for row in ANGLES_ON_A_TURN:
        error[:, row] = on_turn_of(error[:, row], 0.0)
    return error


def _solved(matrix: Array, right: Array) -> Array:
    """x of A x = b, A (n, f, f) positive definite: no pivots, and the same bits for any n."""
    a, x, size = matrix.copy(), right.copy(), right.shape[1]
    for k in range(size):
        for i in range(k + 1, size):
            share = a[:, i, k] / a[:, k, k]
            a[:, i] -= share[:, None] * a[:, k]
            x[:, i] -= share * x[:, k]
    for k in reversed(range(size)):
        for j in range(k + 1, size):
            x[:, k] -= a[:, k, j] * x[:, j]
        x[:, k] /= a[:, k, k]
    return x
