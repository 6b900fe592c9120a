"""Descents as the estimator sees them: states over time, without the flight that made them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.flight_model import AZIMUTH, BANK, PATH_ANGLE

Array = NDArray[np.float64]


def descent(n: int, time: float, seconds: float) -> Array:
    """States (7, n) of flights that come down straight from 60 to 25 km in `seconds`, weaving."""
    share = time / seconds
    first = [60e3 - 35e3 * share, 0.0, 1.2, 4500.0 - 2500.0 * share, -0.05, -1.5, 0.0]
    state = np.repeat(np.array(first)[:, None], n, axis=1)
    state[BANK] = 0.6 * np.sin(0.05 * time) + 0.1 * np.arange(n)
    state[AZIMUTH] += 0.3 * np.sin(0.02 * time)
    return state


def axes(state: Array) -> Array:
    """Along, up and right (second index) of n states, in east, north and up (first): (3, 3, n)."""
    sine, cosine = np.sin(state[PATH_ANGLE]), np.cos(state[PATH_ANGLE])
    east, north = np.sin(state[AZIMUTH]), np.cos(state[AZIMUTH])
    along, up = (
        np.stack([cosine * east, cosine * north, sine]),
        np.stack([-sine * east, -sine * north, cosine]),
    )
    return np.stack([along, up, np.stack([north, -east, np.zeros_like(east)])], axis=1)
