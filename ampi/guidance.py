"""Guidance: the two flying halves behind one interface.

`Guidance.reference` makes the reference of an entry, `Guidance.command` tracks it. Both return and
never raise in flight: what is unusual is a flag (`Reference.clipped`, `Health`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.table import GuidanceTable
from ampi.tracking.bank_limiter import BankLimits, limited_rate
from ampi.tracking.linear_quadratic import bank_rate_command

Array = NDArray[np.float64]

SANE = 1e12  # no state in SI units is larger; false for what is no number


class Health(IntEnum):
    """What the vehicle management should know."""

    GOOD = 0
    BOUNDARY_REFERENCE = 1  # the parameters lie outside the hypercube
    BAD_NAVIGATION = 2  # an input is no number: the reference's own bank rate is commanded
    AFTER_FINAL_TIME = 3  # the reference has ended: the bank angle is held
    HOLE_REFERENCE = 4  # the reference needs a case without solution: its neighbour stands for it


@dataclass(frozen=True)
class BankCommand:
    """Bank rate to be reached at the end of the cycle (rad/s), bank angle there (rad)."""

    bank_rate: float
    bank_angle: float
    health: Health


class Guidance:
    """Onboard guidance from a table, in one mode.

    `limits` are the nominal vehicle's; `limit_axes` names those of them that are parameters, each with
    its place in p: they are then what was measured.
    """

    def __init__(
        self,
        table: GuidanceTable,
        limits: BankLimits,
        mode: Mode = Mode.AMPI,
        *,
        cycle: float = 0.5,
        limit_axes: Mapping[str, int] | None = None,
        mission_sha256: str | None = None,
    ) -> None:
        self.limit_axes = dict(limit_axes or {})
        self.table, self.limits, self.mode, self.cycle = table, limits, mode, cycle
        self.mission_sha256 = mission_sha256  # of the database's mission; None if made by hand
        self._generator = ReferenceGenerator(table, mode)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickled as what it is made from; a worker allocates its own memory."""
        return _restored, (self._settings(self.mode),)

    def in_mode(self, mode: Mode) -> Guidance:
        """The same table flown in another mode."""
        return Guidance(**self._settings(mode))

    def _settings(self, mode: Mode) -> dict[str, Any]:
        return {
            "table": self.table,
            "limits": self.limits,
            "mode": mode,
            "cycle": self.cycle,
            "limit_axes": self.limit_axes,
            "mission_sha256": self.mission_sha256,
        }

    def limits_at(self, parameters: ArrayLike) -> BankLimits:
        """Bank limits of a vehicle with parameters p (d,), or of n with p (n, d).

        A limit that is no positive number, a navigation fault, is the nominal one.
        """
        if not self.limit_axes:
            return self.limits
        p = np.asarray(parameters, dtype=float)
        own = {
            name: np.where((p[..., i] > 0.0) & (p[..., i] < SANE), p[..., i], nominal)
            for name, i in self.limit_axes.items()
            for nominal in [getattr(self.limits, name)]
        }
        return replace(self.limits, **own)

    def reference(self, parameters: ArrayLike) -> Reference:
        """Reference for the measured parameters p (d,) of the table (SI, rad), in its order.

        Its arrays belong to the guidance and are overwritten by the next call; keep a `copy`.
        """
        return self._generator.reference(parameters)

    def command(
        self, reference: Reference, time: float, state: Array, bank_rate: float
    ) -> BankCommand:
        """Bank command for one guidance cycle.

        Parameters
        ----------
        reference
            From `reference`.
        time
            Since the entry interface (s).
        state
            Navigation state (h, θ, φ, V, γ, ψ, σ; SI, rad).
        bank_rate
            Present bank rate (rad/s).
        """
        health = Health.GOOD if reference.inside else Health.BOUNDARY_REFERENCE
        health = Health.HOLE_REFERENCE if reference.hole else health
        sane = bool(abs(time) < SANE and abs(bank_rate) < SANE and np.all(np.abs(state) < SANE))
        ended = bool(time >= reference.final_time)  # false for a time that is no number
        if not sane:
            health = Health.BAD_NAVIGATION
            time = time if abs(time) < SANE else reference.final_time
            bank_rate = bank_rate if abs(bank_rate) < SANE else 0.0
        k, w = locate(reference.times, time)
        at = (1.0 - w) * reference.states[:, k] + w * reference.states[:, k + 1]
        wanted = (1.0 - w) * reference.bank_rate[k] + w * reference.bank_rate[k + 1]
        bank = float(state[6]) if abs(state[6]) < SANE else float(at[6])
        if time >= reference.final_time:
            wanted, health = 0.0, Health.AFTER_FINAL_TIME if ended else health
        elif sane:
            gain = (1.0 - w) * reference.gains[:, k] + w * reference.gains[:, k + 1]
            wanted = float(bank_rate_command(state, at, wanted, gain))
        limits = self.limits_at(reference.parameters)
        rate = float(limited_rate(limits, bank, bank_rate, wanted, self.cycle))
        rate = min(max(rate, -float(limits.rate)), float(limits.rate))
        return BankCommand(rate, bank + 0.5 * (bank_rate + rate) * self.cycle, health)


def _restored(settings: dict[str, Any]) -> Guidance:
    return Guidance(**settings)


def locate(times: Array, time: float) -> tuple[int, float]:
    """Index k and weight w with time = (1 − w) times[k] + w times[k+1], held at both ends."""
    low, high = 0, len(times) - 1
    while high - low > 1:  # bisection: bounded by log₂ of the length
        middle = (low + high) // 2
        if times[middle] <= time:
            low = middle
        else:
            high = middle
    w = (time - times[low]) / (times[high] - times[low])
    return low, min(max(w, 0.0), 1.0)
