"""Time on board: a flight's clock and its cycle, measured from the times that guidance is given.

No more is remembered than the last command's time and cycle. `reset`, or after `expect_begin` the first
time that does not go on, begins a flight.
"""

from __future__ import annotations

import numpy as np

from ampi.onboard.plausibility import SANE

NOMINAL_CYCLE = 0.5  # s, where none is stated
SHORTEST = 1e-3  # s; times that are nearer are the same
LONGEST = 20.0  # nominal cycles; after a longer silence the clock is doubted once
FORGOTTEN = 0.1  # of the shortest and the longest cycle, at each command


class CycleClock:
    """Measures its cycle; `stated` (s) is that of the first command, None where nobody knows it."""

    def __init__(self, stated: float | None) -> None:
        self.stated = stated
        self.nominal = NOMINAL_CYCLE if stated is None else float(stated)
        # shortest and longest that the first cycle may be
        self.first = (SHORTEST if stated is None else self.nominal, self.nominal)
        self.reset()

    def reset(self) -> None:
        """Begin a new flight: the next command is the first, whatever its time."""
        self._begins = True
        self.is_first = True  # whether the last time began a flight, or none has been given yet
        self._given = self.now = self._interval = np.nan
        self.shortest, self.longest = self.first
        self.expected = self.nominal

    def expect_begin(self) -> None:
        """The next time begins a flight if it does not go on."""
        self._begins = True

    def advance(self, time: float) -> bool:
        """Take the time of this command, and how long the command may stand; whether time goes on."""
        step = time - self._given
        goes_on = SHORTEST <= step <= LONGEST * self.nominal  # false for what is no number
        self.is_first = False
        if goes_on:
            if not self._interval > 0.0:  # none was known: this is the first
                self._interval = self.shortest = self.longest = step
            # of two, lest a silence counts as a cycle; both bounds forget slowly
            low, high = min(step, self._interval), max(step, self._interval)
            self.shortest = min(low, self.shortest + FORGOTTEN * (low - self.shortest))
            self.longest = max(high, self.longest + FORGOTTEN * (high - self.longest))
            self.expected = low
            self._interval, self.now = step, time
        elif self._begins and abs(time) < SANE:
            self.reset()
            self.now, goes_on = time, True
            self._interval = self.stated or np.nan
        else:
            self.now += self._interval if self._interval > 0.0 else self.nominal
        self._begins = self._begins and not goes_on
        self._given = time if abs(time) < SANE else self._given
        return goes_on
