"""Iterates that fly: evaluation of a point and its restoration to the collocation equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.missions.path_limits import KEPT
from ampi.physics.state import BANK
from ampi.scp.condensed.condensing import CondensedDynamics, Iterate, condense
from ampi.scp.condensed.cost import Cost, cost_of
from ampi.scp.condensed.elastic_target import elastic_cost
from ampi.scp.condensed.transcription import RadauTranscription, radau_transcription
from ampi.scp.guess import NodalGuess, collocated_rate
from ampi.scp.problem.penalty import limit_excess
from ampi.scp.problem.scaled_problem import OptimalControlProblem, Target
from ampi.tracing.derivatives import NodeDerivatives, ScaledDynamics, scaled_dynamics

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RestorationSettings:
    """Newton's iteration on R = 0 at fixed control: chord steps, refactored when they stall."""

    tolerance: float = 1e-9  # scaled state change
    corrections: int = 8  # per factorisation
    factorisations: int = 4
    near: float = (
        1e-3  # a guess that moves less (scaled) when restored is linearised once, not twice
    )


@dataclass(frozen=True, eq=False)
class Linearised:
    """Derivatives at a point and the condensed dynamics."""

    derivatives: NodeDerivatives
    condensed: CondensedDynamics


@dataclass(frozen=True, eq=False)
class Point:
    """A flyable iterate with what the merit needs."""

    iterate: Iterate
    path: Array  # g (n, m)
    cost: Cost
    target_error: Array  # e of the target's rows
    excess: Array  # (m,), of the limits
    linearised: Linearised | None = None  # made at a guess that is this point but for a trifle

    def merit(self, target: Target, price: Array, penalty: float) -> float:
        """Penalty, Eq. (1)."""
        return (
            self.cost.total
            + elastic_cost(self.target_error, target, price)
            + penalty * float(self.excess.sum())
        )


@dataclass(frozen=True, eq=False)
class Flight:
    """The transcribed dynamics of one problem: linearise, restore, evaluate."""

    problem: OptimalControlProblem
    transcription: RadauTranscription
    dynamics: ScaledDynamics
    restoration: RestorationSettings

    @classmethod
    def of(cls, problem: OptimalControlProblem, restoration: RestorationSettings) -> Flight:
        """Bind a problem to its cached transcription and traced derivatives."""
        dynamics = scaled_dynamics(
            problem.model,
            problem.functions,
            problem.scaling.states,
            problem.bank_rate_limit,
            problem.mesh.n_nodes,
        )
        return cls(problem, radau_transcription(problem.mesh), dynamics, restoration)

    def linearise(self, iterate: Iterate) -> Linearised:
        """Derivatives and condensed dynamics at `iterate`."""
        t = self.transcription
        derivatives = self.dynamics.first(
            iterate.states, t.nodal_rate(iterate.bank_rate), t.times(iterate.final_time)
        )
        return Linearised(derivatives, condense(self.problem, t, derivatives, iterate.final_time))

    def restore(self, iterate: Iterate, condensed: CondensedDynamics | None) -> Point | None:
        """Solve R = 0 for the states at fixed control; None if it does not converge.

        `condensed` are factors from a nearby iterate, or None to factor here.
        """
        for _ in range(self.restoration.factorisations):
            if condensed is None:
                try:
                    condensed = self.linearise(iterate).condensed
                except FloatingPointError:
                    return None
            iterate, functions = self._chord(iterate, condensed)
            if functions is not None:
                return self._point(iterate, functions)
            if not np.all(np.isfinite(iterate.states)):
                return None
            condensed = None
        return None

    def within_bank_limit(self, iterate: Iterate) -> Iterate:
        """The iterate with its bank angle cut at the limit, and the rates that fly it so.

        The rows of the subproblem keep the limit to first order; a step in control and final time
        leaves it by their product. The merit knows nothing of this limit, so no iterate may lie
        beyond: a small trust region would then hold no step back. Between the nodes a tenth of what
        counts as kept is left to the second order; a profile that overshoots by more is scaled.
        """
        t, problem, final_time = self.transcription, self.problem, iterate.final_time
        turned = t.half_lengths(final_time) * problem.bank_rate_limit * iterate.bank_rate
        start = iterate.states[0, BANK]
        bank = np.concatenate([[start], start + t.integration @ turned])
        cut = np.clip(bank, -problem.bank_limit, problem.bank_limit)
        overshoot = float(np.abs(t.between @ cut).max()) / problem.bank_limit
        if overshoot > 1.0 + 0.1 * KEPT:
            cut /= overshoot
        if np.array_equal(cut, bank):
            return iterate
        states = iterate.states.copy()
        states[:, BANK] = cut
        rate = collocated_rate(problem.mesh, states[:, BANK], final_time)[1:]
        return Iterate(states, np.clip(rate / problem.bank_rate_limit, -1.0, 1.0), final_time)

    def _chord(
        self, iterate: Iterate, condensed: CondensedDynamics
    ) -> tuple[Iterate, Array | None]:
        """The last iterate; (g, L) there, as of before its last, negligible change, if it converged."""
        t, final_time = self.transcription, iterate.final_time
        rate, times = t.nodal_rate(iterate.bank_rate), t.times(final_time)
        x, before = iterate.states, np.inf
        for _ in range(self.restoration.corrections):
            rates, functions = self.dynamics.values(x, rate, times)
            entry_error = np.append(self.problem.entry - x[0, :BANK], 0.0)
            change = condensed.correction(t.residual(x, rates, final_time), entry_error)
            size = float(np.abs(change).max())
            if not size < 2.0 * before:  # diverging, or not a number
                break
            x, before = x + change, size
            if size < self.restoration.tolerance:
                return Iterate(x, iterate.bank_rate, final_time), functions
        return Iterate(x, iterate.bank_rate, final_time), None

    def evaluate(self, iterate: Iterate) -> Point:
        """Path constraints, cost and target error."""
        t = self.transcription
        _, functions = self.dynamics.values(
            iterate.states, t.nodal_rate(iterate.bank_rate), t.times(iterate.final_time)
        )
        return self._point(iterate, functions)

    def _point(self, iterate: Iterate, functions: Array) -> Point:
        t, problem = self.transcription, self.problem
        path = functions[:, : problem.n_limits].copy()
        return Point(
            iterate=iterate,
            path=path,
            cost=cost_of(problem.objective, t, iterate, functions[:, problem.n_limits :]),
            target_error=problem.target.error(iterate.states[-1]),
            excess=limit_excess(path),
        )

    def first_point(self, guess: NodalGuess) -> Point | None:
        """The guess in scaled units, moved to this problem's entry state and restored to flight.

        Its bank angle is cut at this problem's limit: no step of a small trust region leads back there.
        """
        states = guess.states / np.array(self.problem.scaling.states)
        rate = np.clip(guess.bank_rate[1:] / self.problem.bank_rate_limit, -1.0, 1.0)
        iterate = self.within_bank_limit(Iterate(states, rate, guess.final_time))
        states = iterate.states
        try:
            linearised = self.linearise(iterate)
        except FloatingPointError:
            return None
        point = self.restore(iterate, linearised.condensed)
        if point is None:
            return None
        moved = float(np.abs(point.iterate.states - states).max())
        return replace(point, linearised=linearised if moved < self.restoration.near else None)
