"""Writes what the C programs of this folder read: `python -m tests.flight_code.inputs FOLDER`.

For each case a blob and, as float64 numbers, what the numpy guidance makes of it: references, a flight
of commands, and bytes of the blob to change with the status that must follow.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ampi.export.blob import _segments_of_points
from ampi.guidance import Guidance
from ampi.onboard.subspace import Order
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.tracking.angle_limiter import ANY_ANGLE
from tests.export.conftest import ANGLES, LAWS, LIMITS, MODULATION, entry_table
from tests.support.flight_blobs import blob_of, numpy_commands, recorded, some_parameters

Array = NDArray[np.float64]

HEADER, SIZES, AXIS, SEGMENT = 32, 64, 40, 48
N_REFERENCES, N_FLIGHTS, N_STEPS = 60, 12, 60
OK, TRUNCATED, FOREIGN, BYTE_ORDER, VERSION, CHECKSUM, TOO_LARGE, INCONSISTENT = range(8)
# name: law, mode, orders, type of the values, its error as share of a row's largest value
CASES = {
    "linear": ("linear_quadratic", "ampi", None, "float64", 1e-14),
    "curved": ("linear_steered", "ampi", ("cubic", "quadratic", "nearest"), "float32", 1e-6),
    "bent": ("linear_quadratic", "second_differences", None, "int16", 5e-4),
    "nominal": ("drag_shuttle", "nominal", None, "float64", 1e-14),
    "shuttle": ("shuttle_steered", "ampi", ("quadratic", "cubic", "linear"), "float64", 1e-14),
    "sliding": ("sliding_steered", "ampi", ("second_differences",) * 3, "float64", 1e-14),
}


# of the size of a real table: what varies may be lost in a small one
LONG = {"long_shuttle": "drag_shuttle", "long_sliding": "drag_sliding_mode"}
LONG_MESH = Mesh((Phase((14,), 30.0), Phase((14, 14, 14))))


def guidance_of(name: str) -> Guidance:
    """One of `CASES`, each with something of its own: holes, limits that are parameters, few points."""
    law, mode, names, _, _ = CASES[name]
    orders = None if names is None else tuple(Order(each) for each in names)
    shape = (4, 3, 1) if name == "shuttle" else (4, 3, 2)
    table = entry_table(LAWS[law], shape, is_steered=name == "curved")
    if name in ("curved", "sliding"):
        if name == "sliding":  # beyond it the angle of attack does not change the drag
            values = table.values.copy()
            values[2:, ..., table.layout.index("drag_slope"), :] -= 3.0
            table = replace(table, values=values)
        solved = np.random.default_rng(3).random(table.final_time.shape) < 0.8
        return Guidance(
            replace(table, solved=solved), LIMITS, mode, law=LAWS[law], orders=orders,
            limit_axes={"angle": 2}, engine="numpy", modulation=MODULATION,
            angles=ANGLES if name == "curved" else ANY_ANGLE,
        )  # fmt: skip
    return Guidance(
        table, LIMITS, mode, law=LAWS[law], orders=orders, cycle=0.5, engine="numpy",
        modulation=MODULATION,
    )  # fmt: skip


def references(guidance: Guidance, rng: np.random.Generator) -> Iterator[Array]:
    """Each: p, cell, clipped, excess, hole, health, nodal values, final time, times, rows."""
    for p in some_parameters(guidance, rng, N_REFERENCES):
        told = guidance.reference(p)
        flags = [*told.cell, *told.clipped, *told.excess, told.hole, int(told.health)]
        values = [told.nodal.ravel(), [told.final_time], told.times, told.rows.ravel()]
        yield np.concatenate([p, flags, *values])


def flights(guidance: Guidance, rng: np.random.Generator) -> Iterator[Array]:
    """Each: p, whether accelerations are sensed; then of every step what is told and commanded."""
    for i, p in enumerate(some_parameters(guidance, rng, N_FLIGHTS)):
        guidance.begin(p)
        times, navigation, sensed = recorded(guidance, p, rng, N_STEPS)
        felt = None if i % 4 == 1 else sensed
        numbers, flags = numpy_commands(guidance, times, navigation, felt)
        steps = np.column_stack([times, navigation, sensed, numbers, flags])
        yield np.concatenate([p, [felt is not None], steps.ravel()])


def damages(guidance: Guidance, blob: bytes) -> Iterator[tuple[int, bytes, int, int]]:
    """(place, bytes, whether the checksum is then made right, status); from the begin all of it."""
    word, real, table = struct.Struct("<I"), struct.Struct("<d"), guidance.table
    yield 1, b"PNG", 1, FOREIGN
    for place, status in ((8, BYTE_ORDER), (12, VERSION), (16, TRUNCATED)):
        yield place, word.pack(77), 1, status
    yield 24, word.pack(1), 1, VERSION
    yield 0, narrower(guidance, blob), 1, INCONSISTENT
    yield HEADER + 3, b"\x01", 0, CHECKSUM
    sizes = range(HEADER, HEADER + SIZES, 4)
    for i in (2, 3, 4, 5, 6, 7):
        yield sizes[i], word.pack(5000), 1, TOO_LARGE
    for i, value in (
        (0, 3),
        (1, 3),
        (2, 0),
        (3, 14),
        (4, 3),
        (5, 1),
        (5, 20),
        (14, 1 << 30),
        (14, 0),
    ):
        yield sizes[i], word.pack(value), 1, INCONSISTENT
    (text,) = word.unpack_from(blob, sizes[14])
    axes = HEADER + SIZES + -(-text // 8) * 8
    for place, value in ((0, 0), (0, 1 << 31), (0, 3), (4, 0), (4, 6)):
        yield axes + place, word.pack(value), 1, INCONSISTENT
    for place, value in ((16, 1e9), (24, -1e9), (32, -1e9), (32, 1e9), (24, np.inf)):
        yield axes + place, real.pack(value), 1, INCONSISTENT
    yield axes + 16, struct.pack("<ddd", -1.7e308, 1.7e308, 0.0), 1, INCONSISTENT
    segments = axes + AXIS * len(table.axes)
    for value in (1, 2, 5, 20):
        yield segments, word.pack(value), 1, INCONSISTENT
    yield segments + 4, word.pack(1), 1, INCONSISTENT
    settings = segments + SEGMENT * len(table.segments)
    change = 0.0 if guidance.modulates else 1.0  # of size alone, or of all but that
    for i, value in ((0, -1.0), (1, 0.0), (2, np.nan), (3, 1e-4), (4, change), (5, np.inf)):
        yield settings + 8 * i, real.pack(value), 1, INCONSISTENT
    if len(guidance.table.axes[0]) > 1 and guidance.mode.value != "nominal":
        yield settings + 8 * 40 + 8, real.pack(-1e9), 1, INCONSISTENT
    end = len(blob) - (0 if table.solved is None else -(-table.final_time.size // 8) * 8)
    kind = word.unpack_from(blob, HEADER)[0]
    if kind < 2:
        yield (
            end - 8,
            real.pack(np.nan) if kind == 0 else struct.pack("<ff", np.nan, np.nan),
            1,
            INCONSISTENT,
        )


def narrower(guidance: Guidance, blob: bytes) -> bytes:
    """The same blob, consistent in all but this: its widest segment is said to have a node less."""
    table, nodes = guidance.table, guidance.table.segments.counts
    points = np.bincount(_segments_of_points(table), minlength=len(nodes))
    place = blob.index(table.segments.nodes[0].astype("<f8").tobytes())
    parts = [blob[:place]]
    for m, k in zip(points, nodes, strict=True):
        for _ in range(2):  # nodes, weights
            parts.append(blob[place : place + 8 * (nodes.max() - 1)])
            place += 8 * nodes.max()
        parts.append(blob[place : place + 8 * k * m])
        place += 8 * k * m
    whole = bytearray(b"".join([*parts, blob[place:]]))
    struct.pack_into("<I", whole, 16, len(whole) - HEADER)
    struct.pack_into("<I", whole, HEADER + 4 * 7, nodes.max() - 1)
    return bytes(whole)


def write(folder: Path) -> None:
    """Of every case; of the long tables the blob alone."""
    for name, (*_, kind, error) in CASES.items():
        guidance, rng = guidance_of(name), np.random.default_rng(17)
        blob, table = blob_of(guidance, kind=kind), guidance.table
        about, of_flights = list(references(guidance, rng)), list(flights(guidance, rng))
        # libm's exp and sin may differ in the last bit: the laws of linear gains ask for none
        to_the_bit = kind == "float64" and guidance.law.name == "linear_quadratic"
        sizes = [len(table.axes), len(table.layout), *table.conversion.shape, error, to_the_bit]
        counts = [len(about), len(of_flights), N_STEPS, int(kind == "float64")]
        bad = [
            [place, fixed, status, len(bytes_), *bytes_]
            for place, bytes_, fixed, status in damages(guidance, blob)
        ]
        numbers = np.concatenate([[*sizes, *counts, len(bad)], *about, *of_flights, *bad])
        (folder / f"{name}.blob").write_bytes(blob)
        (folder / f"{name}.cases").write_bytes(numbers.astype("<f8").tobytes())
    for name, law in LONG.items():
        table = entry_table(LAWS[law], (2, 2, 2), LONG_MESH, 591)
        blob = Guidance(table, LIMITS, law=LAWS[law], engine="numpy", modulation=MODULATION).blob()
        (folder / f"{name}.blob").write_bytes(blob)


if __name__ == "__main__":
    Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
    write(Path(sys.argv[1]))
