"""Worlds as a test wants them: everything as the mission says, but for what is named."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.simulation.profiles import ALTITUDES
from ampi.simulation.truth import Truth
from ampi.simulation.uncertainties import CATALOGUE

Array = NDArray[np.float64]


def nominal_truth(
    parameters: Array,
    *,
    density: Array | None = None,
    wind: Array | None = None,
    seeds: ArrayLike | None = None,
    **numbers: ArrayLike,
) -> Truth:
    """n flights of p (n, d); `numbers` (SI, of all flights or (n,) each) by their name differ."""
    n = len(parameters)
    if unknown := set(numbers) - {uncertainty.name for uncertainty in CATALOGUE}:
        raise ValueError(f"numbers: expected names of the catalogue, got {sorted(unknown)}")
    return Truth(
        parameters=np.asarray(parameters, dtype=float),
        numbers={
            u.name: np.broadcast_to(numbers.get(u.name, u.nominal), n).astype(float)
            for u in CATALOGUE
        },
        altitudes=ALTITUDES,
        density=density,
        wind=wind,
        seeds=np.asarray(np.arange(n) if seeds is None else seeds, dtype=np.uint64),
    )
