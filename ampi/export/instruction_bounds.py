"""What one call of the flight code takes at the most, in instructions.

Nothing in it depends on data but the values, so a call is a sum over the sizes of the table,

    reference = vertices (a columns + 105) + 450 axes,                                             (1)
    step = b + 14 segments + widest (26 + 13 ⌈rows/4⌉) + 11 ⌈log₂ points⌉,                         (2)

with a by the type of the values, b by the law and by whether it changes the angle of attack, and the
last term of the laws that look up by energy. The numbers are those that callgrind counts of gcc 12, -O2,
on x86-64, rounded up by some hundredths; `make flight-code` fails where a count lies above them, or a
fifth below.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from ampi.export.blob import AXIS, HEADER, KINDS, LAWS, SEGMENT, SIZES, TEXT, blob_vertices

A_VALUE = {"float64": 4, "float32": 5, "int16": 6}  # of a vertex; int16 is mapped once, too
A_LAW = {"linear_quadratic": 1400, "drag_shuttle": 1880, "drag_sliding_mode": 2100}
MAPPED = 8  # of a column
# of a law that changes the angle of attack, and of the limiter of that change
MODULATED = {"linear_quadratic": 190, "drag_shuttle": 140, "drag_sliding_mode": 0}
LIMITED = 350
LIBRARY = 800  # of exp, expm1, log, sin, cos, acos in a step of a drag law, glibc's


@dataclass(frozen=True)
class InstructionBounds:
    """Of one table."""

    reference: int
    step: int
    library: int  # beside those of the step

    @classmethod
    def of(cls, blob: bytes) -> InstructionBounds:
        """Eqs. (1) and (2)."""
        kind, number, axes, rows, nodes, points, segments, widest = struct.unpack_from(
            "<8I", blob, HEADER
        )
        text, modulates = struct.unpack_from("<2I", blob, HEADER + 4 * TEXT)
        settings = HEADER + SIZES + -(-text // 8) * 8 + AXIS * axes + SEGMENT * segments
        (change,) = struct.unpack_from("<d", blob, settings + 8 * 4)
        law, columns = LAWS[number].name, rows * nodes + 1
        stored = KINDS[kind]
        reference = blob_vertices(blob) * (A_VALUE[stored] * columns + 105) + 450 * axes
        step = A_LAW[law] + 14 * segments + widest * (26 + 13 * -(-rows // 4))
        step += modulates * MODULATED[law] + LIMITED * (change > 0.0)
        is_by_energy = law != "linear_quadratic"
        return cls(
            reference=reference + (MAPPED * columns if stored == "int16" else 0),
            step=step + (11 * math.ceil(math.log2(points)) if is_by_energy else 0),
            library=LIBRARY if is_by_energy else 0,
        )
