"""The guidance table as the C flies it: one blob of bytes that explains and checks itself.

    header   32 bytes: magic, byte-order mark, format, bytes of the body, CRC-32 of the body (zlib's),
             eight zeros
    body     in this order, each part padded with zeros to a multiple of eight bytes:
      sizes      16 × uint32, as `_sizes` lists them
      text       UTF-8: law, rows with units, axes, how the values are stored
      axes       d of uint32 points, order (1 to 5, as `ORDERS`), whether circular, 0; float64 least,
                 greatest and nominal parameter of the whole table, of which a mode may use a part
      segments   s of uint32 low-density nodes, high-density points, 0, 0; float64 (a, b) of its begin,
                 and of half its length, t = a + b t_f
      settings   float64: limits of bank angle, rate, acceleration; nominal cycle; the same limits of
                 the change of the angle of attack, 0: there is none; least and greatest angle of attack,
                 and its rate; middle and reach of plausible states (7 each); 16 gains of the law
      points     of each axis, float64
      matrix     of each segment: its nodes τ and their weights, padded to those of the widest; then its
                 part of the LD→HD matrix, [nodes][points]
      instants   a, then b, of the m high-density points
      map        of int16: offset, then scale of each column; value = offset + scale × stored
      values     (n_1 … n_d) in C order × columns: n × r nodal values, then the final time
      holes      a byte each vertex, 1 where the value is borrowed; nothing if there are none

All is little-endian. Interpolated sums of int16 are mapped last, for weights sum to one.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.clock import NOMINAL_CYCLE
from ampi.onboard.reference import Mode
from ampi.onboard.row_layout import RowLayout
from ampi.onboard.subspace import Order
from ampi.onboard.table import GuidanceTable
from ampi.tracking.angle_limiter import ANY_ANGLE, AngleRange, ModulationLimits
from ampi.tracking.bank_limiter import AngleLimits, BankLimits
from ampi.tracking.drag_reference import DragReference
from ampi.tracking.drag_shuttle import DragShuttle
from ampi.tracking.drag_sliding_mode import DragSlidingMode
from ampi.tracking.law import TrackingLaw
from ampi.tracking.linear_quadratic import LinearQuadratic

Array = NDArray[np.float64]
Kind = Literal["float64", "float32", "int16"]
KINDS: tuple[Kind, ...] = get_args(Kind)

MAGIC = b"\x89AMPI\r\n\x1a"
BYTE_ORDER_MARK, FORMAT = 0x01020304, 2
HEADER, SIZES = 32, 64  # bytes
AXIS, SEGMENT = 40, 48  # of one
TEXT = 14  # place of its length among the sizes
N_GAINS = 16
NO_AXIS = 0xFFFFFFFF
# by their numbers in C
LAWS = (LinearQuadratic, DragSlidingMode, DragShuttle)
MOST = 32767  # of int16, which is used symmetrically
# numbers in C of how an axis is interpolated
ORDERS = {
    Order.NEAREST: 1,
    Order.LINEAR: 2,
    Order.QUADRATIC: 3,
    Order.CUBIC: 4,
    Order.SECOND_DIFFERENCES: 5,
}
# of a mode whose name is not its axes' order
_ORDER_OF = {Mode.NOMINAL: Order.NEAREST, Mode.MPI: Order.LINEAR, Mode.AMPI: Order.LINEAR}


def table_blob(
    table: GuidanceTable,
    law: TrackingLaw,
    limits: BankLimits,
    *,
    modulation: ModulationLimits | None = None,
    angles: AngleRange = ANY_ANGLE,
    mode: Mode | str = Mode.AMPI,
    orders: Sequence[Order] | None = None,
    limit_axes: Mapping[str, int] | None = None,
    cycle: float | None = None,
    kind: Kind = "float64",
    about: str = "",
) -> bytes:
    """What `ampi_table_open` opens: all that a `Guidance` of these settings flies by.

    Parameters
    ----------
    table, law, limits, angles, mode, orders, limit_axes, cycle
        As `Guidance` takes them.
    modulation
        Limits of the change of the angle of attack; None: it is never changed.
    kind
        Type of the stored values: "float64", to the bit; "float32"; or "int16" with an affine map a
        column.
    about
        Lines for the text: where the table comes from, its parameters.

    Raises
    ------
    ValueError
        If the law or an order is none that the C knows, or a number is too large for `kind`.
    """
    mode = Mode(mode)
    if kind not in KINDS:
        raise ValueError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    flown = _Flown(
        table,
        law,
        limits,
        modulation=modulation,
        angles=angles,
        mode=mode,
        limit_axes=limit_axes or {},
        cycle=cycle,
    )
    own = _orders(orders, mode, len(table.axes))
    text = _text(flown, own, kind, about).encode()
    parts = [
        np.array(flown.sizes(KINDS.index(kind), len(text)), "<u4").tobytes(),
        text,
        flown.counts(own),
        *flown.numbers(),
        *_stored(flown.columns, kind),
        b"" if flown.cut.solved is None else (~flown.cut.solved).astype("u1").tobytes(),
    ]
    body = b"".join(part + bytes(-len(part) % 8) for part in parts)
    return MAGIC + struct.pack("<4I8x", BYTE_ORDER_MARK, FORMAT, len(body), zlib.crc32(body)) + body


def _orders(orders: Sequence[Order] | None, mode: Mode, axes: int) -> tuple[Order, ...]:
    """Those of the axes, which the C knows."""
    own = tuple(orders or (_ORDER_OF.get(mode) or Order(mode.value),) * axes)
    if len(own) != axes or not set(own) <= set(ORDERS):
        raise ValueError(
            f"orders: expected {axes} of those that flight code has "
            f"({', '.join(order.value for order in ORDERS)}), one an axis, got "
            f"{', '.join(order.value for order in own)}"
        )
    return own


def blob_text(blob: bytes) -> str:
    """The text of a blob."""
    length = struct.unpack_from("<I", blob, HEADER + 4 * TEXT)[0]
    return blob[HEADER + SIZES : HEADER + SIZES + length].decode()


def blob_vertices(blob: bytes) -> int:
    """Vertices that one reference adds, four at once: of every tensor product that its orders make."""
    words = np.frombuffer(blob, "<u4", count=len(blob) // 4)
    begin = (HEADER + SIZES + -(-len(blob_text(blob).encode()) // 8) * 8) // 4
    counts = words[begin : begin + 10 * int(words[HEADER // 4 + 2])].reshape(-1, 10)[:, :2].tolist()
    curved = [n > 2 and order == ORDERS[Order.SECOND_DIFFERENCES] for n, order in counts]
    widths = [
        min(n, 2 if order == ORDERS[Order.SECOND_DIFFERENCES] else order) for n, order in counts
    ]
    base = prod(widths)
    extra = [base // width * min(n, 4) for (n, _), width in zip(counts, widths, strict=True)]
    products = [base, *(part for part, bends in zip(extra, curved, strict=True) if bends)]
    return sum(-(-product // 4) * 4 for product in products)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Flown:
    """What is written, in the terms of the blob."""

    table: GuidanceTable = field(kw_only=False)
    law: TrackingLaw = field(kw_only=False)
    limits: BankLimits = field(kw_only=False)
    modulation: ModulationLimits | None
    angles: AngleRange
    mode: Mode
    limit_axes: Mapping[str, int]
    cycle: float | None
    cut: GuidanceTable = field(init=False)  # the part of the table that the mode flies
    segment: NDArray[np.intp] = field(init=False)  # of each high-density point

    def __post_init__(self) -> None:
        if type(self.law) not in LAWS:
            raise ValueError(
                f"law: expected one that flight code has ({', '.join(each.name for each in LAWS)}), "
                f"got {self.law.name}"
            )
        if self.table.layout not in (self.law.layout, self.law.layout.with_angle_of_attack):
            raise ValueError(f"law: expected a table with the rows of {self.law.name}")
        cuts = {Mode.MPI: self.table.corners, Mode.NOMINAL: self.table.nominal}
        object.__setattr__(self, "cut", cuts.get(self.mode, lambda: self.table)())
        object.__setattr__(self, "segment", _segments_of_points(self.table))

    @property
    def layout(self) -> RowLayout:
        """Of the rows."""
        return self.table.layout

    @property
    def columns(self) -> Array:
        """(vertices, n r + 1): node by node."""
        cut = self.cut
        nodal = np.swapaxes(cut.values, -1, -2).reshape(cut.final_time.size, -1)
        return np.concatenate([nodal, cut.final_time.reshape(-1, 1)], axis=1)

    def sizes(self, kind: int, text: int) -> tuple[int, ...]:
        """The sixteen sizes."""
        n, m = self.table.conversion.shape
        segments = self.table.segments
        return (
            kind,
            [law.name for law in LAWS].index(self.law.name),
            len(self.table.axes),
            len(self.layout),
            n,
            m,
            len(segments),
            segments.nodes.shape[1],
            int(self.mode is not Mode.NOMINAL),  # whether parameters outside are told
            int(self.cycle is not None),
            *(self.limit_axes.get(name, NO_AXIS) for name in ("angle", "rate", "acceleration")),
            int(self.cut.solved is not None),
            text,
            int(self.law.modulates),
        )

    def counts(self, orders: tuple[Order, ...]) -> bytes:
        """Of axes and segments, with the edges of the ones and the times of the others."""
        table, segments = self.table, self.table.segments
        axes = np.zeros(len(table.axes), dtype=[("counts", "<u4", 4), ("edges", "<f8", 3)])
        for i, (whole, cut, order) in enumerate(
            zip(table.axes, self.cut.axes, orders, strict=True)
        ):
            axes[i]["counts"] = (len(cut), ORDERS[order], int(i in table.circular), 0)
            axes[i]["edges"] = (whole[0], whole[-1], whole[table.centre[i]])
        own = np.zeros(len(segments), dtype=[("counts", "<u4", 4), ("times", "<f8", (2, 2))])
        own["counts"][:, 0] = segments.counts
        own["counts"][:, 1] = np.bincount(self.segment, minlength=len(segments))
        own["times"] = np.stack([segments.start.T, segments.half_length.T], axis=1)
        return axes.tobytes() + own.tobytes()

    def numbers(self) -> list[bytes]:
        """Settings, points, matrix and instants."""
        table, segments, envelope = self.table, self.table.segments, self.table.envelope
        limits, changed = _sizes_of(self.limits), self.modulation
        cycle = NOMINAL_CYCLE if self.cycle is None else self.cycle
        gains = _gains(self.law)
        changes = [0.0] * len(limits) if changed is None else _sizes_of(changed)
        angles = [self.angles.least, self.angles.greatest, self.angles.rate]
        settings = [*limits, cycle, *changes, *angles, *envelope.middle, *envelope.reach]
        settings += [*gains, *[0.0] * (N_GAINS - len(gains))]
        matrix: list[Array] = []
        for s, (first, count) in enumerate(zip(segments.first_node, segments.counts, strict=True)):
            own = table.conversion[first : first + count, self.segment == s]
            matrix += [segments.nodes[s], segments.weights[s], own]
        arrays = [settings, *self.cut.axes, *matrix, *table.high_density_time]
        return [np.asarray(array, "<f8").tobytes() for array in arrays]


def _sizes_of(limits: AngleLimits) -> list[float]:
    return [float(np.asarray(part)) for part in (limits.angle, limits.rate, limits.acceleration)]


def _segments_of_points(table: GuidanceTable) -> NDArray[np.intp]:
    """The segment from whose nodes each high-density point is read, (m,); they do not decrease."""
    used = table.conversion != 0.0
    first, last = used.argmax(axis=0), len(used) - 1 - used[::-1].argmax(axis=0)
    begins = table.segments.first_node
    segment = np.searchsorted(begins, first, side="right") - 1
    if np.any(last >= begins[segment] + table.segments.counts[segment]) or np.any(
        np.diff(segment) < 0
    ):
        raise ValueError(
            "table: expected an LD→HD matrix that reads each point from the nodes of one segment, in "
            "order of time"
        )
    return segment


def _gains(law: TrackingLaw) -> list[float]:
    """In the order of ampi_laws.c: those of both drag laws, then of the one."""
    if not isinstance(law, DragReference):
        return []
    lateral = law.lateral
    gains = [law.gravitational_parameter, law.radius, law.felt_drag]
    gains += [lateral.deadband, lateral.least_range, lateral.turning, lateral.braking]
    if isinstance(law, DragShuttle):
        gains += [law.drag_gain, law.descent_gain]
    if isinstance(law, DragSlidingMode):
        gains += [law.surface, law.reaching, law.switching, law.boundary, law.bandwidth]
        gains += [law.most_disturbance]
    return gains


def _stored(columns: Array, kind: Kind) -> tuple[bytes, bytes]:
    """The affine map, if the type needs one, and the values."""
    if kind == "float64":
        return b"", columns.astype("<f8").tobytes()
    if kind == "float32":
        most = float(np.finfo(np.float32).max)
        if np.abs(columns).max() > most:
            raise ValueError(f"kind: expected values up to {most:.3g} for float32; take float64")
        return b"", columns.astype("<f4").tobytes()
    least, greatest = columns.min(axis=0), columns.max(axis=0)
    offset, scale = 0.5 * (least + greatest), (greatest - least) / (2 * MOST)
    steps = np.rint((columns - offset) / np.where(scale > 0.0, scale, 1.0))
    values = np.clip(steps, -MOST, MOST).astype("<i2")
    return np.stack([offset, scale]).astype("<f8").tobytes(), values.tobytes()


def _text(flown: _Flown, orders: tuple[Order, ...], kind: Kind, about: str) -> str:
    """What a reader of the bytes should know."""
    table = flown.table
    n, m = table.conversion.shape
    lines = [
        f"ampi guidance table, format {FORMAT}",
        *about.splitlines(),
        f"law {flown.law.name}, mode {flown.mode.value}",
        f"{len(flown.layout)} rows at {n} nodes, {m} high-density points; then the final time, s",
        *(f"  {row.name} [{row.unit}]" for row in flown.layout.rows),
        f"{len(table.axes)} axes",
        *(
            f"  {len(axis)} points, {order.value}, {axis[0]!r} to {axis[-1]!r}"
            for axis, order in zip((axis.tolist() for axis in flown.cut.axes), orders, strict=True)
        ),
        f"values {kind}" + (", value = offset + scale x stored" if kind == "int16" else ""),
    ]
    return "\n".join(lines) + "\n"
