"""Plans that are corrected until they are predicted to end on the target, or as near as may be.

A plan p has a miss and excesses of the path limits e(p) (prediction.py). It is changed so as to lessen

    f(p) = ½ ‖W e(p)‖² + ½ pᵀ P p,                                                              (1)

P the square sum of the second differences of the bank angles, and of the changes of the angle of attack:
where the target leaves a choice, the plan is smooth, and near the schedule. With the Jacobian J by
one-sided differences, towards the inside of the bounds, Levenberg's and Marquardt's method has the step

    (Jᵀ W² J + P + λ D) d = −(Jᵀ W² e + P p),   −B ≤ p + d ≤ B,                                  (2)

D of second differences and sizes. λ begins at 1, falls tenfold with a step that lessens f as it is
predicted in truth, which alone is taken, and rises tenfold with one that does not. So no plan is
replaced but by a better one; only where it is not predicted to arrive at all, wings level takes its
place, if that arrives. The end is on the target, at a step that gains less than 2 %, after so many
steps, or so many predictions.

In numpy a prediction of one plan takes as long as of twenty: each trial is flown together with all
its neighbours, whose differences are the next Jacobian if it is taken. What is counted are the
predictions that a computer without vectors would have made, those of ampi_corrector.c. Flights go on by
themselves: one may be at its third step while another tries its first with a greater λ.

Source: own; predictor-corrector entry guidance: Lu 2014; the method: Levenberg 1944, Marquardt 1963.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ampi.correction.bounded_step import bounded_step
from ampi.correction.plan import CHANGES, Plans
from ampi.correction.prediction import Predictor, Situation
from ampi.correction.settings import N_BANKS, N_PLAN, CorrectorSettings
from ampi.onboard.flight_model import FlightModelData
from ampi.outcome import Outcome

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
Mask = NDArray[np.bool_]

REJECTIONS = 6  # of one step, at the most
GAIN = 0.98  # of the cost: a step that leaves more of it is the last
STENCIL = np.array([1.0, -2.0, 1.0])  # of a second difference
DIFFERENCES = np.repeat([0.01, 0.003], [N_BANKS, N_PLAN - N_BANKS])[:, None]  # rad


class CorrectionOutcome(Outcome):
    """What has become of a correction."""

    NO_CORRECTION = 0, "No correction has been due."
    PLAN_KEPT = 1, "The plan that is flown is predicted to end on the target."
    PLAN_REPLACED = 2, "The plan has been replaced by one that is predicted to end on the target."
    PLAN_BETTERED = (
        3,
        "The plan has been replaced by a better one, which is not yet on the target: the budget has "
        "ended.",
    )
    OUT_OF_REACH = 4, "The plan leads to the nearest point to the target that is found in reach."
    NO_BETTER = 5, "Rejected: no plan is predicted to be better than the one that is flown."
    NO_ARRIVAL = 6, "Rejected: no plan is predicted to arrive at the target's speed."
    NO_STATE = 7, "Not tried: navigation told no plausible state."


class Corrected(NamedTuple):
    """What has become of n plans."""

    plans: Plans
    outcome: Counts  # (n,), CorrectionOutcome
    missed: Array  # (6, n), as predicted; no number without arrival
    to_go: Array  # (n,), s
    iterations: Counts  # (n,)
    propagations: Counts  # (n,): predictions


class _Outlook(NamedTuple):
    """Where a plan of each of n flights leads, and its neighbours."""

    arrives: Mask  # (n,)
    missed: Array  # (6, n)
    jacobian: Array  # (6, 18, n)
    to_go: Array  # (n,)

    def of(self, flights: NDArray[np.intp]) -> _Outlook:
        """That of some flights."""
        return _Outlook(
            self.arrives[flights],
            self.missed[:, flights],
            self.jacobian[..., flights],
            self.to_go[flights],
        )

    def take(self, flights: NDArray[np.intp], other: _Outlook, which: Mask) -> None:
        """That of these flights is `other`'s of those."""
        for whole, part in zip(self, other, strict=True):
            whole[..., flights] = part[..., which]


