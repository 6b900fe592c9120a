"""Dispersions of the parameters p, Sagliano et al. 2016, Eq. (34), one spawned seed per flight.

Flight i draws from the i-th child of the campaign's SeedSequence, so its parameters depend on the
seed and on i alone: not on the number of flights, of workers, or on the order of execution.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission

Array = NDArray[np.float64]


class Distribution(Enum):
    """Shape of the dispersion over the half-widths of the hypercube."""

    NORMAL = "normal"  # the half-width is 3σ: Eq. (34); some draws lie outside
    UNIFORM = "uniform"  # over the hypercube
    CORNERS = "corners"  # one of its 2^d vertices


@dataclass(frozen=True)
class Dispersions:
    """Half-widths of the d parameters (SI, rad), their distribution, and where it is centred."""

    half_widths: tuple[float, ...]
    distribution: Distribution = Distribution.NORMAL
    centre: tuple[float, ...] | None = None  # offset from the nominal p; None: none

    def __post_init__(self) -> None:
        widths = np.asarray(self.half_widths, dtype=float)
        if widths.ndim != 1 or not np.all(np.isfinite(widths)) or np.any(widths < 0):
            raise ValueError(
                "dispersions.half_widths: expected non-negative numbers, one per parameter, "
                f"got {self.half_widths}"
            )
        if self.centre is not None and (
            len(self.centre) != len(widths) or not np.all(np.isfinite(self.centre))
        ):
            raise ValueError(
                f"dispersions.centre: expected {len(widths)} finite offsets, got {self.centre}"
            )

    @classmethod
    def from_mission(
        cls, mission: Mission, distribution: Distribution = Distribution.NORMAL
    ) -> Dispersions:
        """The extent of the mission's parameter grid, Eq. (34) repeats Eq. (9), and its middle."""
        ends = [(p.offsets[0], p.offsets[-1], p.number.per_unit) for p in mission.parameters]
        return cls(
            half_widths=tuple(0.5 * (high - low) * unit for low, high, unit in ends),
            distribution=distribution,
            centre=tuple(0.5 * (high + low) * unit for low, high, unit in ends),
        )

    def draw(self, mission: Mission, n: int, seed: int) -> Array:
        """Parameters (n, d) of flights 0 … n − 1."""
        if n < 1:
            raise ValueError(f"n: expected at least one flight, got {n}")
        d = len(self.half_widths)
        if d != len(mission.parameters):
            names = ", ".join(parameter.name for parameter in mission.parameters)
            raise ValueError(
                f"dispersions.half_widths: expected {len(mission.parameters)} numbers "
                f"for {names}, got {d}"
            )
        offsets = np.empty((n, d))
        for i, child in enumerate(np.random.SeedSequence(seed).spawn(n)):
            rng = np.random.default_rng(child)
            if self.distribution is Distribution.NORMAL:
                offsets[i] = rng.standard_normal(d) / 3.0
            elif self.distribution is Distribution.UNIFORM:
                offsets[i] = rng.uniform(-1.0, 1.0, d)
            else:
                offsets[i] = rng.choice([-1.0, 1.0], d)
        centre = mission.nominal_parameters + np.array(self.centre or np.zeros(d))
        return np.asarray(centre + offsets * np.array(self.half_widths))
