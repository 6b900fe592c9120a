"""Interpolation of a table at one point of parameter space: Sagliano et al. 2016, Eq. (16).

A tensor product is a weight for each vertex of its subspace,

    s(p) = Σ_v w_v T_v,    w_v = ((w_0 w_1) w_2) …  over the axes,

the vertices in C order (last axis fastest) and summed in this order, one after the other: the same bits
as a loop in C. It reads each vertex once; Algorithm 2 of the paper, one axis at a time, passes over ever
smaller arrays, and is slower for them.

A table is interpolated by one running sum over several of them:

    1. one of the values, of every axis' order; of an axis with a correction, linear
    2. for each axis with a correction, in order: one of the values, with the correction's weights there
    3. for each axis of order Hermite, in order: one of the sensitivities to its parameter
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.subspace import (
    Order,
    hermite_weights,
    located,
    point_weights,
    second_difference_weights,
)

Array = NDArray[np.float64]

AT_ONCE = 64  # vertices multiplied together: what they fill stays in the cache


class _AxisWeights:
    """Weights on one axis: of its order, and of its correction if it has one."""

    def __init__(self, axis: Array, order: Order) -> None:
        n = len(axis)
        self.axis: list[float] = axis.tolist()  # plain floats are faster than numpy's
        self.first, self.correction_first = 0, 0
        self.base = np.zeros(min(order.points, n))
        self.slopes = np.zeros(2 if order is Order.HERMITE and n > 1 else 0)
        curved = order is Order.SECOND_DIFFERENCES and n > 2
        self.correction = np.zeros(min(4, n) if curved else len(self.slopes))
        self.parts = (self.base, self.correction, self.slopes)

    def select(self, parameter: float) -> None:
        """The subspace and the weights of a parameter."""
        axis = self.axis
        inside, below, _ = located(axis, parameter)
        self.first = point_weights(axis, inside, below, len(self.base), self.base)
        if len(self.slopes):
            self.correction_first = hermite_weights(
                axis, inside, below, self.correction, self.slopes
            )
        elif len(self.correction):
            self.correction_first = second_difference_weights(axis, inside, below, self.correction)


class _WeightedSum:
    """Σ w_v T_v over the tensor products of one table: a list of vertices and their weights.

    A product has for each axis the places of its weights in the pool of all; `corrected` is the axis of
    its correction, None if it is of none. All that numpy would have to broadcast is spread here once: it
    does so in buffers that it allocates.
    """

    def __init__(self, rows: Array, shape: tuple[int, ...], layers: int) -> None:
        """Of a table (vertices · layers, columns) on a grid of this shape."""
        self.rows, self.layers = rows, layers
        self.strides = [int(np.prod(shape[i + 1 :])) for i in range(len(shape))]
        self.corrected: list[int | None] = []
        self._places: list[NDArray[np.intp]] = []
        self._offsets: list[NDArray[np.intp]] = []

    def append(self, places: list[range], corrected: int | None = None) -> None:
        """One more product; of a table with layers, of the layer of the corrected axis."""
        window = np.indices([len(own) for own in places]).reshape(len(places), -1)
        layer = corrected if corrected is not None and self.layers > 1 else 0
        own = [np.array(r, dtype=np.intp)[w] for r, w in zip(places, window, strict=True)]
        self._places.append(np.array(own))
        strides = np.array(self.strides, dtype=np.intp)
        self._offsets.append(self.layers * (strides @ window) + layer)
        self.corrected.append(corrected)

    def allocate(self) -> None:
        """No more products."""
        sizes = [len(offsets) for offsets in self._offsets]
        size, columns = sum(sizes), self.rows.shape[1]
        self.places, self.offsets = np.hstack(self._places), np.concatenate(self._offsets)
        self.owner = np.repeat(np.arange(len(sizes)), sizes)
        self.starts = np.zeros(len(sizes), dtype=np.intp)
        self.vertices, self.weights = np.zeros(size, dtype=np.intp), np.zeros(size)
        self._factors = np.zeros(self.places.shape)
        self._marked, self._weighty = np.zeros((2, size), dtype=bool)
        self._weighted = _apart(self.rows, min(AT_ONCE, size) + 1)
        self._wide = np.zeros((min(AT_ONCE, size), columns))

    def select(self, axes: list[_AxisWeights], pool: Array) -> None:
        """List the vertices and weights of what the axes have selected."""
        first = sum(n * axis.first for n, axis in zip(self.strides, axes, strict=True))
        for k, i in enumerate(self.corrected):
            moved = 0 if i is None else axes[i].correction_first - axes[i].first
            self.starts[k] = self.layers * (first + (0 if i is None else self.strides[i] * moved))
        self.starts.take(self.owner, out=self.vertices, mode="clip")
        np.add(self.vertices, self.offsets, out=self.vertices)
        pool.take(self.places, out=self._factors, mode="clip")
        np.multiply.reduce(self._factors, axis=0, out=self.weights)

    def add(self, total: Array, *, begin: bool) -> None:
        """total ← Σ w_v T_v to begin with, else total + Σ w_v T_v, in the order of the list."""
        for start in range(0, len(self.weights), AT_ONCE):
            vertices = self.vertices[start : start + AT_ONCE]
            weighted, wide = self._weighted[1 : len(vertices) + 1], self._wide[: len(vertices)]
            # "clip": numpy would write into a buffer, to keep the output if an index were wrong
            self.rows.take(vertices, axis=0, out=weighted, mode="clip")
            wide[...] = self.weights[start : start + AT_ONCE, None]
            np.multiply(weighted, wide, out=weighted)
            if not begin:
                self._weighted[0] = total
                weighted = self._weighted[: len(vertices) + 1]
            np.add.reduce(weighted, axis=0, out=total)
            begin = False

    def weighs(self, marked: NDArray[np.bool_]) -> bool:
        """Whether a marked vertex has a weight that is not zero."""
        marked.take(self.vertices, out=self._marked, mode="clip")
        np.not_equal(self.weights, 0.0, out=self._weighty)
        np.logical_and(self._marked, self._weighty, out=self._marked)
        return bool(self._marked.any())


def _apart(rows: Array, n: int) -> Array:
    """Memory for n rows, into the second of which and on the first of `rows` are copied fast.

    Copying takes ten times as long where source and destination lie less than 32 bytes apart modulo a
    page of memory, the destination behind: its stores look as if they overtook the loads.
    """
    columns = rows.shape[1]
    spare = np.zeros(n * columns + 4)
    distance = (spare[columns:].ctypes.data - rows.ctypes.data) % 4096
    shift = 4 if distance < 32 else 0
    return spare[shift : shift + n * columns].reshape(n, columns)


class Interpolator:
    """Evaluates a table at one point of parameter space, each axis by its order.

    All memory is allocated here.

    Parameters
    ----------
    axes
        d strictly increasing axes.
    values
        (n_1 … n_d, columns), C-contiguous; not copied.
    orders
        One for each axis.
    sensitivities
        ∂values/∂p (n_1 … n_d, d, columns), C-contiguous; not copied. Needed by order Hermite alone.
    """

    def __init__(
        self,
        axes: Sequence[Array],
        values: Array,
        orders: Sequence[Order],
        sensitivities: Array | None = None,
    ) -> None:
        *shape, columns = values.shape
        self._axes = [_AxisWeights(a, order) for a, order in zip(axes, orders, strict=True)]
        self._row = np.zeros(columns)
        self._values = _WeightedSum(values.reshape(-1, columns), tuple(shape), 1)
        self._sums = [self._values]
        if sensitivities is not None and any(len(axis.slopes) for axis in self._axes):
            rows = sensitivities.reshape(-1, columns)
            self._sums.append(_WeightedSum(rows, tuple(shape), len(shape)))
        self._parts = [part for axis in self._axes for part in axis.parts]
        self._pool = np.zeros(sum(len(part) for part in self._parts))
        self._list_products()

    def _list_products(self) -> None:
        ends = np.cumsum([len(part) for part in self._parts]).tolist()
        places = [range(end - len(part), end) for end, part in zip(ends, self._parts, strict=True)]
        base, corrections, slopes = places[0::3], places[1::3], places[2::3]
        self._values.append(base)
        for total, own in zip(self._sums, (corrections, slopes), strict=False):
            for i, corrected in enumerate(own):
                if len(corrected):
                    total.append([*base[:i], corrected, *base[i + 1 :]], i)
            total.allocate()

    def __call__(self, parameters: Sequence[float]) -> Array:
        """Interpolated row (columns,) at p (d,); the array is overwritten by the next call."""
        for axis, p in zip(self._axes, parameters, strict=True):
            axis.select(p)
        np.concatenate(self._parts, out=self._pool)
        for each in self._sums:
            each.select(self._axes, self._pool)
            each.add(self._row, begin=each is self._values)
        return self._row

    @property
    def first(self) -> tuple[int, ...]:
        """First grid index of the last subspace on each axis, corrections aside."""
        return tuple(axis.first for axis in self._axes)

    def weighs(self, marked: NDArray[np.bool_]) -> bool:
        """Whether a marked vertex (of all, flat in C order) had a weight that is not zero."""
        return self._values.weighs(marked)
