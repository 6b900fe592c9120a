"""From the measured parameters, the entry state above all, to the reference: AMPI, online part.

subspace (Algorithm 1) → interpolation (Algorithm 2) → LD→HD, T̃_HD = T_LD P_FRP (Eq. (31)) and
t̃ = a + b t_f (Eq. (33), phase by phase)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.onboard.health import Health
from ampi.onboard.interpolation import Interpolator
from ampi.onboard.plausibility import SANE, TURN, numbers, on_turn_of
from ampi.onboard.row_layout import RowLayout
from ampi.onboard.subspace import Order
from ampi.onboard.table import GuidanceTable
from ampi.shown import Tabulated

Array = NDArray[np.float64]


class Mode(Enum):
    """How the reference is made."""

    NOMINAL = "nominal"  # the hypercentre's optimum, whatever the parameters
    MPI = "mpi"  # multilinear over the outer 2^d vertices
    AMPI = "ampi"  # multilinear over the selected 2^d cell
    # over the same table, every axis in the order of this name
    NEAREST = "nearest"
    QUADRATIC = "quadratic"
    CUBIC = "cubic"
    SECOND_DIFFERENCES = "second_differences"
    HERMITE = "hermite"  # of a table with sensitivities alone

    @classmethod
    def _missing_(cls, value: object) -> Mode:
        names = ", ".join(mode.value for mode in cls)
        raise ValueError(f"mode: expected one of {names}, got {value!r}")


_ORDER = {
    Mode.NOMINAL: Order.NEAREST,
    Mode.MPI: Order.LINEAR,
    Mode.AMPI: Order.LINEAR,
    Mode.NEAREST: Order.NEAREST,
    Mode.QUADRATIC: Order.QUADRATIC,
    Mode.CUBIC: Order.CUBIC,
    Mode.SECOND_DIFFERENCES: Order.SECOND_DIFFERENCES,
    Mode.HERMITE: Order.HERMITE,
}


def order_of(mode: Mode) -> Order:
    """That of every axis, where none is given."""
    return _ORDER[mode]


FAR = 0.2  # of an axis' range: further outside, the boundary trajectory is not near
# of the greatest number on an axis: its edge in another unit differs in the last digits, and is inside
ROUNDING = 16.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False, kw_only=True)
class NodalReference:
    """The low-density reference, which is all that is flown; n nodes. `nodal` is overwritten, too."""

    nodal: Array  # (r, n), the table's rows; SI, rad
    layout: RowLayout  # of the rows
    final_time: float  # s
    cell: tuple[int, ...]  # first grid index on each axis
    clipped: tuple[bool, ...]  # axes on which p lies outside the hypercube
    excess: tuple[float, ...]  # how far p lies beyond each axis, as share of its range; 0 inside
    hole: bool  # part of it is borrowed from the neighbour of a case without solution
    parameters: tuple[float, ...]  # the measured p, as it was given
    health: Health  # GOOD, or why this reference is not what was asked

    @property
    def inside(self) -> bool:
        """Whether the parameters lie inside the hypercube."""
        return not any(self.clipped)


@dataclass(frozen=True, eq=False, kw_only=True)
class Reference(NodalReference, Tabulated):
    """The high-density reference; m points. Arrays are overwritten by the next entry: `copy`."""

    times: Array  # (m,), s since the entry interface
    rows: Array  # (r, m); SI, rad
    # parts of `rows`
    states: Array = field(init=False)  # (7, m): h, θ, φ, V, γ, ψ, σ
    bank_rate: Array = field(init=False)  # (m,), rad/s
    gains: Array = field(
        init=False
    )  # (7, m): command = bank_rate − gains · (state − its reference)

    def __post_init__(self) -> None:
        object.__setattr__(self, "states", self.rows[self.layout.states])
        object.__setattr__(self, "bank_rate", self.rows[self.layout.bank_rate])
        object.__setattr__(self, "gains", self.rows[self.layout.gains])

    def copy(self) -> Reference:
        """A reference of its own memory."""
        return replace(
            self, times=self.times.copy(), rows=self.rows.copy(), nodal=self.nodal.copy()
        )


class ReferenceGenerator:
    """Makes references from a table in one mode. All memory is allocated here, at start-up.

    `orders` are those of the axes, if not all in that of the mode.
    """

    def __init__(
        self, table: GuidanceTable, mode: Mode, orders: tuple[Order, ...] | None = None
    ) -> None:
        self.orders = (_ORDER[mode],) * len(table.axes) if orders is None else tuple(orders)
        _check(self.orders, table)
        # what p is measured against is the whole table's; plain floats are faster than numpy's
        self._nominal = [float(axis[i]) for axis, i in zip(table.axes, table.centre, strict=True)]
        self._edges = [(float(axis[0]), float(axis[-1])) for axis in table.axes]
        self._circular = [i in table.circular for i in range(len(table.axes))]
        self._rounding = [
            ROUNDING * max(abs(low), abs(high), TURN if circular else 0.0)
            for (low, high), circular in zip(self._edges, self._circular, strict=True)
        ]
        if mode is Mode.MPI:
            table = table.corners()
        elif mode is Mode.NOMINAL:
            table = table.nominal()
        self.table, self.mode = table, mode
        grid = tuple(len(axis) for axis in table.axes)
        (n, m), rows = table.conversion.shape, len(table.layout)
        # The final time rides along as one more column: one interpolation serves both.
        packed = np.empty((*grid, rows * n + 1))
        packed[..., :-1] = table.values.reshape(*grid, rows * n)
        packed[..., -1] = table.final_time
        self._interpolator = Interpolator(table.axes, packed, self.orders, table.sensitivities)
        self._holes = None if table.solved is None else ~table.solved.ravel()
        self._low = np.zeros((rows, n))
        self._high = np.zeros((rows, m))
        self._times = np.zeros(m)

    @property
    def nodal_values(self) -> Array:
        """Low-density rows (r, n) of the last reference, before the conversion."""
        return self._low

    def reference(self, parameters: ArrayLike) -> Reference:
        """Reference for the measured parameters p (d,) of the table (SI, rad), in its order.

        Never an exception: a parameter that is no finite number, or each if p is no vector of d of them,
        counts as nominal, and `health` says so.
        """
        low, table = self.nodal(parameters), self.table
        np.matmul(self._low, table.conversion, out=self._high)
        fixed, free = table.high_density_time
        np.multiply(free, low.final_time, out=self._times)
        np.add(self._times, fixed, out=self._times)
        return Reference(times=self._times, rows=self._high, **vars(low))

    def nodal(self, parameters: ArrayLike) -> NodalReference:
        """The same before the conversion to high density."""
        d = len(self._edges)
        measured = numbers(parameters, d).tolist()
        placed, excess = [0.0] * d, [0.0] * d
        for i in range(d):
            placed[i], excess[i] = self._placed(i, measured[i])
        clipped = [share > 0.0 and self.mode is not Mode.NOMINAL for share in excess]
        row = self._interpolator(placed)
        self._low[...] = row[:-1].reshape(self._low.shape)
        hole = self._holes is not None and self._interpolator.weighs(self._holes)
        return NodalReference(
            nodal=self._low,
            layout=self.table.layout,
            final_time=float(row[-1]),
            cell=self._interpolator.first,
            clipped=tuple(clipped),
            excess=tuple(excess),
            hole=hole,
            parameters=tuple(measured),
            health=_health(measured, any(clipped), excess, hole),
        )

    def _placed(self, i: int, p: float) -> tuple[float, float]:
        """Parameter i as it is looked up, and how far it lies outside, in shares of its range."""
        low, high = self._edges[i]
        if low <= p <= high:
            return p, 0.0
        if not abs(p) < SANE:
            return self._nominal[i], np.inf
        if self._circular[i]:
            p = float(on_turn_of(p, 0.5 * (low + high)))
        edge = low if p < low else high if p > high else p
        beyond = abs(p - edge)
        if beyond <= self._rounding[i]:
            return edge, 0.0
        return p, beyond / (high - low) if high > low else np.inf


def _check(orders: tuple[Order, ...], table: GuidanceTable) -> None:
    """On the ground: the table has what its orders need."""
    if len(orders) != len(table.axes):
        raise ValueError(f"orders: expected {len(table.axes)}, one an axis, got {len(orders)}")
    if Order.HERMITE in orders and table.sensitivities is None:
        raise ValueError(
            "orders: hermite needs a table with sensitivities, and this one has none; build the "
            "database with them, or take another order"
        )


def _health(measured: list[float], clipped: bool, excess: list[float], hole: bool) -> Health:
    if max(excess, default=0.0) > FAR:
        known = all(abs(p) < SANE for p in measured)
        return Health.FAR_OUTSIDE if known else Health.BAD_PARAMETERS
    if hole:
        return Health.HOLE_REFERENCE
    return Health.BOUNDARY_REFERENCE if clipped else Health.GOOD
