"""One cycle of estimating, correcting and flying plans, for n flights of one clock.

    state taken, or dead reckoned → estimate → correction, when it is due → what is asked for

ampi/export/c/ampi_corrected.c is the same in C. The first plan is laid on the reference, over the
equivalent speed, when the first correction is due; before that nothing is asked for, and the law tracks
the reference. From then on plans are corrected every few seconds, more often in the last minute, and not
in the last seconds, when no plan can change much. Without navigation the state is carried on by the
estimated model, and no plan is changed.

What is asked for leads what it becomes: with v̇ of the estimated model, from Eq. (1) of plan.py

    v̇ = (V V̇ + g₀ ḣ)/v,   v₊ = v + τ v̇,   σ̇ = (u(v₊) − u(v))/τ + k (u(v) − σ),                (1)

τ the lead of a command over what it becomes, the cycle at whose end it is reached included, k the
stiffness with which the bank angle is brought to the plan; the change of the angle of attack is that at
v₊. What of it is flown is not told; it follows its command behind a first-order lag.

Source: own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ampi.correction.corrector import CorrectionOutcome, Corrector
from ampi.correction.onboard_correction import NO_AXIS, Correction
from ampi.correction.plan import Plans, plans_through
from ampi.correction.prediction import CHANGE, Predictor, Situation, factors_at
from ampi.correction.settings import N_MISSED, N_PLAN
from ampi.correction.state import CorrectionState
from ampi.estimation.estimator import Estimator
from ampi.onboard.flight_model import ALTITUDE, BANK, LONGITUDE, SPEED
from ampi.onboard.flown_references import FlownReferences
from ampi.onboard.plausibility import SANE, on_turn_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAMPLES = 33  # of a reference, to lay a plan on it
LEAST_LAG = 1e-9  # s: a lag that is shorter is none
LONGEST = 10.0  # s, over which a state is carried on at once
NEVER = 1e300  # s: the plan is flown to its end


class Known(NamedTuple):
    """What the cycle of the guidance knows beside navigation."""

    bank: Array  # (n,), rad: of the last command
    change: Array  # (n,), rad: of the angle of attack, of the last command
    bank_angle: Any  # limits, ± rad, rad/s; numbers or (n,)
    bank_rate: Any
    cycle: float  # s, expected


class Asked(NamedTuple):
    """What plans ask for, of n flights."""

    is_asked: Mask  # (n,); otherwise the law does
    rate: Array  # (n,), rad/s: of the bank angle
    angle: Array  # (n,), rad: change of the angle of attack


class CorrectedCycle:
    """What n flights remember from cycle to cycle, and how it changes."""

    def __init__(self, correction: Correction, flown: FlownReferences) -> None:
        self.correction, self._flown, n = correction, flown, len(flown)
        self._settings = correction.corrector
        self._predictor = Predictor(correction.model, correction.corrector)
        self._corrector = Corrector(correction.model, correction.corrector)
        self.target = np.repeat(np.array(correction.target)[:, None], n, axis=1)
        self.estimator = Estimator(correction.model, correction.estimator, n)
        self.reset()

    def reset(self) -> None:
        """Begin other flights to the same targets."""
        n = len(self._flown)
        self.estimator.reset()
        self._time, self._state = np.nan, np.zeros((8, n))
        self.next = np.full(n, self._settings.start)
        self._has_plan = np.zeros(n, dtype=bool)
        self.plans = Plans(np.zeros(n), np.zeros(n), np.zeros((N_PLAN, n)))
        self.missed, self.to_go = np.zeros((N_MISSED, n)), np.zeros(n)
        self.outcome, self.iterations, self.propagations = np.zeros((3, n), dtype=np.int64)
        self.counts = np.zeros((len(CorrectionOutcome), n), dtype=np.int64)

    def begin(self, parameters: Array) -> None:
        """Begin the flights of p (n, d)."""
        self.reset()
        target = np.repeat(np.array(self.correction.target)[:, None], len(parameters), axis=1)
        for row, axis in enumerate(self.correction.target_axes):
            if axis != NO_AXIS:
                told = parameters[:, axis]
                target[row] = np.where(np.abs(told) < SANE, told, target[row])
        self.aim(target)

    def aim(self, targets: Array) -> None:
        """The targets (4, n), corrected for at once; one that is no number changes nothing."""
        known = np.all(np.abs(targets) < SANE, axis=0)
        self.target = np.where(known, targets, self.target)
        self.next[known & self._has_plan] = 0.0

    @property
    def state(self) -> CorrectionState:
        """What is known now."""
        return CorrectionState(
            outcome=self.outcome.copy(),
            counts=self.counts.copy(),
            missed=self.missed.copy(),
            to_go=self.to_go.copy(),
            iterations=self.iterations.copy(),
            propagations=self.propagations.copy(),
            plans=Plans(self.plans.fast.copy(), self.plans.slow.copy(), self.plans.values.copy()),
            estimate=self.estimator.estimate,
            learnt={name: count.copy() for name, count in self.estimator.counts.items()},
        )

    @property
    def change(self) -> Array:
        """Of the angle of attack (n,), rad, as it is flown."""
        return np.asarray(self._state[CHANGE])

    def step(self, time: float, told: Array, sensed: Array, known: Known) -> Asked:
        """One cycle at `time` (s).

        Parameters
        ----------
        told
            States (7, n), the bank angle on its turn; no number where navigation tells none.
        sensed
            Accelerations (3, n).
        known
            The rest.
        """
        passed = time - self._time
        is_state = self._take(time, told, passed, known)
        self._lag(passed, known.change)
        unsure = 0.5 * np.abs(known.change - self.change)
        self.estimator.update(time, told_where(is_state, self._state), sensed, self.change, unsure)
        self._correct(is_state, known)
        return self._ask(known)

    def _take(self, time: float, told: Array, passed: float, known: Known) -> Mask:
        """The states as they are navigated, or dead reckoned. Which are navigated."""
        is_known = abs(time) < SANE
        is_state: Mask = ~np.isnan(told).any(axis=0) & np.array(is_known)
        if not is_state.all() and passed > 0.0:
            carried = self._state.copy()
            carried[:BANK] += min(passed, LONGEST) * self._rates(carried)
            carried[BANK] = known.bank
            self._state = carried
        self._state[:CHANGE] = np.where(is_state, told, self._state[:CHANGE])
        turned = on_turn_of(self._state[LONGITUDE], self.target[1])
        self._state[LONGITUDE] = np.where(is_state, turned, self._state[LONGITUDE])
        self._time = time if is_known else self._time
        return is_state

    def _rates(self, state: Array) -> Array:
        """Of h, θ, φ, V, γ, ψ in the estimated model (6, n)."""
        factors = factors_at(self.estimator.estimate, state)
        return self.correction.model.rates(state[:CHANGE], 0.0, self._time, factors)[:BANK]

    def _lag(self, passed: float, commanded: Array) -> None:
        """The change of the angle of attack follows its command."""
        if passed > 0.0:
            share = 1.0 - np.exp(-passed / max(self._settings.lag, LEAST_LAG))
            self._state[CHANGE] += (commanded - self.change) * share

    def _correct(self, is_state: Mask, known: Known) -> None:
        """The corrections that are due."""
        due = self._time >= self.next
        if not due.any():
            return
        lost, at = due & ~is_state, np.flatnonzero(due & is_state)
        self.outcome[lost] = CorrectionOutcome.NO_STATE
        self.counts[CorrectionOutcome.NO_STATE] += lost
        self.next[lost] = self._time + self._settings.last_period
        if len(at):
            where = self._where(known)
            self._lay_first(where, due & is_state & ~self._has_plan)
            self._correct_at(at, where.of(at))

    def _where(self, known: Known) -> Situation:
        n = len(self._flown)
        return Situation(
            self._time,
            self._state,
            self.target,
            self.estimator.estimate,
            np.broadcast_to(known.bank_angle, n),
            np.stack(np.broadcast_arrays(known.bank_rate, np.full(n, self._settings.change_rate))),
        )

    def _lay_first(self, where: Situation, at: Mask) -> None:
        """The first plans: the bank angles of the references."""
        if not at.any():
            return
        flown, begin = self._flown, self._time
        rows = [
            flown.table.segments.at(
                flown.final_time,
                flown.nodal,
                begin + i / (SAMPLES - 1.0) * (flown.final_time - begin),
            )
            for i in range(SAMPLES)
        ]
        speed = np.array([self._predictor.speed(self.target, row) for row in rows])
        bank = np.array([row[BANK] for row in rows])
        fast = self._predictor.speed(self.target, self._state)
        laid = plans_through(speed, bank, fast, self.target[3], where.bank_angle)
        self._set_plans(np.flatnonzero(at), laid.of(np.flatnonzero(at)))
        self._has_plan |= at

    def _set_plans(self, at: NDArray[np.intp], plans: Plans) -> None:
        self.plans.fast[at], self.plans.slow[at] = plans.fast, plans.slow
        self.plans.values[:, at] = plans.values

    def _correct_at(self, at: NDArray[np.intp], where: Situation) -> None:
        """The plans of some flights, and when they are corrected next."""
        own, time = self._settings, self._time
        found = self._corrector.correct(self.plans.of(at), where)
        self._set_plans(at, found.plans)
        arrives = found.outcome != CorrectionOutcome.NO_ARRIVAL
        self.missed[:, at] = np.where(arrives, found.missed, self.missed[:, at])
        self.to_go[at] = to_go = np.where(arrives, found.to_go, self.to_go[at])
        self.outcome[at] = found.outcome
        self.iterations[at], self.propagations[at] = found.iterations, found.propagations
        np.add.at(self.counts, (found.outcome, at), 1)
        period = np.where(to_go <= own.last_minute, own.last_period, own.period)
        is_last = arrives & (to_go - period < own.quiet)
        self.next[at] = np.where(is_last, NEVER, time + period)

    def _ask(self, known: Known) -> Asked:
        """Eq. (1)."""
        own, state = self._settings, self._state
        lead = own.lead + known.cycle
        if not self._has_plan.any():
            return Asked(self._has_plan, known.change, known.change)
        rates = self._rates(state)
        gravity = self.correction.model.load_factor_gravity
        speed = self._predictor.speed(self.target, state)
        falls = state[SPEED] * rates[SPEED] + gravity * rates[ALTITUDE]
        ahead = speed + lead * (falls / np.maximum(speed, 1.0))
        (bank, _), (then, change) = self.plans.at(speed), self.plans.at(ahead)
        rate = (then - bank) / lead + own.stiffness * (bank - state[BANK])
        is_asked = self._has_plan & (np.abs(rate) < SANE) & (np.abs(change) < SANE)
        return Asked(is_asked, rate, change)


def told_where(is_told: Mask, state: Array) -> Array:
    """States (7, n) where they are told; no number elsewhere, from which nothing is learnt."""
    return np.where(is_told, state[:CHANGE], np.nan)
