"""Where plans lead: flights of the estimated model, to the speed at which they are to end.

The state (h, θ, φ, V, γ, ψ) follows the equations of motion (ampi/onboard/flight_model.py) with the
factors, the wind and the error of the angle of attack that the estimate says at each altitude. The
controls are no states: bank angle σ and change δα of the angle of attack are those of the plan at the
equivalent speed, as far as the vehicle can follow from where they were at the begin of a step,

    σ(t_i + τ) = clip(plan(v), σ_i ± σ̇_max τ),    δα alike.                                    (1)

Runge and Kutta's method of order four goes in steps of 4 s, shorter only to meet the two kinks of a
schedule of the angle of attack over time. All flights and all their plans have one clock, hence the
same steps, and are one array: the state axis first, then the plans of a flight, the flights last.

Between the last two points V and the position are cubics y(w) with the rates of both (Hermite);
bisection finds w with V(w) = V_f, which gives the miss

    e = (R cos φ_f (θ − θ_f), R (φ − φ_f), h − h_f).                                               (2)

Of each path limit the greatest use at the points so far counts, in excess of what the margin leaves,

    x_k = max(0, max_i l_k(t_i) − (1 − margin)).                                                   (3)

A flight that comes to the ground, or takes too long, before it is slow enough does not arrive.

Source: own; the numerical predictor of entry guidance: Lu 2014.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ampi.correction.plan import Plans, equivalent_speed
from ampi.correction.settings import N_MISSED, CorrectorSettings
from ampi.estimation.estimate import Estimate
from ampi.onboard.flight_model import (
    ALTITUDE,
    BANK,
    LATITUDE,
    LONGITUDE,
    SPEED,
    Factors,
    FlightModelData,
)
from ampi.onboard.plausibility import on_turn_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANGE = 7  # row of the change of the angle of attack, behind the bank angle
N_MOVING = 6  # rows that the rates move
N_PLACED = 4  # h, θ, φ, V: of which an end is made
MOST_STEPS = 319
BISECTIONS = 40
JOINT = 1e-6  # s: a kink that is nearer is passed


@dataclass(frozen=True, eq=False)
class Situation:
    """Where n flights are at `time` (s), what is wrong with their model, and where they are to go."""

    time: float
    state: Array  # (8, n): h, θ, φ, V, γ, ψ, σ; change of the angle of attack; SI, rad
    target: Array  # (4, n): h, θ, φ, V
    estimate: Estimate
    bank_angle: Array  # (n,), ± rad
    rates: Array  # (2, n), ± rad/s: of bank angle and change of the angle of attack

    def of(self, flights: NDArray[np.intp]) -> Situation:
        """That of some flights."""
        known = self.estimate
        return Situation(
            self.time,
            self.state[:, flights],
            self.target[:, flights],
            replace(
                known,
                mean=known.mean[:, flights],
                covariance=known.covariance[..., flights],
                altitude=known.altitude[flights],
            ),
            self.bank_angle[flights],
            self.rates[:, flights],
        )


class Predicted(NamedTuple):
    """Ends of k plans for each of n flights."""

    arrives: Mask  # (k, n)
    missed: Array  # (6, k, n): Eq. (2), m, and Eq. (3)
    to_go: Array  # (k, n), s


class _Point(NamedTuple):
    time: float
    state: Array  # (8, k, n)
    rates: Array  # (6, k, n)
    peak: Array  # (3, k, n): greatest use of each limit


@dataclass(frozen=True, eq=False)
class Predictor:
    """The model and how it is flown."""

    model: FlightModelData
    settings: CorrectorSettings

    def speed(self, target: Array, state: Array) -> Array:
        """Equivalent speed (m/s) of states."""
        gravity = self.model.load_factor_gravity
        found: Array = equivalent_speed(gravity, target[0], state[ALTITUDE], state[SPEED])
        return found

    @np.errstate(all="ignore")  # a flight into the ground does not arrive, and is no error
    def predict(self, plans: Plans, where: Situation) -> Predicted:
        """The ends of `plans`, k for each flight."""
        shape = plans.values.shape[1:]
        ends = _Ends(shape, self, where)
        here, flights = self._first(where, shape), np.arange(shape[1])
        flying = np.ones(shape, dtype=bool)
        for _ in range(MOST_STEPS):
            there = self._advance(plans, where, here)
            slow = there.state[SPEED] <= where.target[3]
            over = ~(there.state[SPEED] > where.target[3]) | ~(there.state[ALTITUDE] > 0.0)
            if there.time - where.time >= self.settings.longest:
                over[:] = True
            if (flying & over).any():
                ends.note(flights, flying & slow, here, there)
                flying &= ~over
            kept = np.flatnonzero(flying.any(axis=0))
            if len(kept) == 0:
                break
            if 2 * len(kept) < len(flights):
                plans, where, flights = plans.of(kept), where.of(kept), flights[kept]
                flying = flying[:, kept]
                there = there._replace(
                    state=there.state[..., kept],
                    rates=there.rates[..., kept],
                    peak=there.peak[..., kept],
                )
            here = there
        return ends.predicted()

    def _first(self, where: Situation, shape: tuple[int, ...]) -> _Point:
        state = np.repeat(where.state[:, None], shape[0], axis=1)
        return self._complete(where, where.time, state, np.zeros((3, *shape)))

    def _advance(self, plans: Plans, where: Situation, here: _Point) -> _Point:
        """One Runge–Kutta step under Eq. (1)."""
        h, begin = self._step_from(here.time), here.state
        state, rates, total = np.empty_like(begin), here.rates, here.rates
        for part, weight in ((0.5 * h, 2.0), (0.5 * h, 2.0), (h, 1.0)):
            np.add(begin[:N_MOVING], part * rates, out=state[:N_MOVING])
            self._steer(plans, where, begin, part, state)
            rates = self._rates(where, here.time + part, state)
            total = total + weight * rates
        np.add(begin[:N_MOVING], h / 6.0 * total, out=state[:N_MOVING])
        self._steer(plans, where, begin, h, state)
        return self._complete(where, here.time + h, state, here.peak)

    def _steer(
        self, plans: Plans, where: Situation, begin: Array, passed: float, state: Array
    ) -> None:
        """Eq. (1), into `state`."""
        asked, reach = plans.at(self.speed(where.target, state)), where.rates[:, None] * passed
        own = begin[BANK:]
        np.minimum(np.maximum(asked, own - reach), own + reach, out=state[BANK:])

    def _rates(self, where: Situation, time: float, state: Array) -> Array:
        return self.model.rates(state[:CHANGE], 0.0, time, factors_at(where.estimate, state))[:BANK]

    def _complete(self, where: Situation, time: float, state: Array, peak: Array) -> _Point:
        factors = factors_at(where.estimate, state)
        rates, loads = self.model.rates_and_loads(state[:CHANGE], 0.0, time, factors)
        limits, reached = self.model.limits, np.empty_like(peak)
        most = (limits.dynamic_pressure, limits.heat_flux, limits.load_factor)
        for row, (load, limit) in enumerate(zip(loads, most, strict=True)):
            np.maximum(load / limit, peak[row], out=reached[row])
        return _Point(time, state, rates[:BANK], reached)

    def _step_from(self, time: float) -> float:
        """As long as may be (s), to the next kink of the schedule of the angle of attack."""
        step, schedule = self.settings.step, self.model.angle_of_attack
        kinks = (schedule.start - time, schedule.end - time) if schedule.over_time else ()
        return min([step, *(kink for kink in kinks if kink > JOINT)])


def factors_at(estimate: Estimate, state: Array) -> Factors:
    """What differs from the model at states (8, …): the change of the angle of attack, too."""
    known = estimate.at(state[ALTITUDE])
    return known._replace(angle_of_attack=known.angle_of_attack + state[CHANGE])


class _Ends:
    """The last two points of every flight, and what is made of them."""

    def __init__(self, shape: tuple[int, ...], predictor: Predictor, where: Situation) -> None:
        self._own, self._where = predictor, where
        self._arrives = np.zeros(shape, dtype=bool)
        self._states = np.full((2, N_PLACED, *shape), np.nan)
        self._rates = np.full((2, N_PLACED, *shape), np.nan)
        self._peak, self._times = np.zeros((3, *shape)), np.zeros((2, *shape))

    def note(self, flights: NDArray[np.intp], ended: Mask, here: _Point, there: _Point) -> None:
        """The flights that are slow enough at `there`, and were not `here`."""
        ended = ended & (here.state[SPEED] > self._where.target[3][flights])
        plan, own = np.nonzero(ended)
        at = flights[own]
        self._arrives[plan, at] = True
        self._peak[:, plan, at] = here.peak[:, plan, own]
        for side, point in enumerate((here, there)):
            self._states[side][:, plan, at] = point.state[:N_PLACED, plan, own]
            self._rates[side][:, plan, at] = point.rates[:N_PLACED, plan, own]
            self._times[side][plan, at] = point.time

    def predicted(self) -> Predicted:
        """Eqs. (2) and (3)."""
        target, (before, after) = self._where.target, self._times
        step = after - before
        (at, then), (rate, later) = self._states, step * self._rates
        # y(w) = at + w (rate + w (bend + w twist))
        bend = 3.0 * (then - at) - 2.0 * rate - later
        twist = rate + later - 2.0 * (then - at)
        low, high = np.zeros_like(step), np.ones_like(step)
        for _ in range(BISECTIONS):
            w = 0.5 * (low + high)
            speed = at[SPEED] + w * (rate[SPEED] + w * (bend[SPEED] + w * twist[SPEED]))
            is_fast = speed > target[3]
            low, high = np.where(is_fast, w, low), np.where(is_fast, high, w)
        w = 0.5 * (low + high)
        end = at + w * (rate + w * (bend + w * twist))
        radius, share = self._own.model.equatorial_radius, 1.0 - self._own.settings.margin
        missed = np.empty((N_MISSED, *step.shape))
        missed[0] = radius * np.cos(target[2]) * on_turn_of(end[LONGITUDE] - target[1], 0.0)
        missed[1] = radius * (end[LATITUDE] - target[2])
        missed[2] = end[ALTITUDE] - target[0]
        missed[3:] = np.maximum(self._peak - share, 0.0)
        return Predicted(self._arrives, missed, before + w * step - self._where.time)
