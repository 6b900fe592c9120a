"""What corrections predict of many flights, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.physics.state import LATITUDE, LONGITUDE
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
    predicted: Array  # (k, n), m: over the ground, by the last correction so far
    off: Array  # (k, n), m: from the end that it predicted to the one that came
    actual: Array  # (n,), m; infinite where the target's speed was not reached


class _Noted:
    """Observes flights, and notes where each is predicted to end."""

    def __init__(self, n: int) -> None:
        self.times: list[float] = []
        self.missed: list[Array] = []  # (2, n) each
        self._counts = np.zeros(n, dtype=np.int64)
        self._last = np.full((2, n), np.nan)

    def __call__(self, time: float, guidance: Guidance) -> None:
        state = guidance.correction_state
        counts = state.counts.sum(axis=0)
        corrected = counts > self._counts
        if corrected.any():
            self._last = np.where(corrected, state.missed[:2], self._last)
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
    truth = scheme.loaded_world.draw(mission, n, seed, pool)
    noted = _Noted(n)
    arrays = flown(mission, scheme.guidance, truth, RECORDS, observer=noted)
    reached = arrays["status"] == int(FlightStatus.REACHED_SPEED)
    missed = np.array(noted.missed)
    at = np.searchsorted(noted.times, arrays["final_time"] - GRID[:, None], side="right") - 1
    last = missed[np.maximum(at, 0), :, np.arange(n)]  # (k, n, 2)
    last = np.where((at >= 0)[..., None], last, np.nan)
    end = _end(mission, truth.parameters, arrays["final_states"])
    return PredictedMisses(
        to_go=GRID,
        predicted=np.linalg.norm(last, axis=2),
        off=np.linalg.norm(last - np.where(reached[:, None], end, np.nan), axis=2),
        actual=np.where(reached, arrays["miss"], np.inf),
    )


def _end(mission: Mission, parameters: Array, final: Array) -> Array:
    """East and north of the target (n, 2), m, as corrections measure it."""
    family = mission.family(parameters)
    radius = mission.flight_model.planet.equatorial_radius
    latitude = family.target("latitude")
    east = np.cos(latitude) * (final[:, LONGITUDE] - family.target("longitude"))
    return radius * np.stack([east, final[:, LATITUDE] - latitude], axis=1)
