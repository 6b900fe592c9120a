"""Guidance that re-selects its reference in flight: the table alone, no prediction on board.

The table has axes of density and lift. At fixed instants what is known of vehicle and air moves the
parameters along them, and the optimum of the vehicle as it is takes the place of the one that was flown;
the clock goes on. That optimum starts from the measured entry, but the flight has flown another one
until now and is not on it: so the entry parameters are moved, too, to those of the optimum of these
factors that passes nearest (`optimum_field`). Optima are of still air: between the instants, too, the
tracking law is told the flight as the air sees it (`still_air`).

    guidance = Reselecting(table_guidance, air, plan, settings)
    guidance.begin(parameters); command = guidance.step(time, navigation, sensed)

It stands where a `Guidance` stands in a loop: n flights of one clock, and `step` never raises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.guidance import N_NAVIGATED, N_SENSED, Guidance
from ampi.onboard.command import Command
from ampi.onboard.flight_model import LATITUDE
from ampi.onboard.flown_references import FlownReferences
from ampi.onboard.plausibility import number, rows, vectors
from ampi.onboard.reference import NodalReference, Reference
from ampi.onboard.row_layout import N_STATES
from ampi.onboard.table import GuidanceTable
from ampi.outcome import Outcome
from ampi.reselection.known_air import Found, KnownAir
from ampi.reselection.optimum_field import N_MATCHED, MatchWeights, OptimumField
from ampi.reselection.settings import ReselectionSettings
from ampi.reselection.still_air import StillAir
from ampi.tracking.bank_limiter import BankLimits
from ampi.tracking.law import TrackingLaw

Array = NDArray[np.float64]

SANE_FACTORS = (0.2, 5.0)  # beyond, an estimate is none
FASTEST_WIND = 300.0  # m/s; beyond, an estimate is none


class Reselection(Outcome):
    """What the last instant of re-selection brought a flight."""

    NOT_YET = 0, "No instant has come yet."
    RESELECTED = 1, "The reference is that of what is known and of the state."
    OUTSIDE = 2, "The same, of factors beyond the table: the reference is of its boundary."
    UNCHANGED = 3, "The parameters are those of the reference that is flown: it stays."
    BAD_ESTIMATE = (
        4,
        "What is known of vehicle and air is no number, or absurd: the reference stays.",
    )
    BAD_STATE = 5, "The state is no number, or implausible: the reference stays."
    ENDING = 6, "The end is near: the reference stays."


@dataclass(frozen=True)
class ParameterPlan:
    """What the parameters of the table are; d of them, in its order."""

    told: tuple[int | None, ...]  # of each its place among those told at the begin; None: nominal
    n_told: int  # how many are
    density: int  # number of the axis of the density factor
    lift: int  # of the lift factor


class Reselecting:
    """A guidance that flies a table with axes of density and lift, re-selected in flight.

    `radius` is the planet's (m). `outcome` (n,) holds a `Reselection` of each flight, `counts` (k, n)
    how often each of them has come.

    Raises
    ------
    ValueError
        If the plan is not one of the table.
    """

    engine: ClassVar[str] = "numpy"  # of the loop that flies it
    senses: ClassVar[bool] = True
    correction: ClassVar[None] = None

    def __init__(
        self,
        guidance: Guidance,
        air: KnownAir,
        plan: ParameterPlan,
        *,
        radius: float,
        settings: ReselectionSettings | None = None,
    ) -> None:
        self.settings = own = ReselectionSettings() if settings is None else settings
        self._guidance, self.air, self.plan = guidance, air, plan
        _check(plan, guidance.table)
        table = guidance.table
        self._nominal = np.array([a[i] for a, i in zip(table.axes, table.centre, strict=True)])
        self._field = OptimumField(table, (plan.density, plan.lift))
        self._still = StillAir.of(table, radius, own.calm)
        latitude = table.values[table.centre][LATITUDE, -1]
        east = own.position / (radius * np.cos(latitude))
        scale = [own.altitude, east, own.position / radius, own.speed, own.angle, own.angle]
        self._weights = MatchWeights(np.array(scale), own.entry, own.steps)
        self._entry = np.empty((0, len(table.axes)))

    @property
    def table(self) -> GuidanceTable:
        """That flies."""
        return self._guidance.table

    @property
    def law(self) -> TrackingLaw:
        """That tracks the references."""
        return self._guidance.law

    @property
    def modulates(self) -> bool:
        """Whether it changes the angle of attack."""
        return self.law.modulates

    @property
    def cycle(self) -> float:
        """The nominal cycle (s)."""
        return self._guidance.cycle

    @property
    def flown(self) -> FlownReferences:
        """The references that are being flown."""
        return self._guidance.flown

    @property
    def references(self) -> tuple[NodalReference, ...]:
        """The same, one for each flight."""
        return tuple(self._references)

    @property
    def tracked_states(self) -> Array:
        """States (7, n) of the references where the last command has looked them up."""
        return self._guidance.tracked_states

    def limits_at(self, parameters: ArrayLike) -> BankLimits:
        """Bank limits of the flights, whatever their parameters."""
        return self._guidance.limits

    def begin(self, parameters: ArrayLike) -> None:
        """Begin the flight of p, as told, or n flights of p (n, t), on the references of no factors."""
        told = rows(parameters, self.plan.n_told)
        n = len(told)
        self._entry = np.tile(self._nominal, (n, 1))
        for axis, place in enumerate(self.plan.told):
            if place is not None:
                self._entry[:, axis] = told[:, place]
        self.air.begin(n)
        self._next = self.settings.first
        self.outcome = np.full(n, int(Reselection.NOT_YET))
        self.counts = np.zeros((len(Reselection), n), dtype=np.int64)
        self._references: list[Reference] = [
            self._guidance.reference(p).copy() for p in self._entry
        ]
        self._guidance.follow(self._references)
        self._guidance.reset()

    def step(self, time: float, navigation: ArrayLike, sensed: ArrayLike | None = None) -> Command:
        """Commands of one cycle, as `Guidance.step`; at an instant, of new references."""
        n, now = len(self._entry), number(time)
        navigated, is_one = vectors(navigation, N_NAVIGATED, max(n, 1))
        felt = np.full((N_SENSED, len(navigated.T)), np.nan)
        if sensed is not None:
            felt = vectors(sensed, N_SENSED, len(navigated.T))[0]
        if n == 0:
            return self._guidance.step(time, navigation, sensed)
        with np.errstate(all="ignore"):
            self.air.update(now, navigated, felt)
            found = self.air.found()
            seen = self._seen(now, navigated, found)
            if now >= self._next:
                self._reselect(now, seen, found)
        return self._guidance.step(
            time, seen[:, 0] if is_one else seen, felt[:, 0] if is_one else felt
        )

    def _seen(self, now: float, navigated: Array, found: Found) -> Array:
        """Navigation in the frame of the air; of a wind that is none, as it was told."""
        known = np.maximum(np.abs(found.east), np.abs(found.north)) < FASTEST_WIND
        known = known & np.any([found.east != 0.0, found.north != 0.0], axis=0)
        to_go = np.maximum(self.flown.final_time - now, 0.0)
        seen = self._still.seen(navigated, found.east, found.north, to_go)
        return np.where(known & np.all(np.isfinite(seen), axis=0), seen, navigated)

    def _reselect(self, now: float, seen: Array, found: Found) -> None:
        """New references, of those whose estimate and state are some and that differ."""
        every = self.settings.every
        self._next += every * (1.0 + np.floor((now - self._next) / every))
        asked = self._entry.copy()
        asked[:, self.plan.density], asked[:, self.plan.lift] = found.density, found.lift
        good = self._judge(now, seen, found)
        if good.any() and self.settings.matches and self._field.free:
            # what is no number takes no part: it would not converge, but each flight is by itself
            state = np.where(good, seen[:N_MATCHED], self.tracked_states[:N_MATCHED])
            asked = np.where(good[:, None], asked, self._nominal)
            asked = self._field.matched(now, state, asked, self._weights)
        for i in np.flatnonzero(good):
            self._take(int(i), asked[i])
        self.counts[self.outcome, np.arange(len(good))] += 1
        self._guidance.follow(self._references)

    def _judge(self, now: float, seen: Array, found: Found) -> NDArray[np.bool_]:
        """Which flights (n,) can be re-selected; of the others the outcome says why not."""
        least, most = SANE_FACTORS
        factors = np.stack([found.density, found.lift])
        known = np.all((factors >= least) & (factors <= most), axis=0)
        there = self.table.envelope.holds(seen[:N_STATES]) & np.isfinite(seen).all(axis=0)
        ending = now > self.flown.final_time - self.settings.rest
        why = np.where(there, Reselection.BAD_ESTIMATE, Reselection.BAD_STATE)
        why = np.where(ending, Reselection.ENDING, why)
        good: NDArray[np.bool_] = known & there & ~ending
        self.outcome = np.where(good, Reselection.UNCHANGED, why)
        return good

    def _take(self, flight: int, parameters: Array) -> None:
        """The reference of these parameters, if it is another one."""
        if self._references[flight].parameters == tuple(parameters.tolist()):
            return
        found = self._guidance.reference(parameters).copy()
        self._references[flight] = found
        inside = found.inside
        self.outcome[flight] = Reselection.RESELECTED if inside else Reselection.OUTSIDE


def _check(plan: ParameterPlan, table: Any) -> None:
    """On the ground: the plan is one of the table."""
    axes: Sequence[Array] = table.axes
    factors = (plan.density, plan.lift)
    if len(plan.told) != len(axes):
        raise ValueError(f"plan: told: expected {len(axes)} places, one an axis, got {plan.told}")
    if plan.density == plan.lift or not set(factors) <= set(range(len(axes))):
        raise ValueError(
            f"plan: expected the numbers of two axes, 0 to {len(axes) - 1}, of density and lift, got "
            f"{factors}"
        )
    if any(not axes[i][0] > 0.0 for i in factors):
        raise ValueError(f"plan: expected axes of positive factors, got {factors}")
