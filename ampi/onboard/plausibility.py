"""What can be told from the inputs alone: are they vectors of numbers, and numbers of this table?

A state is plausible within the envelope of the table's own states, over all cases and nodes, widened by
half its width on each side. That is no judgement of a flight: the errors that a closed loop flies are
tenths of it. It is to tell degrees from radians, kilometres from metres, and a sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.row_layout import LINEAR_TRACKING

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
MOST_TURNS = 3.0  # that an angle may be away from the table's: beyond, it is in another unit
SANE = 1e12  # no input in SI units is larger; false for what is no number
MARGIN = 0.5  # of the envelope's width, on each side
NARROW = 0.2  # rad: an envelope of angles counts as at least that wide, a flight along a meridian …

LATITUDE, BANK = map(LINEAR_TRACKING.index, ("latitude", "bank_angle"))
# never below half of the table's least, if that is positive
POSITIVE = [LINEAR_TRACKING.index(name) for name in ("altitude", "speed")]
DIRECTIONS = [LINEAR_TRACKING.index(name) for name in ("longitude", "azimuth")]
LEVEL_ANGLES = [*DIRECTIONS, LATITUDE, LINEAR_TRACKING.index("flight_path_angle")]


def on_turn_of(angle: Any, reference: Any) -> Any:
    """`angle` (rad) less the whole turns, three at most, that bring it nearest to `reference`.

    It comes back to the bit where it needs none, and not-a-number where it is none.
    """
    turns = np.minimum(np.maximum(np.rint((angle - reference) / TURN), -MOST_TURNS), MOST_TURNS)
    return angle - TURN * turns


def numbers(value: Any, length: int) -> Array:
    """`value` as floats (length,); not-a-number all of it if it is no vector of that many numbers."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):  # a word, a ragged list, 10**400
        return np.full(length, np.nan)
    return array if array.shape == (length,) else np.full(length, np.nan)


def vectors(value: Any, length: int, n: int) -> tuple[Array, bool]:
    """`value` (length,) of one flight or (length, n) as floats (length, n), and whether it is of one.

    It is a copy; not-a-number all of it if it is something else.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.full((length, n), np.nan), n == 1
    if array.shape == (length, n):
        return array, False
    if array.shape == (length,) and n == 1:
        return array[:, None], True
    return np.full((length, n), np.nan), n == 1


def rows(value: Any, length: int) -> Array:
    """`value` (length,) of one flight or (n, length) as floats (n, length).

    Not-a-number all of it if it is something else; of one flight, unless it has n rows.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return np.full((1, length), np.nan)
    if array.ndim != 2 or len(array) == 0:
        return numbers(array, length)[None]
    return array if array.shape[1] == length else np.full((len(array), length), np.nan)


def number(value: Any) -> float:
    """`value` as a float; not-a-number if it is none, or more than one."""
    if isinstance(value, float):
        return float(value)
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        return float("nan")
    return float(array) if array.shape == () else float("nan")


@dataclass(frozen=True, eq=False)
class StateEnvelope:
    """Plausible states (h, θ, φ, V, γ, ψ, σ; SI, rad): |x − middle| ≤ reach."""

    middle: Array  # (7,)
    reach: Array  # (7,)

    @classmethod
    def of(cls, states: Array) -> StateEnvelope:
        """Of a table's states (…, 7, n)."""
        all_but_rows = (*range(states.ndim - 2), -1)
        least, greatest = states.min(axis=all_but_rows), states.max(axis=all_but_rows)
        width = greatest - least
        width[LEVEL_ANGLES] = np.maximum(width[LEVEL_ANGLES], NARROW)
        low, high = least - MARGIN * width, greatest + MARGIN * width
        for row in POSITIVE:
            if least[row] > 0.0:
                low[row] = max(low[row], 0.5 * least[row])
        middle, reach = 0.5 * (low + high), 0.5 * (high - low)
        # Any bank angle can be, the limiter brings it back; over a pole any longitude and azimuth, too.
        free = [*DIRECTIONS, BANK] if max(-low[LATITUDE], high[LATITUDE]) >= 0.5 * np.pi else [BANK]
        middle[free], reach[free] = 0.0, (MOST_TURNS + 0.5) * TURN
        middle.setflags(write=False)
        reach.setflags(write=False)
        return cls(middle, reach)

    def holds(self, state: Array) -> Any:
        """Whether a state (7,) is plausible, or each of n: (7, n) → (n,)."""
        error = state.T - self.middle
        within = np.abs(error) <= self.reach
        if within.all():
            return within[..., 0]
        # longitude and azimuth may be on another turn
        turned = on_turn_of(error[..., DIRECTIONS], 0.0)
        within[..., DIRECTIONS] = np.abs(turned) <= self.reach[DIRECTIONS]
        return within.all(axis=-1)
