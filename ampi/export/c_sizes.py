"""How large the flight code of a table is: the limits of ampi_config.h, memory in bytes, work in counts.

The structures are those of ampi.h, on a machine of this one's pointers and alignments.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

from ampi.onboard.table import GuidanceTable
from ampi.release import RELEASE

CHUNK = 64  # points that ampi_reference.c converts at once
_Number, _Word, _Place = ctypes.c_double, ctypes.c_uint32, ctypes.c_size_t


@dataclass(frozen=True)
class CodeSizes:
    """Of one table; memory in bytes."""

    axes: int
    rows: int
    nodes: int
    segments: int
    widest: int  # nodes of the segment that has most
    points: int
    conversions: int  # products of the LD→HD matrix for one row
    blob: int

    @classmethod
    def of(cls, table: GuidanceTable, blob: int) -> CodeSizes:
        """Those of a table whose blob takes so many bytes."""
        nodes, points = table.conversion.shape
        return cls(
            axes=len(table.axes),
            rows=len(table.layout),
            nodes=nodes,
            segments=len(table.segments),
            widest=table.segments.nodes.shape[1],
            points=points,
            conversions=int((table.conversion != 0.0).sum()),
            blob=blob,
        )

    def config(self) -> str:
        """ampi_config.h."""
        limits = {
            "AXES": self.axes,
            "ROWS": self.rows,
            "NODES": self.nodes,
            "SEGMENTS": self.segments,
            "DEGREE_NODES": self.widest,
            "POINTS": self.points,
        }
        lines = "".join(f"#define AMPI_MAX_{name} {limit}u\n" for name, limit in limits.items())
        about = (
            f"/* Written by ampi {RELEASE}.\n"
            "   The sizes of this table: ampi_table_open refuses a larger one. */\n"
        )
        return f"{about}#ifndef AMPI_CONFIG_H\n#define AMPI_CONFIG_H\n{lines}#endif\n"

    @property
    def table(self) -> int:
        """Of an ampi_table, without its blob."""
        a, s = self.axes, self.segments
        return ctypes.sizeof(
            _structure(
                _Word * 16,
                _structure(_Word * 4, _Number * 3) * a,
                _structure(_Word * 4, _Number * 4) * s,
                _Number * (4 + 6 + 2 * 7 + 16),
                _Place * (1 + 2 * a + 3 * s + 6),
                _Word * 2,
            )
        )

    @property
    def _reference(self) -> Any:
        columns, a = self.rows * self.nodes + 1, self.axes
        return _structure(_Number * columns, _Number, _Number * a, _Word * (2 * a + 3))

    @property
    def reference(self) -> int:
        """Of an ampi_reference."""
        return ctypes.sizeof(self._reference)

    @property
    def guidance(self) -> int:
        """Of an ampi_guidance: all that one flight remembers, its reference included."""
        numbers = _Number * (self.points + self.rows + 3 + 3 + 3 + 2 + 2 + 6)
        return ctypes.sizeof(_structure(self._reference, numbers, _Word * 4))

    @property
    def stack(self) -> int:
        """At the most, about: a chunk of the matrix and of ten rows, and a kilobyte of the rest."""
        return 8 * CHUNK * (self.widest + 10) + 1024


def _structure(*fields: Any) -> Any:
    members = [(f"member_{i}", kind) for i, kind in enumerate(fields)]
    return type("_Structure", (ctypes.Structure,), {"_fields_": members})
