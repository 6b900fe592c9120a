"""What corrections predict of many flights, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.simulation.correction_log import require_corrected
from ampi.simulation.monte_carlo import Scheme
from ampi.simulation.outcomes import flown
from ampi.simulation.plant import FlightStatus

Array = NDArray[np.float64]

GRID = np.geomspace(600.0, 1.0, 121)  # s to go
RECORDS = 1e4  # s: no histories


@dataclass(frozen=True, eq=False, kw_only=True)
class PredictedMisses:
    """Of n flights at k times before their ends; not-a-number where no correction has been made yet."""

    to_go: Array  # (k,), s, falling
    miss: Array  # (k, n), m: over the ground, as the last correction so far predicts it
    altitude: Array  # (k, n), m: size of the error of the altitude, likewise
    actual_miss: Array  # (n,), m; infinite where the target's speed was not reached
    actual_altitude: Array  # (n,), m


class _Noted:
    """Observes flights, and notes where each is predicted to end."""

    def __init__(self, n: int) -> None:
        self.times: list[float] = []
        self.missed: list[Array] = []  # (3, n) each
        self._counts = np.zeros(n, dtype=np.int64)
        self._last = np.full((3, n), np.nan)

    def __call__(self, time: float, guidance: Guidance) -> None:
        state = guidance.correction_state
        counts = state.counts.sum(axis=0)
        corrected = counts > self._counts
        if corrected.any():
            self._last = np.where(corrected, state.missed[:3], self._last)
            self._counts = counts
            self.times.append(time)
            self.missed.append(self._last)


def predicted_misses(
    mission: Mission, scheme: Scheme, n: int, *, seed: int = 2016, pool: str = "reported"
) -> PredictedMisses:
    """Fly the first `n` flights of a campaign at once, and read what is predicted of them.

    Raises
    ------
    ValueError
        If the scheme does not correct.
    """
    require_corrected(scheme.guidance)
    truth = scheme.loaded_world.draw(mission, n, seed, pool)
    noted = _Noted(n)
    arrays = flown(mission, scheme.guidance, truth, RECORDS, observer=noted)
    reached = arrays["status"] == int(FlightStatus.REACHED_SPEED)
    missed = np.array(noted.missed)
    at = np.searchsorted(noted.times, arrays["final_time"] - GRID[:, None], side="right") - 1
    last = missed[np.maximum(at, 0), :, np.arange(n)]  # (k, n, 3)
    last = np.where((at >= 0)[..., None], last, np.nan)
    return PredictedMisses(
        to_go=GRID,
        miss=np.linalg.norm(last[..., :2], axis=2),
        altitude=np.abs(last[..., 2]),
        actual_miss=np.where(reached, arrays["miss"], np.inf),
        actual_altitude=np.where(reached, np.abs(arrays["altitude_error"]), np.inf),
    )
