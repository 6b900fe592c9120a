"""Dispersions of the parameters p, Sagliano et al. 2016, Eq. (34), one spawned seed per flight.

Flight i draws from the i-th child of the campaign's SeedSequence, so its parameters depend on the
seed and on i alone: not on the number of flights, of workers, or on the order of execution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.parameters import Parameter

Array = NDArray[np.float64]


class Distribution(StrEnum):
    """Shape of the dispersion over the half-widths."""

    NORMAL = "normal"  # the half-width is 3σ: Eq. (34); some draws lie outside
    UNIFORM = "uniform"  # between the half-widths on both sides of the centre
    CORNERS = "corners"  # one of the 2^d vertices of that box

    @classmethod
    def _missing_(cls, value: object) -> Distribution:
        raise ValueError(f"distribution: expected one of {', '.join(cls)}, got {value!r}")


def require_count(n: int) -> None:
    """Raise ValueError if this is no number of flights."""
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 1:
        raise ValueError(f"n: expected at least one flight, a whole number; got {n!r}")


def require_seed(seed: int) -> None:
    """Raise ValueError if this is no seed."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed: expected a whole number, 0 or greater, got {seed!r}")


@dataclass(frozen=True)
class Dispersions:
    """Half-widths of the d parameters (SI, rad), their distribution, and where it is centred."""

    half_widths: tuple[float, ...]
    distribution: Distribution = Distribution.NORMAL  # or its name
    centre: tuple[float, ...] | None = None  # offset from the nominal p (SI, rad); None: none

    def __post_init__(self) -> None:
        widths, centre = _numbers(self.half_widths), None
        if self.centre is not None:
            centre = _numbers(self.centre)
        if widths is None or any(width < 0.0 for width in widths):
            raise ValueError(
                "dispersions.half_widths: expected non-negative numbers, one per parameter, "
                f"got {self.half_widths!r}"
            )
        if self.centre is not None and (centre is None or len(centre) != len(widths)):
            raise ValueError(
                f"dispersions.centre: expected {len(widths)} finite offsets, got {self.centre!r}"
            )
        object.__setattr__(self, "half_widths", widths)
        object.__setattr__(self, "distribution", Distribution(self.distribution))
        object.__setattr__(self, "centre", centre)

    @classmethod
    def from_mission(
        cls, mission: Mission, distribution: Distribution | str = Distribution.NORMAL
    ) -> Dispersions:
        """The extent of the mission's parameter grid: Eq. (34) repeats Eq. (9).

        A normal distribution is centred on the nominal p, and 3σ is the farther end of each axis: on a
        lopsided axis some draws lie beyond the nearer end. The others are of the grid's own box.
        """
        law = Distribution(distribution)
        ends = np.array([_ends(parameter) for parameter in mission.parameters]).reshape(-1, 2)
        if law is Distribution.NORMAL:
            return cls(tuple(np.abs(ends).max(axis=1, initial=0.0).tolist()), law)
        middle, half = ends.mean(axis=1), 0.5 * np.diff(ends)[:, 0]
        return cls(tuple(half.tolist()), law, tuple(middle.tolist()) if np.any(middle) else None)

    def draw(self, mission: Mission, n: int, seed: int) -> Array:
        """Parameters (n, d) of flights 0 … n − 1."""
        require_count(n)
        require_seed(seed)
        self._require_size(mission)
        d = len(self.half_widths)
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

    def in_words(self, mission: Mission) -> str:
        """What is drawn, as offsets from the nominal numbers in the units of the mission's grid."""
        self._require_size(mission)
        parts = []
        for parameter, width, middle in zip(
            mission.parameters,
            self.half_widths,
            self.centre or [0.0] * len(self.half_widths),
            strict=True,
        ):
            unit = parameter.number.per_unit
            about = f"{middle / unit:+.4g} " if middle else ""
            parts.append(f"{parameter.key} {about}± {width / unit:.4g}")
        sigma = " (3σ)" if self.distribution is Distribution.NORMAL else ""
        return f"{self.distribution}{sigma}: {', '.join(parts)}"

    def _require_size(self, mission: Mission) -> None:
        if len(self.half_widths) != len(mission.parameters):
            names = ", ".join(parameter.name for parameter in mission.parameters)
            raise ValueError(
                f"dispersions.half_widths: expected {len(mission.parameters)} numbers "
                f"for {names}, got {len(self.half_widths)}"
            )


def _ends(parameter: Parameter) -> tuple[float, float]:
    """First and last offset of an axis (SI, rad)."""
    unit = parameter.number.per_unit
    return parameter.offsets[0] * unit, parameter.offsets[-1] * unit


def _numbers(values: Sequence[float]) -> tuple[float, ...] | None:
    """A vector of finite numbers as floats; None if it is something else."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return None
    if array.ndim != 1 or isinstance(values, str) or not np.all(np.isfinite(array)):
        return None
    return tuple(array.tolist())
