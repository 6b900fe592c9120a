"""Guidance: the two flying halves behind one interface.

`Guidance.reference` makes the reference of an entry, `Guidance.command` tracks it. Both return and
never raise in flight: what is unusual is told by their `health`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.onboard.health import Health
from ampi.onboard.plausibility import BANK, SANE, number, numbers
from ampi.onboard.reference import Mode, Reference, ReferenceGenerator
from ampi.onboard.row_layout import N_STATES
from ampi.onboard.table import GuidanceTable
from ampi.tracking.bank_limiter import NEAR_INVERTED, BankLimits, bank_on_turn, limited_rate
from ampi.tracking.linear_quadratic import bank_rate_command

Array = NDArray[np.float64]

NOMINAL_CYCLE = 0.5  # s, where none is stated
SHORTEST = 1e-3  # s; times that are nearer are the same
LONGEST = 20.0  # nominal cycles; after a longer silence the clock is doubted once
FORGOTTEN = 0.1  # of the shortest and the longest cycle, at each command
FASTEST = 2.0  # times the rate limit; a vehicle that is said to roll faster is told in another unit


@dataclass(frozen=True)
class BankCommand:
    """Bank rate to be reached at the end of the cycle (rad/s), bank angle there (rad)."""

    bank_rate: float
    bank_angle: float
    health: Health


class Guidance:
    """Onboard guidance from a table, in one mode, of one vehicle.

    `limits` are the nominal vehicle's; `limit_axes` names those of them that are parameters, each with
    its place in p: they are then what was measured.

    It measures its cycle from the times that it is given, and remembers no more than the last command
    and its time: `reset`, or the first command after a new reference whose time does not go on, begins
    a flight. `cycle` (s) is the nominal one, that of the first command. Where it is not stated the first
    command changes next to nothing, for nobody knows yet how long it will stand.
    """

    def __init__(
        self,
        table: GuidanceTable,
        limits: BankLimits,
        mode: Mode | str = Mode.AMPI,
        *,
        cycle: float | None = None,
        limit_axes: Mapping[str, int] | None = None,
        mission_sha256: str | None = None,
    ) -> None:
        self.table, self.limits, self.mode = table, limits, Mode(mode)
        self.limit_axes = dict(limit_axes or {})
        _check(table, limits, cycle, self.limit_axes)
        self.cycle = NOMINAL_CYCLE if cycle is None else float(cycle)
        # shortest and longest that the first cycle may be
        self.first_cycle = (SHORTEST if cycle is None else self.cycle, self.cycle)
        self.mission_sha256 = mission_sha256  # of the database's mission; None if made by hand
        self._generator = ReferenceGenerator(table, self.mode)
        self._stated = cycle
        self.reset()

    def __reduce__(self) -> tuple[object, ...]:
        """Pickled as what it is made from; a worker allocates its own memory."""
        return _restored, (self._settings(self.mode),)

    def in_mode(self, mode: Mode | str) -> Guidance:
        """The same table flown in another mode."""
        return Guidance(**self._settings(mode))

    def at_cycle(self, cycle: float) -> Guidance:
        """The same guidance for a loop of another nominal cycle (s)."""
        return Guidance(**{**self._settings(self.mode), "cycle": cycle})

    def _settings(self, mode: Mode | str) -> dict[str, Any]:
        return {
            "table": self.table,
            "limits": self.limits,
            "mode": mode,
            "cycle": self._stated,
            "limit_axes": self.limit_axes,
            "mission_sha256": self.mission_sha256,
        }

    def reset(self) -> None:
        """Begin a new flight: the next command is the first, whatever its time."""
        self._begins = True
        self._given = self._clock = self._interval = np.nan
        self._shortest, self._longest = self.first_cycle
        self._expected = self.cycle
        self._bank = self._rate = np.nan  # of the last command

    def limits_at(self, parameters: ArrayLike) -> BankLimits:
        """Bank limits of a vehicle with parameters p (d,), or of n with p (n, d).

        A limit that is no positive number, a navigation fault, is the nominal one; one beyond its axis,
        in degrees perhaps, ends at the axis: no reference needs more.
        """
        if not self.limit_axes:
            return self.limits
        p = np.asarray(parameters, dtype=float)
        own = {}
        for name, i in self.limit_axes.items():
            told, nominal, most = p[..., i], getattr(self.limits, name), self.table.axes[i][-1]
            own[name] = np.where((told > 0.0) & (told < SANE), np.minimum(told, most), nominal)
        return replace(self.limits, **own)

    def reference(self, parameters: ArrayLike) -> Reference:
        """Reference for the measured parameters p (d,) of the table (SI, rad), in its order.

        Its arrays belong to the guidance and are overwritten by the next call; keep a `copy`.
        """
        self._begins = True
        return self._generator.reference(parameters)

    def command(
        self, reference: Reference, time: float, state: ArrayLike, bank_rate: float
    ) -> BankCommand:
        """Bank command for one guidance cycle. Never an exception: what is unusual is its `health`.

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
        health = reference.health
        in_time = self._advance(number(time))
        ended = self._clock >= reference.final_time
        x, rate = numbers(state, N_STATES), number(bank_rate)
        # without any time the bank angle is held, as after the end
        now = self._clock if self._clock == self._clock else reference.final_time
        k, w = locate(reference.times, now)
        between = np.array((1.0 - w, w))
        at = reference.states[:, k : k + 2] @ between
        wanted = (1.0 - w) * reference.bank_rate[k] + w * reference.bank_rate[k + 1]
        limits = self.limits_at(reference.parameters)

        navigated = bool(self.table.envelope.holds(x))
        rolls = bool(abs(rate) <= FASTEST * limits.rate)
        if not (navigated and rolls):
            known = bool((np.abs(x) < SANE).all()) and abs(rate) < SANE
            health = Health.IMPLAUSIBLE_NAVIGATION if known else Health.BAD_NAVIGATION
        if not rolls:
            rate = self._rate if self._rate == self._rate else float(wanted)
        bank = float(x[BANK])
        if not abs(bank) <= self.table.envelope.reach[BANK]:
            bank = self._bank if self._bank == self._bank else float(at[BANK])
        if abs(bank) > np.pi or limits.angle > NEAR_INVERTED:  # otherwise it is on its turn
            bank = float(bank_on_turn(limits, bank, at[BANK]))

        if now >= reference.final_time:
            wanted = 0.0
        elif navigated:
            gain = reference.gains[:, k : k + 2] @ between
            x = x.copy()
            x[BANK] = bank
            wanted = bank_rate_command(x, at, wanted, gain)
        if ended:
            health = Health.AFTER_FINAL_TIME
        elif not in_time:
            health = Health.BAD_TIME
        new = float(limited_rate(limits, bank, rate, wanted, self._longest, self._shortest))
        self._rate, self._bank = new, bank + 0.5 * (rate + new) * self._expected
        return BankCommand(self._rate, self._bank, health)

    def _advance(self, time: float) -> bool:
        """Take the time of this command, and how long the command may stand; whether time goes on."""
        step = time - self._given
        goes_on = SHORTEST <= step <= LONGEST * self.cycle  # false for what is no number
        if goes_on:
            if not self._interval > 0.0:  # none was known: this is the first
                self._interval = self._shortest = self._longest = step
            # of two, lest a silence counts as a cycle; both bounds forget slowly
            low, high = min(step, self._interval), max(step, self._interval)
            self._shortest = min(low, self._shortest + FORGOTTEN * (low - self._shortest))
            self._longest = max(high, self._longest + FORGOTTEN * (high - self._longest))
            self._expected = low
            self._interval, self._clock = step, time
        elif self._begins and abs(time) < SANE:
            self.reset()
            self._clock, goes_on = time, True
            self._interval = self._stated or np.nan
        else:
            self._clock += self._interval if self._interval > 0.0 else self.cycle
        self._begins = self._begins and not goes_on
        self._given = time if abs(time) < SANE else self._given
        return goes_on


def _check(table: Any, limits: Any, cycle: Any, limit_axes: dict[str, int]) -> None:
    """On the ground: what flies is what it should be."""
    if not isinstance(table, GuidanceTable):
        raise ValueError(f"table: expected a GuidanceTable, got {type(table).__name__}")
    if not isinstance(limits, BankLimits) or np.ndim(
        limits.angle + limits.rate + limits.acceleration
    ):
        raise ValueError(f"limits: expected the BankLimits of one vehicle, got {limits!r}")
    if cycle is not None and not SHORTEST <= number(cycle) < SANE:
        raise ValueError(f"cycle: expected at least {SHORTEST:g} s, got {cycle!r}")
    for name, i in limit_axes.items():
        if name not in ("angle", "rate", "acceleration") or i not in range(len(table.axes)):
            raise ValueError(
                f"limit_axes: expected angle, rate or acceleration and the number of an axis, 0 to "
                f"{len(table.axes) - 1}, got {name!r}: {i!r}"
            )
        if not table.axes[i][0] > 0.0:
            raise ValueError(f"limit_axes: {name}: expected an axis of positive numbers, axis {i}")


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
