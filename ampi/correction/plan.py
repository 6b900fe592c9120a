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


def between(values: Array, place: Any) -> Array:
    """Piecewise linear through `values` (m + 1, …) at places 0 … m of the shape behind; held beyond."""
    last, size = len(values) - 1, values[0].size
    inside = np.minimum(np.maximum(place, 0.0), float(last))
    below = np.minimum(inside, last - 1.0).astype(np.intp)
    share = inside - below
    at, flat = below * size + np.arange(size).reshape(below.shape), values.reshape(-1)
    low = flat.take(at, mode="clip")  # where the place is no number, neither is the share
    return np.asarray(low + share * (flat.take(at + size, mode="clip") - low))


@dataclass(frozen=True, eq=False)
class Plans:
    """Of n flights, or k for each of n."""

    fast: Array  # (n,), m/s: v_0
    slow: Array  # (n,), m/s: V_f
    values: Array  # (18, n) or (18, k, n), rad: bank angles, changes of the angle of attack

    def bank(self, speed: Array) -> Array:
        """Bank angle (rad), Eq. (2), at equivalent speeds of the shape behind the values."""
        return between(self.values[BANKS], self._share(speed) * (N_BANKS - 1.0))

    def change(self, speed: Array) -> Array:
        """Change of the angle of attack (rad)."""
        return between(self.values[CHANGES], self._share(speed) * (N_ANGLES - 1.0))

    def both(self, speed: Array) -> tuple[Array, Array]:
        """Bank angle and change of the angle of attack (rad)."""
        share = self._share(speed)
        return (
            between(self.values[BANKS], share * (N_BANKS - 1.0)),
            between(self.values[CHANGES], share * (N_ANGLES - 1.0)),
        )

    def _share(self, speed: Array) -> Array:
        return np.asarray((self.fast - speed) / (self.fast - self.slow))

    def laid(self, fast: Array, slow: Array) -> Plans:
        """The same plans laid on what is left: from `fast` to `slow` (n,), m/s."""
        fast = np.maximum(fast, slow + SHORTEST)
        banks = [self.bank(fast - i / (N_BANKS - 1.0) * (fast - slow)) for i in range(N_BANKS)]
        changes = [
            self.change(fast - i / (N_ANGLES - 1.0) * (fast - slow)) for i in range(N_ANGLES)
        ]
        return Plans(fast, slow, np.stack([*banks, *changes]))

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
