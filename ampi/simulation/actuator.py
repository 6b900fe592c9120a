"""What becomes of a command: a transport delay d, then a first-order lag τ, on top of the limits.

A command is reached linearly at the end of its cycle, so what acts on the lag is c(t − d), piecewise
linear. Over a step of length h along which c = c₀ + m s, the exact answer of τ ṙ = c − r is

    r(h) = c₀ + m (h − τ) + (r₀ − c₀ + m τ) exp(−h/τ),                       (1)

linear between the ends of the step for the plant. A lag never exceeds the limits in rate and
acceleration that the command keeps; it may carry the bank angle beyond its limit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.simulation.delay import Delay
from ampi.simulation.truth import Truth

Array = NDArray[np.float64]


class Actuator:
    """Of n flights: bank rate and change of the angle of attack, (2, n), alike."""

    def __init__(self, truth: Truth, cycle: float, first: Array) -> None:
        """It has been at `first` for long."""
        numbers = truth.numbers
        self._cycle, self.flown = cycle, first
        self._before = self._command = first
        delay, self._lag = numbers["actuator_delay"] / cycle, numbers["actuator_lag"]
        self._delay = Delay(delay, first) if np.any(delay > 0.0) else None
        self._is_lagged = bool(np.any(self._lag > 0.0))

    def command(self, wanted: Array) -> None:
        """What is to be reached at the end of the cycle that begins."""
        self._before, self._command = self._command, wanted
        if self._delay is not None:
            self._delay.push(wanted)

    def advance(self, begin: float, end: float) -> tuple[Array, Array]:
        """What is flown at the begin and at the end of a step, given as shares of the cycle."""
        old = self.flown
        asked, then = self._asked(begin), self._asked(end)
        self.flown = self._lagged(old, asked, then, (end - begin) * self._cycle)
        return old, self.flown

    def _asked(self, share: float) -> Array:
        if self._delay is not None:
            return self._delay.value(share)
        if share in (0.0, 1.0):
            return self._command if share else self._before
        older = 1.0 - share  # the sum that `Delay` forms: no delay, beside one, changes no bit
        return self._command * (1.0 - older) + self._before * older

    def _lagged(self, old: Array, asked: Array, then: Array, h: float) -> Array:
        if not self._is_lagged:
            return then
        lag = np.where(self._lag > 0.0, self._lag, 1.0)
        slope = (then - asked) / h
        lagged = asked + slope * (h - lag) + (old - asked + slope * lag) * np.exp(-h / lag)
        return np.where(self._lag > 0.0, lagged, then)
