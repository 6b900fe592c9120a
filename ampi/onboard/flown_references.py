"""The references of n flights that are being flown, and their rows at one instant each.

A row at an instant is the polynomial of its segment there (`segments`). The instant is the time, or
that at which a number a that increases along the reference, such as the energy that has been spent, has
a given value: between the high-density points i and i + 1 it is, with w the share of the way in a,

    t = t_i + h d w + h w (1 − w) [(s_i − d)(1 − w) − (s_{i+1} − d) w],                     (1)

the cubic with the slopes s of the parabolas through the neighbours; d is the slope of the line and h
the way. Along the line alone an entry of SHEFEX-3 is up to 22 m beside the altitude of its energy. A
neighbour whose slope is not within a factor of two is none: then the other's parabola serves both ends.
Where the look-up changes from time to energy there is none on either side, and a value in the way is
that of the nearer end, further along the slope of the neighbour beyond it. All memory is allocated when
the flights begin.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.reference import NodalReference
from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]
ALIKE = 2.0  # slopes of neighbours, at the most
# of times (n, m) and rows (n, m, r) at the high-density points; None: the time itself
Along = Callable[[Array, Array], Array | None]


class FlownReferences:
    """References of a table, one for each of n flights."""

    def __init__(self, n: int, table: GuidanceTable) -> None:
        self.table = table
        self.nodal = np.zeros((n, table.segments.n_nodes, len(table.layout)))
        self.final_time = np.zeros(n)
        self.health = np.zeros(n, dtype=np.int64)
        self.clipped, self.hole = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        self._along: Array | None = None
        self._points = _read_by_point(table.conversion)
        self._pointer = np.zeros(n, dtype=np.intp)

    def __len__(self) -> int:
        return len(self.final_time)

    @property
    def first(self) -> Array:
        """Rows (r, n) at the begin."""
        return self.nodal[:, 0].T

    @property
    def end(self) -> Array:
        """Where each reference ends (n,): its final time, or the last value along it."""
        return self.final_time if self._along is None else self._along[:, -1]

    def set(self, flight: int, reference: NodalReference) -> None:
        """Fly `reference` from now on; `look_up_by` comes next."""
        self.nodal[flight] = reference.nodal.T
        self.final_time[flight] = reference.final_time
        self.health[flight] = int(reference.health)
        self.clipped[flight], self.hole[flight] = not reference.inside, reference.hole

    def look_up_by(self, along: Along) -> None:
        """What is looked up by."""
        fixed, free = self.table.high_density_time
        self._times = fixed + free * self.final_time[:, None]
        nodes, weights = self._points
        # node after node, as C does: a matrix product would have other bits
        rows = weights[0, :, None] * self.nodal[:, nodes[0]]
        for node, weight in zip(nodes[1:], weights[1:], strict=True):
            rows += weight[:, None] * self.nodal[:, node]
        self._along = along(self._times, rows)

    def rewind(self) -> None:
        """The next look-up is at the begin: it need not walk there."""
        self._pointer[:] = 0

    def at(self, value: Array) -> Array:
        """Rows (r, n) where `value` (n,) is reached; held at both ends."""
        time = value if self._along is None else self._instant(self._along, value)
        return self.table.segments.at(self.final_time, self.nodal, time)

    def _instant(self, along: Array, value: Array) -> Array:
        """Times (n,) at which `along` (n, m), increasing, is `value`; those of the ends beyond."""
        n, m = along.shape
        points, times = along.ravel(), self._times.ravel()
        first, last = np.arange(n, dtype=np.intp) * m, m - 2
        for _ in range(last + 1):  # bounded: a pointer passes every point once, mostly none
            here = first + self._pointer
            begin, end = points.take(here), points.take(here + 1)
            forward, back = end <= value, begin > value
            forward &= self._pointer < last
            back &= self._pointer > 0
            if not (forward.any() or back.any()):
                break
            self._pointer += forward
            self._pointer -= back
        way, at_begin, at_end = end - begin, times.take(here), times.take(here + 1)
        w = np.minimum(np.maximum((value - begin) / way, 0.0), 1.0)
        slope = (at_end - at_begin) / way
        before, left = _beside(points, times, first + np.maximum(self._pointer - 1, 0), here)
        after, right = _beside(
            points, times, first + np.minimum(self._pointer + 2, m - 1), here + 1
        )
        alike, also = _is_alike(left, slope), _is_alike(right, slope)
        bend = np.where(alike, way * (left - slope) / (way + before), 0.0)
        other = np.where(also, way * (right - slope) / (way + after), 0.0)
        bend, other = np.where(alike, bend, -other), np.where(also, other, -bend)
        bent = (1.0 - w) * bend - w * other
        instant = at_begin + way * w * (slope + (1.0 - w) * bent)
        jumps = (left > 0.0) & (right > 0.0) & ~alike & ~also
        inside = np.minimum(np.maximum(value, begin), end)
        nearer = np.where(
            w < 0.5,
            np.minimum(at_begin + (inside - begin) * left, at_end),
            np.maximum(at_end - (end - inside) * right, at_begin),
        )
        return np.where(jumps, nearer, instant)


def _beside(
    points: Array, times: Array, beside: NDArray[np.intp], edge: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Way and slope between two neighbours; slope 0 where there is none."""
    way = np.abs(points.take(beside) - points.take(edge))
    is_there = way > 0.0
    slope = np.abs(times.take(beside) - times.take(edge)) / np.where(is_there, way, 1.0)
    return way, np.where(is_there, slope, 0.0)


def _is_alike(slope: Array, other: Array) -> NDArray[np.bool_]:
    alike: NDArray[np.bool_] = (slope <= ALIKE * other) & (other <= ALIKE * slope)
    return alike


def _read_by_point(conversion: Array) -> tuple[NDArray[np.intp], Array]:
    """Which nodes each point of an LD→HD matrix reads, in order, and their weights: (k, m)."""
    used = conversion != 0.0
    count = len(used)
    first, last = used.argmax(axis=0), count - 1 - used[::-1].argmax(axis=0)
    nodes = first + np.arange((last - first).max() + 1)[:, None]
    held = np.minimum(nodes, count - 1)
    weights = np.where(nodes <= last, np.take_along_axis(conversion, held, axis=0), 0.0)
    return held, weights
