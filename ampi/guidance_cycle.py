"""One cycle of the flight software in numpy, for n flights of one clock.

clock → look-up → plausibility → law → limiters. ampi/export/c/ampi_step.c is the same in C. Where a plan
is corrected in flight (ampi/correction), what it asks for takes the place of what the law does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.correction.corrected_cycle import Asked, CorrectedCycle, Known
from ampi.correction.onboard_correction import Correction
from ampi.onboard.clock import CycleClock
from ampi.onboard.command import Command
from ampi.onboard.flown_references import FlownReferences
from ampi.onboard.health import Health, Steering
from ampi.onboard.plausibility import BANK, SANE, on_turn_of
from ampi.onboard.row_layout import N_STATES
from ampi.tracking.angle_limiter import ANY_ANGLE, AngleRange, ModulationLimits, modulation_rate
from ampi.tracking.bank_limiter import NEAR_INVERTED, BankLimits, bank_on_turn, limited_rate
from ampi.tracking.law import Told, TrackingLaw

Array = NDArray[np.float64]

FASTEST = 2.0  # times the rate limit; a vehicle that is said to roll faster is told in another unit


class GuidanceCycle:
    """What n flights remember from command to command, and how a command is made."""

    def __init__(
        self,
        flown: FlownReferences,
        law: TrackingLaw,
        stated_cycle: float | None,
        correction: Correction | None = None,
        *,
        modulation: ModulationLimits | None = None,
        angles: AngleRange = ANY_ANGLE,
    ) -> None:
        self._flown, self._law, self._table = flown, law, flown.table
        self._clock = CycleClock(stated_cycle)
        self.tracked = np.full((len(self._table.layout), len(flown)), np.nan)
        self._limits: BankLimits | None = None  # nothing is flown yet
        self._modulation = modulation  # None: the angle of attack stays as it is
        self._angles = angles  # of a vehicle that steers its own
        # what corrects the plans, if anything does
        self.corrected = None if correction is None else CorrectedCycle(correction, flown)
        self._forget()

    def follow(self, parameters: Array, limits: BankLimits) -> None:
        """The references that are flown have changed; of vehicles with these limits."""
        self._flown.look_up_by(self._law.along)
        self._limits = limits

    def begin(self, parameters: Array) -> None:
        """The flights of p (n, d) begin, on the references that are flown."""
        self.reset()
        if self.corrected is not None:
            self.corrected.begin(parameters)

    def aim(self, targets: Array) -> None:
        """The targets (4, n) of the correctors from now on."""
        if self.corrected is not None:
            self.corrected.aim(targets)

    def expect_begin(self) -> None:
        """The next time begins a flight if it does not go on."""
        self._clock.expect_begin()

    def reset(self) -> None:
        """Begin a new flight: the next command is the first, whatever its time."""
        self._clock.reset()
        self._forget()
        if self.corrected is not None:
            self.corrected.reset()

    def _forget(self) -> None:
        """Nothing has been commanded yet."""
        n = len(self._flown)
        self._rate, self._bank, self._angle = np.full((3, n), np.nan)
        self._change, self._change_rate = np.zeros((2, n))  # of the angle of attack
        self._memory = self._law.memory(n)

    def step(self, time: float, navigated: Array, felt: Array) -> Command:
        """Commands at a time (s), of navigation (8, n) and accelerations (3, n); both may be written."""
        with np.errstate(all="ignore"):  # of nonsense the health tells
            asked = self._asked(time, navigated, felt)
            in_time = self._clock.advance(time)
            if self._clock.is_first:
                self._forget()
            if self._limits is None:
                return not_begun(len(self._flown))
            told = Told(navigated[:N_STATES], felt, self._clock.expected, self._change)
            own = self._limits
            return self._steered(told, navigated[N_STATES], own, in_time=in_time, plan=asked)

    def _asked(self, time: float, navigated: Array, felt: Array) -> Asked | None:
        """What the plans ask for, as seen from the last command."""
        if self.corrected is None or self._limits is None:
            return None
        state, limits = navigated[:N_STATES].copy(), self._limits
        plausible = self._table.envelope.holds(state)
        bank = self._bank_angle(state[BANK], self.tracked[BANK], limits)
        state[BANK] = np.where(np.isnan(bank), on_turn_of(state[BANK], 0.0), bank)
        state[:, ~plausible] = np.nan
        known = Known(self._bank, self._change, limits.angle, limits.rate, self._clock.expected)
        return self.corrected.step(time, state, felt, known)

    def _steered(
        self, told: Told, rate: Array, limits: BankLimits, *, in_time: bool, plan: Asked | None
    ) -> Command:
        """The command, once time and shapes are known."""
        at, ended, lost = self._look_up(told)
        if plan is not None:  # it has an end of its own
            ended, lost = ended & ~plan.is_asked, lost & ~plan.is_asked
        layout = self._table.layout
        own, state = at[layout.bank_rate], told.state
        self.tracked = at
        plausible = self._table.envelope.holds(state)
        rolls = np.abs(rate) <= FASTEST * limits.rate
        health = self._flown.health.copy()
        bank = self._bank_angle(state[BANK].copy(), at[BANK], limits)
        if not (plausible.all() and rolls.all()):
            known = (np.abs(state) < SANE).all(axis=0) & (np.abs(rate) < SANE)
            fault = np.where(known, Health.IMPLAUSIBLE_NAVIGATION, Health.BAD_NAVIGATION)
            health = np.where(plausible & rolls, health, fault)
            rate = np.where(rolls, rate, np.where(np.isnan(self._rate), own, self._rate))
            state[:] = np.where(plausible, state, at[layout.states])  # for the law's memory
        state[BANK] = bank
        asked, change = self._law.command(at, told, self._memory)
        wanted, steering, held = asked, np.full(len(asked), int(Steering.TRACKED)), ended | lost
        if not plausible.all():
            wanted = np.where(plausible, asked, own)
            steering = np.where(plausible, steering, Steering.REFERENCE)
            change = np.where(plausible, change, self._change)
        if not in_time:
            health = np.full(len(health), int(Health.BAD_TIME))
        if held.any():
            wanted = np.where(held, 0.0, wanted)
            health = np.where(ended, Health.AFTER_FINAL_TIME, health)
            steering = np.where(held, Steering.HELD, steering)
        if plan is not None:
            wanted = np.where(plan.is_asked, plan.rate, wanted)
            change = np.where(plan.is_asked, plan.angle, change)
            steering = np.where(plan.is_asked, Steering.PLANNED, steering)
        clock = self._clock
        # The limits are of commands: from the measured rate, behind a lag of half a second at 10 Hz,
        # they would leave a fifth of the acceleration, and the bank angle would overshoot by 19°.
        last = np.where(np.isnan(self._rate), rate, self._rate)
        new = limited_rate(limits, bank, last, wanted, clock.longest, clock.shortest)
        self._rate, self._bank = new, bank + 0.5 * (rate + new) * clock.expected
        angle = self._modulated(change)
        if layout.angle_of_attack is not None:
            wanted = at[layout.angle_of_attack] + angle
            self._angle = angle = self._angles.followed(wanted, self._angle, clock.expected)
        return Command(new, self._bank, angle, steering, health)

    def _modulated(self, wanted: Array) -> Array:
        """The change of the angle of attack (n,), rad, at the end of the cycle."""
        limits, clock, last = self._modulation, self._clock, self._change_rate
        if limits is not None:
            wanted = np.where(np.abs(wanted) < SANE, wanted, self._change)
            rate = modulation_rate(
                limits, self._change, last, wanted, clock.longest, clock.shortest
            )
            self._change = self._change + 0.5 * (last + rate) * clock.expected
            self._change_rate = rate
        return self._change

    def _look_up(self, told: Told) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
        """Rows of the references (r, n) at this instant; which have ended; of which it is unknown."""
        end = self._flown.end
        value = self._law.now(self._clock.now, told)
        value = value + np.zeros(len(end))
        ended, lost = value >= end, np.isnan(value)
        if lost.any():
            value = np.where(lost, end, value)
        return self._flown.at(value), ended, lost

    def _bank_angle(self, told: Array, reference: Array, limits: BankLimits) -> Array:
        """The bank angles (n,) on their turn; one that is lost is that of the last command."""
        known = np.abs(told) <= self._table.envelope.reach[BANK]
        if not known.all():
            told = np.where(known, told, np.where(np.isnan(self._bank), reference, self._bank))
        # otherwise all are on their turn, where it changes no bit
        if np.abs(told).max() > np.pi or np.max(limits.angle) > NEAR_INVERTED:
            told = bank_on_turn(limits, told, reference)
        return told


def not_begun(n: int) -> Command:
    """Before any flight has been begun."""
    held, health = np.full(n, int(Steering.HELD)), np.full(n, int(Health.NOT_BEGUN))
    return Command(np.zeros(n), np.zeros(n), np.zeros(n), held, health)
