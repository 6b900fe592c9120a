"""The parameter grid: a Cartesian product of strictly increasing axes, Eqs. (5)–(9)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Grid:
    """Axes of p (SI, rad) and its grid points in C order."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    axes: tuple[Array, ...]
    centre: tuple[int, ...]  # index of the nominal value on each axis

    @classmethod
    def from_mission(cls, mission: Mission) -> Grid:
        """The grid that the mission file declares.

        Raises
        ------
        ValueError
            If the mission disperses nothing.
        """
        parameters = mission.parameters
        if not parameters:
            raise ValueError(
                f"{mission.name}: expected a [grid] with at least one axis of two or more points, "
                "got none; add one, such as speed_m_per_s = [-70.0, 0.0, 70.0]"
            )
        return cls(
            names=tuple(p.name for p in parameters),
            units=tuple(p.number.unit for p in parameters),
            axes=tuple(p.axis for p in parameters),
            centre=tuple(p.offsets.index(0.0) for p in parameters),
        )

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

    def points(self) -> Array:
        """Parameters of every grid point, (c, d)."""
        return np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1).reshape(self.size, -1)

    def beside(self, case: int) -> list[int]:
        """Cases one step away along each axis, on both sides."""
        index, found = np.unravel_index(case, self.shape), list[int]()
        for axis, size in enumerate(self.shape):
            for step in (-1, 1):
                k = index[axis] + step
                if 0 <= k < size:
                    there = (*index[:axis], k, *index[axis + 1 :])
                    found.append(int(np.ravel_multi_index(there, self.shape)))
        return found

    def pairs(self) -> NDArray[np.int64]:
        """Cases one step apart, (k, 2), the first of a pair before the second on their axis."""
        number = np.arange(self.size).reshape(self.shape)
        found = []
        for axis in range(len(self.shape)):
            along = np.moveaxis(number, axis, 0)
            found.append(np.stack([along[:-1].ravel(), along[1:].ravel()], axis=1))
        return np.concatenate(found)

    def describe(self, case: int) -> str:
        """Grid indices of a case, for logs."""
        index = [int(i) for i in np.unravel_index(case, self.shape)]
        return f"case {case} at grid index {tuple(index)}"
