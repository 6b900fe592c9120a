"""What the misses of one campaign come from: rank correlations with everything that was dispersed.

The distance missed has no sign, and grows with errors of either sign; the miss along the track shows the
effects that have one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.report.dispersed import dispersed
from ampi.simulation.estimates.bootstrap import Estimate
from ampi.simulation.estimates.sensitivity import FEWEST, rank_correlations
from ampi.simulation.flights import Flights

Array = NDArray[np.float64]

UNKNOWN = Estimate(np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Correlation:
    """Spearman's ρ of one dispersion."""

    miss: Estimate  # with the distance missed; a flight that did not arrive is the farthest
    along: Estimate  # with the miss along the track, of the flights that arrived

    @property
    def size(self) -> float:
        """The greater of the two, without a sign."""
        return float(np.nanmax([abs(self.miss.value), abs(self.along.value), 0.0]))


def correlations(mission: Mission, flights: Flights) -> dict[str, Correlation]:
    """Of every number that varies, by its name in words, the most telling first."""
    inputs = {one.words: one.values for one in dispersed(mission, flights) if one.varies}
    if not inputs:
        return {}
    known = np.all(np.isfinite(list(inputs.values())), axis=0)
    miss = np.where(flights.reached, flights.miss, np.inf)
    distance = _ranked(inputs, miss, known)
    along = _ranked(inputs, flights.along, known & flights.reached)
    found = {name: Correlation(distance[name], along[name]) for name in inputs}
    return dict(sorted(found.items(), key=lambda item: -item[1].size))


def _ranked(inputs: dict[str, Array], output: Array, of: NDArray[np.bool_]) -> dict[str, Estimate]:
    """From the flights `of`, if they are enough."""
    if np.count_nonzero(of) < FEWEST:
        return dict.fromkeys(inputs, UNKNOWN)
    values = np.stack([one[of] for one in inputs.values()], axis=1)
    return rank_correlations(values, output[of], list(inputs))
