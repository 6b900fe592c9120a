"""The plan that is flown: bank angle and change of the angle of attack over the equivalent speed.

The equivalent speed is the speed at the target's altitude of a vehicle that keeps its energy,

    v = √(V² + 2 g₀ (h − h_f)),                                                              (1)

which falls as long as there is drag, and is V_f at the target. Over time a plan would be flown too early
in thin air and too late in dense air; over energy it is flown where it was meant to be. Each of the two
angles is linear between values p_0 … p_m that are equally spaced from the speed v_0, where the plan was
laid, to V_f, and held beyond,

    u(v) = (1 − s) p_k + s p_{k+1},   k + s = m (v_0 − v)/(v_0 − V_f).                       (2)

As the flight goes on, the plan is laid anew on what is left of it: its new values are those of (2) at
the new spacing, so that the corrections always have all values for the rest of the flight. That cuts
the corners between the new values; laid anew where it began, a plan is the same.

Source: own; energy as the independent variable of entry guidance: Lu 2014.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.correction.settings import N_ANGLES, N_BANKS, N_PLAN

Array = NDArray[np.float64]

BANKS, CHANGES = slice(0, N_BANKS), slice(N_BANKS, N_PLAN)
SHORTEST = 1.0  # m/s, from the first value to the last


def equivalent_speed(gravity: float, target_altitude: Any, altitude: Any, speed: Any) -> Any:
    """Eq. (1), m/s, of flights with `altitude` (m) and `speed` (m/s)."""
    height = 2.0 * gravity * (altitude - target_altitude)
    return np.sqrt(np.maximum(speed * speed + height, 0.0))


FIRST = np.array([0, N_BANKS])  # value of each angle
LAST = np.array([N_BANKS - 1.0, N_ANGLES - 1.0])  # m of Eq. (2)


@dataclass(frozen=True, eq=False)
class Plans:
    """Of n flights, or k for each of n."""

    fast: Array  # (n,), m/s: v_0
    slow: Array  # (n,), m/s: V_f
    values: Array  # (18, n) or (18, k, n), rad: bank angles, changes of the angle of attack

    @cached_property
    def _offset(self) -> NDArray[np.intp]:
        """Places of the first values of both angles in all values: (2, …)."""
        own = self.values[0]
        first = FIRST.reshape(2, *(1,) * own.ndim) * own.size
        return np.asarray(first + np.arange(own.size).reshape(own.shape))

    def at(self, speed: Array) -> Array:
        """Bank angle and change of the angle of attack (2, …), rad, Eq. (2), at `speed` (…)."""
        share, last = (
            (self.fast - speed) / (self.fast - self.slow),
            LAST.reshape(2, *(1,) * speed.ndim),
        )
        place = np.minimum(np.maximum(share * last, 0.0), last)
        below = np.minimum(place, last - 1.0).astype(np.intp)
        size, flat = self.values[0].size, self.values.reshape(-1)
        at = below * size + self._offset
        low = flat.take(at, mode="clip")  # where the speed is no number, neither is the share
        return np.asarray(low + (place - below) * (flat.take(at + size, mode="clip") - low))

    def laid(self, fast: Array, slow: Array) -> Plans:
        """The same plans laid on what is left: from `fast` to `slow` (n,), m/s."""
        fast = np.maximum(fast, slow + SHORTEST)
        values = [
            self.at(fast - i / last * (fast - slow))[angle]
            for angle, last in enumerate(LAST)
            for i in range(int(last) + 1)
        ]
        return Plans(fast, slow, np.stack(values))

    def of(self, flights: NDArray[np.intp]) -> Plans:
        """Those of some flights."""
        return Plans(
            self.fast[flights], self.slow[flights], np.ascontiguousarray(self.values[..., flights])
        )

    def with_values(self, values: Array) -> Plans:
        """Others over the same speeds."""
        return Plans(self.fast, self.slow, values)


def plans_through(speed: Array, bank: Array, fast: Array, slow: Array, most_bank: Array) -> Plans:
    """Plans from `fast` to `slow` (n,) that fly what is sampled, the angle of attack as scheduled.

    Parameters
    ----------
    speed, bank
        Equivalent speeds (m/s) and bank angles (rad) along n references: (s, n).
    most_bank
        Limit of the bank angle, ± (n,), rad.
    """
    values, last = np.zeros((N_PLAN, len(fast))), len(speed) - 2
    flights = np.arange(len(fast))
    for i in range(N_BANKS):
        wanted = fast - i / (N_BANKS - 1.0) * (fast - slow)
        passed = np.logical_and.accumulate(speed[1:] > wanted, axis=0).sum(axis=0)
        at = np.minimum(passed, last)
        before, after = speed[at, flights], speed[at + 1, flights]
        w = np.minimum(np.maximum((before - wanted) / np.maximum(before - after, 1e-9), 0.0), 1.0)
        low, high = bank[at, flights], bank[at + 1, flights]
        values[i] = np.minimum(np.maximum(low + w * (high - low), -most_bank), most_bank)
    return Plans(fast, slow, values)
