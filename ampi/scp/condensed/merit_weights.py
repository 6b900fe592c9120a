"""Elastic price and limit penalty over one run: set at the start, relieved, restored, grown.

    start     ν from elastic_target, Eq. (3); ρ far above an ordinary mission's multipliers
    relieve   while nothing is bought off, ν_i ≤ max(r |λ_i|, least · ν_i at the start), and ρ likewise
    restore   a row that is bought off at a relieved price gets its first one back, for good; so does ρ
              where the multipliers of a limit reach it
    grow      at convergence: what is still open costs more, a few times

The start must not fail, so it is dear; but along curved constraints a merit with weights far above the
multipliers takes small steps only (Maratos), and a minimum-time problem crawls. Once the target is met
the multipliers are known well enough to say what is dear enough. A row is relieved or restored for
good, so the weights settle after finitely many changes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ampi.scp.condensed.elastic_target import BOUND, ElasticSettings, is_elastic, reference_price
from ampi.scp.problem.penalty import PenaltySettings
from ampi.scp.problem.scaled_problem import Target

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ReliefSettings:
    """When and how far weights come down. Dimensionless."""

    after: int = 4  # accepted steps in which nothing was bought off
    multiple: float = 10.0  # r, of the multipliers
    least: float = 0.03  # of the first weight


@dataclass(eq=False)
class MeritWeights:
    """ν per row of the target, and ρ."""

    target: Target
    elastic: ElasticSettings
    limits: PenaltySettings
    relief: ReliefSettings
    price: Array = field(init=False)
    penalty: float = field(init=False, default=0.0)
    price_growths: int = field(init=False, default=0)
    penalty_growths: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.price = np.zeros(len(self.target))
        self._settled = 0
        self._first, self._least = self.price, self.price
        self._first_penalty = self._least_penalty = 0.0

    def start(
        self, terminal_map: Array, curvature: Array, reference_cost: float, known: Array
    ) -> None:
        """From C over δu (t, n_u), the reference curvature (n_u,) and `known` multipliers (t,)."""
        settings = self.elastic
        share = np.where(self.target.weight > 0.0, settings.price, settings.bounded_price)
        reference = reference_price(terminal_map, curvature, 2.0 * reference_cost)
        self.price = np.maximum(share * reference, settings.price * np.abs(known))
        self.penalty = self.limits.initial * reference_cost
        self._first, self._least = self.price, self.relief.least * self.price
        self._first_penalty = self.penalty
        self._least_penalty = self.relief.least * self.penalty

    def bought_off(self, multiplier: Array) -> NDArray[np.bool_]:
        """Rows of the target whose multiplier (t,) is at its price."""
        return is_elastic(multiplier, self.price)

    def settled(self, multiplier: Array) -> bool:
        """Whether the curvature of the Lagrangian can be trusted (elastic_target)."""
        weighted = bool(np.any(self.target.weight > 0.0))
        still = self._settled >= self.elastic.settled
        return not weighted or still or not self.bought_off(multiplier).any()

    def accept(self, before: Array, multiplier: Array, limits: Array) -> None:
        """After an accepted step: multipliers of the target (t,) before and now, of limits (n, m)."""
        if self._pressed(limits) and self.penalty < self._first_penalty:
            self.penalty = self._least_penalty = self._first_penalty
        elastic = self.bought_off(multiplier)
        same = np.array_equal(self.bought_off(before), elastic)
        self._settled = self._settled + 1 if same else 0
        if elastic.any():
            relieved = elastic & (self.price < self._first)
            self.price = np.where(relieved, self._first, self.price)
            self._least = np.where(relieved, self._first, self._least)
        elif self._settled >= self.relief.after:
            self.relieve(multiplier, limits)

    def relieve(self, multiplier: Array, limits: Array) -> None:
        """Bring ν and ρ down to a multiple of known multipliers, where nothing is bought off."""
        if self.bought_off(multiplier).any() or self._pressed(limits):
            return
        r = self.relief.multiple
        self.price = np.minimum(self.price, np.maximum(r * np.abs(multiplier), self._least))
        used = r * float(limits.sum(axis=0).max())
        self.penalty = min(self.penalty, max(used, self._least_penalty))

    def _pressed(self, limits: Array) -> bool:
        """Whether a limit's multipliers (n, m) are at the penalty: its slack is open."""
        return float(limits.sum(axis=0).max()) > BOUND * self.penalty

    def grow(self, multiplier: Array, excess: Array) -> bool:
        """At convergence: raise what is still open; False when nothing is, or may be raised."""
        elastic = self.bought_off(multiplier)
        exceeded = bool(excess.max() > self.limits.tolerance)
        raise_price = bool(elastic.any()) and self.price_growths < self.elastic.growths
        raise_penalty = exceeded and self.penalty_growths < self.limits.growths
        if raise_price:
            self.price = np.where(elastic, self.elastic.growth * self.price, self.price)
            self._first = self._least = np.maximum(self._first, self.price)
            self.price_growths += 1
        if raise_penalty:
            self.penalty *= self.limits.growth
            self._first_penalty = self._least_penalty = max(self._first_penalty, self.penalty)
            self.penalty_growths += 1
        return raise_price or raise_penalty