@dataclass(frozen=True, eq=False)
class Corrector:
    """The model, and the numbers that steer."""

    model: FlightModelData
    settings: CorrectorSettings

    @cached_property
    def _predictor(self) -> Predictor:
        return Predictor(self.model, self.settings)

    @cached_property
    def weight(self) -> Array:
        """W² (6, 1)."""
        own = self.settings
        single = [own.position_weight] * 2 + [own.altitude_weight] + [own.limit_weight] * 3
        return np.square(single)[:, None]

    @property
    def n_varied(self) -> int:
        """Values of a plan that may change: without a change of the angle of attack the bank angles."""
        return N_PLAN if self.settings.change > 0.0 else N_BANKS

    def bound(self, where: Situation) -> Array:
        """B (18, n)."""
        bound = np.empty((N_PLAN, len(where.bank_angle)))
        bound[:], bound[CHANGES] = where.bank_angle, self.settings.change
        return bound

    def cost(self, missed: Array, values: Array) -> Array:
        """Eq. (1), (n,), of misses (6, n) and plans (18, n)."""
        own, bends = self.settings, second_differences(values)
        of_plan = own.plan_roughness * np.square(bends).sum(axis=0)
        of_plan += own.plan_change * np.square(values[CHANGES]).sum(axis=0)
        return np.asarray(0.5 * ((self.weight * np.square(missed)).sum(axis=0) + of_plan))

    def is_there(self, missed: Array) -> Mask:
        """Whether nothing is left to correct."""
        near = np.square(missed[:3]).sum(axis=0) <= self.settings.tolerance**2
        return np.asarray(near & (missed[3:].sum(axis=0) <= 0.0))

    def outlook(self, plans: Plans, where: Situation) -> _Outlook:
        """Where plans lead, and the Jacobian there."""
        values, varied = plans.values, self.n_varied
        steps = np.where(values > 0.0, -DIFFERENCES, DIFFERENCES)
        beside = np.repeat(values[:, None], 1 + varied, axis=1)
        diagonal = np.arange(varied)
        beside[diagonal, 1 + diagonal] += steps[:varied]
        found = self._predictor.predict(plans.with_values(beside), where)
        missed, moved = found.missed[:, 0], found.missed[:, 1:]
        jacobian = np.zeros((len(missed), *values.shape))
        slopes = (moved - missed[:, None]) / steps[:varied]
        jacobian[:, :varied] = np.where(found.arrives[1:], slopes, 0.0)
        return _Outlook(found.arrives[0], missed, jacobian, found.to_go[0])

    def equations(self, values: Array, seen: _Outlook, damping: Array) -> tuple[Array, Array]:
        """Matrix (18, 18, n) and right side (18, n) of Eq. (2), summed in the order of the C."""
        own, n = self.settings, len(damping)
        matrix, right = np.zeros((N_PLAN, N_PLAN, n)), np.zeros((N_PLAN, n))
        for slopes, missed, weight in zip(seen.jacobian, seen.missed, self.weight, strict=True):
            weighted = weight * slopes
            right -= weighted * missed
            matrix += weighted[:, None] * slopes
        bends = own.plan_roughness * second_differences(values)
        stiffness = own.plan_roughness + damping * own.roughness
        for i, bend in enumerate(bends):
            right[i : i + 3] -= STENCIL[:, None] * bend
            matrix[i : i + 3, i : i + 3] += np.multiply.outer(np.outer(STENCIL, STENCIL), stiffness)
        right[CHANGES] -= own.plan_change * values[CHANGES]
        sizes = np.einsum("iin->in", matrix)
        sizes[:N_BANKS] += damping * own.size
        sizes[CHANGES] += own.plan_change + damping * own.change_size
        return matrix, right

    def step(self, plans: Plans, seen: _Outlook, damping: Array, where: Situation) -> Array:
        """d of Eq. (2) (18, n), no bank angle by more than the longest step; `damping` is λ (n,)."""
        matrix, right = self.equations(plans.values, seen, damping)
        step = bounded_step(matrix, right, plans.values, self.bound(where))
        size = np.abs(step[:N_BANKS]).max(axis=0)
        longest = self.settings.longest_step
        return np.where(size > longest, step * (longest / size), step)

    def correct(self, plans: Plans, where: Situation) -> Corrected:
        """Correct the plans (18, n) that are flown, from where the flights are."""
        fast = self._predictor.speed(where.target, where.state)
        work = _Work(self, plans.laid(fast, where.target[3]), where)
        while work.go_on():
            work.try_steps()
        return work.corrected()


