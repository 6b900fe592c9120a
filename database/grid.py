"""The parameter grid: a Cartesian product of strictly increasing axes, Eqs. (5)–(9)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import ENTRY_STATES, Mission

Array = NDArray[np.float64]

UNITS = {
    "altitude": "m",
    "longitude": "rad",
    "latitude": "rad",
    "speed": "m/s",
    "flight_path_angle": "rad",
    "azimuth": "rad",
}


@dataclass(frozen=True, eq=False)
class Grid:
    """Axes of p and its grid points in C order. Here p is the entry state."""

    names: tuple[str, ...]
    axes: tuple[Array, ...]
    centre: tuple[int, ...]  # index of the nominal value on each axis

    @classmethod
    def from_mission(cls, mission: Mission) -> Grid:
        """The grid that the mission file declares."""
        axes = mission.grid_axes
        nominal = mission.entry_state
        centre = tuple(int(np.argmin(np.abs(a - x))) for a, x in zip(axes, nominal, strict=True))
        return cls(ENTRY_STATES, axes, centre)

    @property
    def shape(self) -> tuple[int, ...]:
        """Points per axis."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of grid points."""
        return int(np.prod(self.shape))

    def point(self, case: int) -> Array:
        """Parameters of grid point `case`."""
        index = np.unravel_index(case, self.shape)
        return np.array([axis[i] for axis, i in zip(self.axes, index, strict=True)])

    def describe(self, case: int) -> str:
        """Grid indices of a case, for logs."""
        index = [int(i) for i in np.unravel_index(case, self.shape)]
        return f"case {case} at grid index {tuple(index)}"
