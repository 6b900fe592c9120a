"""The guidance table: what is loaded before flight and never changed.

For each grid point of the parameter space the nodal values of 7 states, the bank rate and 7 tracking
gains (15 rows), and the final time; besides, the LD→HD matrix of the mesh. Checked whole when it is
built, on the ground: in flight nothing is left to refuse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STATE_ROWS = slice(0, 7)
RATE_ROW = 7
GAIN_ROWS = slice(8, 15)
N_ROWS = 15


@dataclass(frozen=True, eq=False)
class GuidanceTable:
    """Arrays in SI and radians; d parameters, n low-density nodes, m high-density points."""

    axes: tuple[Array, ...]  # d strictly increasing axes of p
    values: Array  # (n_1 … n_d, 15, n)
    final_time: Array  # (n_1 … n_d), s
    conversion: Array  # (n, m), P_FRP of Eq. (32)
    high_density_time: tuple[Array, Array]  # (a, b) of t = a + b t_f, each (m,)
    centre: tuple[int, ...]  # grid index of the nominal parameters

    def __post_init__(self) -> None:
        shape = tuple(len(axis) for axis in self.axes)
        n, m = self.conversion.shape
        expected = {
            "values": (self.values.shape, (*shape, N_ROWS, n)),
            "final_time": (self.final_time.shape, shape),
            "high_density_time": (
                tuple(part.shape for part in self.high_density_time),
                ((m,), (m,)),
            ),
        }
        for name, (got, wanted) in expected.items():
            if got != wanted:
                raise ValueError(f"guidance table: {name} has shape {got}, expected {wanted}")
        missing = ~np.isfinite(self.final_time)
        missing |= ~np.all(np.isfinite(self.values), axis=(-2, -1))
        if np.any(missing):
            raise ValueError(
                f"guidance table: {np.count_nonzero(missing)} of {missing.size} cases have no "
                "solution; a table with holes cannot fly. Re-run the build, or shrink the grid"
            )
        shared = (*self.axes, self.conversion, *self.high_density_time)
        if not all(np.all(np.isfinite(array)) for array in shared):
            raise ValueError("guidance table: axes, LD→HD matrix and times must be finite")
        if any(np.any(np.diff(axis) <= 0) for axis in self.axes):
            raise ValueError("guidance table: every axis must increase strictly")
        if np.abs(self.conversion.sum(axis=0) - 1.0).max() > 1e-9:
            raise ValueError("guidance table: the columns of the LD→HD matrix must sum to one")
        for array in (*shared, self.values, self.final_time):
            array.setflags(write=False)

    def corners(self) -> GuidanceTable:
        """The outer 2^d vertices alone: the database of the basic MPI."""
        ends = tuple(slice(None, None, max(len(axis) - 1, 1)) for axis in self.axes)
        return GuidanceTable(
            axes=tuple(axis[e] for axis, e in zip(self.axes, ends, strict=True)),
            values=np.ascontiguousarray(self.values[ends]),
            final_time=np.ascontiguousarray(self.final_time[ends]),
            conversion=self.conversion,
            high_density_time=self.high_density_time,
            centre=tuple(0 for _ in self.axes),
        )

    def nominal(self) -> GuidanceTable:
        """The hypercentre alone."""
        at = tuple(slice(i, i + 1) for i in self.centre)
        return GuidanceTable(
            axes=tuple(axis[e] for axis, e in zip(self.axes, at, strict=True)),
            values=np.ascontiguousarray(self.values[at]),
            final_time=np.ascontiguousarray(self.final_time[at]),
            conversion=self.conversion,
            high_density_time=self.high_density_time,
            centre=tuple(0 for _ in self.axes),
        )