def second_differences(values: Array) -> Array:
    """Of the bank angles of plans (18, n): (11, n)."""
    return np.asarray(values[: N_BANKS - 2] - 2.0 * values[1 : N_BANKS - 1] + values[2:N_BANKS])


class _Work:
    """The corrections of n flights under way."""

    def __init__(self, own: Corrector, plans: Plans, where: Situation) -> None:
        self._own, self._plans, self._where = own, plans, where
        self._seen = seen = own.outlook(plans, where)
        n = len(seen.arrives)
        self._damping, self._changed = np.ones(n), np.zeros(n, dtype=bool)
        self._tries, self._iterations = np.zeros((2, n), dtype=np.int64)
        self._propagations = np.ones(n, dtype=np.int64)
        if not seen.arrives.all():
            self._level(np.flatnonzero(~seen.arrives))
        self._cost = np.where(seen.arrives, own.cost(seen.missed, plans.values), np.inf)
        self._goes_on = seen.arrives & ~own.is_there(seen.missed)
        self._propagations[self._goes_on] += own.n_varied  # of the Jacobian

    def _level(self, at: NDArray[np.intp]) -> None:
        """Wings level, on the schedule, where the plan does not arrive: that goes the farthest."""
        plans = self._plans.of(at)
        seen = self._own.outlook(plans.with_values(np.zeros_like(plans.values)), self._where.of(at))
        self._propagations[at] += 1
        taken = at[seen.arrives]
        self._plans.values[:, taken], self._changed[taken] = 0.0, True
        self._seen.take(taken, seen, seen.arrives)

    def go_on(self) -> bool:
        """Whether any flight does; it ends where its budget is spent."""
        budget = int(self._own.settings.propagations)
        spent = self._goes_on & ((self._propagations >= budget) | (self._tries >= REJECTIONS))
        self._iterations += spent
        self._goes_on &= ~spent
        return bool(self._goes_on.any())

    def try_steps(self) -> None:
        """One step of each flight that goes on."""
        at, own = np.flatnonzero(self._goes_on), self._own
        plans, where = self._plans.of(at), self._where.of(at)
        bound = own.bound(where)
        values = plans.values + own.step(plans, self._seen.of(at), self._damping[at], where)
        trial = plans.with_values(np.minimum(np.maximum(values, -bound), bound))
        seen = own.outlook(trial, where)
        cost = np.where(seen.arrives, own.cost(seen.missed, trial.values), np.inf)
        better = cost < self._cost[at]
        self._propagations[at] += 1
        self._damping[at] *= np.where(better, 0.1, 10.0)
        self._tries[at] = np.where(better, 0, self._tries[at] + 1)
        taken = at[better]
        self._plans.values[:, taken] = trial.values[:, better]
        self._seen.take(taken, seen, better)
        self._took(taken, cost[better])

    def _took(self, taken: NDArray[np.intp], cost: Array) -> None:
        """These flights have a better plan."""
        own, little = self._own, cost > GAIN * self._cost[taken]
        self._cost[taken], self._changed[taken] = cost, True
        self._iterations[taken] += 1
        ends = little | (self._iterations[taken] >= own.settings.iterations)
        ends |= own.is_there(self._seen.missed[:, taken])
        self._goes_on[taken[ends]] = False
        self._propagations[taken[~ends]] += own.n_varied  # of the next Jacobian

    def corrected(self) -> Corrected:
        """What has become of all."""
        own, seen, outcomes = self._own, self._seen, CorrectionOutcome
        there, far = own.is_there(seen.missed), np.hypot(*seen.missed[:2]) > own.settings.reach
        cases = [~seen.arrives, there & self._changed, there, far, ~self._changed]
        told = [
            outcomes.NO_ARRIVAL,
            outcomes.PLAN_REPLACED,
            outcomes.PLAN_KEPT,
            outcomes.OUT_OF_REACH,
            outcomes.NO_BETTER,
        ]
        outcome = np.select(cases, [int(one) for one in told], int(outcomes.PLAN_BETTERED))
        return Corrected(
            self._plans, outcome, seen.missed, seen.to_go, self._iterations, self._propagations
        )
