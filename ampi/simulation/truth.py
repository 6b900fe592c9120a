"""What is true of n flights, in SI and radians; guidance is told some of it, with errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.simulation.uncertainties import BY_NAME

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Truth:
    """Numbers and profiles of n flights, over k altitudes.

    Whether `density` or `wind` is None is a matter of the world, never of its draws.
    """

    parameters: Array  # (n, d) the mission's p as it is
    numbers: dict[str, Array]  # every name of the catalogue of uncertainties → (n,)
    altitudes: Array  # (k,) m: 0 to 130 km, a kilometre apart
    density: Array | None  # (n, k) on the mission's density, beside density_factor; None: 1
    wind: Array | None  # (2, n, k) m/s: east and north, constants included; None: no wind
    seeds: NDArray[np.uint64]  # (n,) of the sensors' noise

    def __post_init__(self) -> None:
        n, k = len(self.seeds), len(self.altitudes)
        if self.parameters.ndim != 2 or len(self.parameters) != n:
            raise ValueError(
                f"parameters: expected shape ({n}, d), one row per seed, got {self.parameters.shape}"
            )
        if set(self.numbers) != set(BY_NAME):
            differing = ", ".join(sorted(set(self.numbers) ^ set(BY_NAME)))
            raise ValueError(f"numbers: expected every uncertainty once, differing in {differing}")
        shapes: dict[str, tuple[Any, tuple[int, ...]]] = {
            **{name: (values, (n,)) for name, values in self.numbers.items()},
            "density": (self.density, (n, k)),
            "wind": (self.wind, (2, n, k)),
        }
        for name, (values, shape) in shapes.items():
            if values is not None and values.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {values.shape}")

    def __len__(self) -> int:
        """Number of flights."""
        return len(self.seeds)

    def take(self, flights: Any) -> Truth:
        """Some of the flights: indices, a slice or a mask."""
        return Truth(
            self.parameters[flights],
            {name: values[flights] for name, values in self.numbers.items()},
            self.altitudes,
            None if self.density is None else self.density[flights],
            None if self.wind is None else self.wind[:, flights],
            self.seeds[flights],
        )
