"""The guidance table: what is loaded before flight and never changed.

For each grid point of the parameter space the nodal values of states, control and tracking gains (the
rows of `row_layout`), and the final time; besides, the segments of the mesh and its LD→HD matrix.
Checked whole when it is built, on the ground: in flight nothing is left to refuse.

A hole is a grid point without an optimum of its own. A table that is to fly with holes holds there the
rows of the nearest grid point that has one, and says so in `solved`: in the cells of a hole the
reference is then that of a point moved towards what was solved, as beyond the hypercube it is that of
the boundary, never an extrapolation; elsewhere it is what it would be without the hole.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.plausibility import StateEnvelope
from ampi.onboard.row_layout import LINEAR_TRACKING, RowLayout
from ampi.onboard.segments import Segments

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GuidanceTable:
    """Arrays in SI and radians; d parameters, r rows, n low-density nodes, m high-density points."""

    axes: tuple[Array, ...]  # d strictly increasing axes of p
    values: Array  # (n_1 … n_d, r, n)
    final_time: Array  # (n_1 … n_d), s
    segments: Segments  # of the mesh, with n nodes in all
    conversion: Array  # (n, m), P_FRP of Eq. (32)
    high_density_time: tuple[Array, Array]  # (a, b) of t = a + b t_f, each (m,)
    centre: tuple[int, ...]  # grid index of the nominal parameters
    solved: NDArray[np.bool_] | None = None  # (n_1 … n_d), false: a hole; None: there are none
    circular: tuple[int, ...] = ()  # axes of longitudes and azimuths: the same modulo a turn
    layout: RowLayout = LINEAR_TRACKING  # of the rows
    sensitivities: Array | None = None  # (n_1 … n_d, d, r n + 1), ∂(values, final time)/∂p
    envelope: StateEnvelope = field(init=False)  # of plausible navigation states

    def __post_init__(self) -> None:
        self._check_shapes()
        shape = tuple(len(axis) for axis in self.axes)
        missing = ~np.isfinite(self.final_time)
        missing |= ~np.all(np.isfinite(self.values), axis=(-2, -1))
        if np.any(missing):
            raise ValueError(
                f"guidance table: {np.count_nonzero(missing)} of {missing.size} cases have no "
                "solution; a table with holes cannot fly. Re-run the build, or shrink the grid"
            )
        slopes = () if self.sensitivities is None else (self.sensitivities,)
        shared = (*self.axes, self.conversion, *self.high_density_time, *slopes)
        if not all(np.all(np.isfinite(array)) for array in shared):
            raise ValueError(
                "guidance table: axes, LD→HD matrix, times and sensitivities must be finite"
            )
        if any(np.any(np.diff(axis) <= 0) for axis in self.axes):
            raise ValueError("guidance table: every axis must increase strictly")
        if np.abs(self.conversion.sum(axis=0) - 1.0).max() > 1e-9:
            raise ValueError("guidance table: the columns of the LD→HD matrix must sum to one")
        if len(self.centre) != len(shape) or not all(
            0 <= i < n for i, n in zip(self.centre, shape, strict=True)
        ):
            raise ValueError(
                f"guidance table: centre: expected a grid index within {shape}, got {self.centre}"
            )
        if not set(self.circular) <= set(range(len(shape))):
            raise ValueError(
                f"guidance table: circular: expected numbers of axes, 0 to {len(shape) - 1}, "
                f"got {self.circular}"
            )
        self._check_times()
        states = self.values[..., self.layout.states, :]
        object.__setattr__(self, "envelope", StateEnvelope.of(states))
        for array in (*shared, self.values, self.final_time):
            array.setflags(write=False)
        if self.solved is not None:
            self.solved.setflags(write=False)

    def _check_shapes(self) -> None:
        shape = tuple(len(axis) for axis in self.axes)
        n, m = self.conversion.shape
        expected = {
            "values": (self.values.shape, (*shape, len(self.layout), n)),
            "final_time": (self.final_time.shape, shape),
            "high_density_time": (
                tuple(part.shape for part in self.high_density_time),
                ((m,), (m,)),
            ),
        }
        if self.segments.n_nodes != n:
            raise ValueError(
                f"guidance table: segments have {self.segments.n_nodes} nodes, expected {n}"
            )
        if self.solved is not None:
            expected["solved"] = (self.solved.shape, shape)
        if self.sensitivities is not None:
            wanted_shape = (*shape, len(shape), len(self.layout) * n + 1)
            expected["sensitivities"] = (self.sensitivities.shape, wanted_shape)
        for name, (got, wanted) in expected.items():
            if got != wanted:
                raise ValueError(f"guidance table: {name} has shape {got}, expected {wanted}")

    def _check_times(self) -> None:
        fixed, free = self.high_density_time
        for final_time in (self.final_time.min(), self.final_time.max()):  # affine between them
            if not final_time > 0.0 or not np.all(np.diff(fixed + free * final_time) > 0.0):
                raise ValueError(
                    "guidance table: final times must be positive, and the times a + b t_f of the "
                    f"points increase strictly; with t_f = {final_time} they do not"
                )

    def corners(self) -> GuidanceTable:
        """The outer 2^d vertices alone: the database of the basic MPI."""
        return self._part(tuple(slice(None, None, max(len(axis) - 1, 1)) for axis in self.axes))

    def nominal(self) -> GuidanceTable:
        """The hypercentre alone."""
        return self._part(tuple(slice(i, i + 1) for i in self.centre))

    def _part(self, cut: tuple[slice, ...]) -> GuidanceTable:
        slopes = self.sensitivities
        return replace(
            self,
            axes=tuple(axis[c] for axis, c in zip(self.axes, cut, strict=True)),
            values=np.ascontiguousarray(self.values[cut]),
            final_time=np.ascontiguousarray(self.final_time[cut]),
            centre=tuple(0 for _ in self.axes),
            solved=None if self.solved is None else np.ascontiguousarray(self.solved[cut]),
            sensitivities=None if slopes is None else np.ascontiguousarray(slopes[cut]),
        )


def nearest_solved(axes: tuple[Array, ...], solved: NDArray[np.bool_]) -> NDArray[np.intp]:
    """For each grid point the flat index (C order) of the nearest one with an optimum, (n_1 … n_d).

    Near in shares of each axis' range; of several equally near ones, the first. On the ground only.
    """
    nearest = np.arange(solved.size).reshape(solved.shape)
    shares = [(axis - axis[0]) / max(axis[-1] - axis[0], np.finfo(float).tiny) for axis in axes]
    for hole in zip(*np.nonzero(~solved), strict=True):
        distance = np.where(solved, 0.0, np.inf)
        for i, share in enumerate(shares):
            along = (share - share[hole[i]]) ** 2
            distance += along.reshape(-1, *(1,) * (solved.ndim - 1 - i))
        nearest[hole] = int(np.argmin(distance))
    return nearest
