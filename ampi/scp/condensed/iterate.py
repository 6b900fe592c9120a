"""Iterates that fly: evaluation of a point and its restoration to the collocation equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.missions.path_limits import KEPT
from ampi.physics.state import BANK
from ampi.scp.condensed.condensing import CondensedDynamics, NodeDerivatives, condense
from ampi.scp.condensed.cost import AbsoluteTerms, smooth_cost, terminal_cost
from ampi.scp.condensed.elastic_target import elastic_cost
from ampi.scp.condensed.points import scaled_controls
from ampi.scp.condensed.transcription import RadauTranscription, by_control, radau_transcription
from ampi.scp.guess import NodalGuess, collocated_rate
from ampi.scp.problem.penalty import limit_excess
from ampi.scp.problem.scaled_problem import OptimalControlProblem, Target, by_case
from ampi.scp.problem.steered_angles import SteeredAngle

Array = NDArray[np.float64]

ONE = np.zeros(1, dtype=np.intp)  # the case of a batch of one


@dataclass(frozen=True, kw_only=True)
class RestorationSettings:
    """Newton's iteration on R = 0 at fixed control: chord steps, refactored when they stall."""

    tolerance: float = 1e-9  # scaled state change
    corrections: int = 8  # per factorisation
    factorisations: int = 4
    near: float = (
        1e-3  # a guess that moves less (scaled) when restored is linearised once, not twice
    )


@dataclass(frozen=True)
class Iterate:
    """Scaled states (n, s), û at the collocation points ((n − 1) m,), final time (s)."""

    states: Array
    controls: Array
    final_time: float

    @property
    def batch(self) -> tuple[Array, Array, Array]:
        """x (s, 1, n), û (1, (n − 1) m) and t_f (1,): the batch of one."""
        return self.states.T[:, None], self.controls[None], np.array([self.final_time])


@dataclass(frozen=True, eq=False)
class Point:
    """A flyable iterate with what the merit needs."""

    iterate: Iterate
    path: Array  # g (n, m)
    smooth_cost: float
    absolute: AbsoluteTerms
    target_error: Array  # e of the target's rows
    excess: Array  # (m,), of the limits
    condensed: CondensedDynamics | None = None  # of a guess that is this point but for a trifle

    @property
    def cost(self) -> float:
        """Scaled cost without the target's."""
        return self.smooth_cost + self.absolute.total

    def merit(self, target: Target, price: Array, penalty: float) -> float:
        """Penalty, Eq. (1)."""
        return (
            self.cost
            + elastic_cost(self.target_error, target, price)
            + penalty * float(self.excess.sum())
        )


@dataclass(frozen=True, eq=False)
class Flight:
    """The transcribed dynamics of one problem: linearise, restore, evaluate."""

    problem: OptimalControlProblem
    transcription: RadauTranscription
    restoration: RestorationSettings

    @classmethod
    def of(cls, problem: OptimalControlProblem, restoration: RestorationSettings) -> Flight:
        """Bind a problem to its cached transcription."""
        return cls(problem, radau_transcription(problem.mesh), restoration)

    def linearise(self, iterate: Iterate) -> CondensedDynamics:
        """Derivatives and condensed dynamics at `iterate`.

        Raises
        ------
        FloatingPointError
            If they are not finite.
        """
        t, problem = self.transcription, self.problem
        x, u, final_time = iterate.batch
        function = problem.dynamics.first
        outputs = function.one_by_one(x, self.rates(u), t.times(final_time), problem.numbers)
        with np.errstate(all="ignore"):
            condensed = condense(
                t,
                NodeDerivatives.of(function, outputs),
                final_time,
                rate_scale=tuple(by_case(angle.rate_limit) for angle in problem.angles),
                final_time_scale=problem.scaling.final_time,
                free_angles=tuple(angle.entry is None for angle in problem.angles),
            )
        if not np.all(np.isfinite(condensed.final_map)):  # what is not a number travels to the end
            raise FloatingPointError("condensing: the linearised dynamics are not finite")
        return condensed

    def rates(self, u: Array) -> Array:
        """û at all nodes (m, 1, n) of those at the points (1, (n − 1) m)."""
        m = self.problem.n_controls
        return by_control(self.transcription.nodal_rate(u, m), m)

    def restore(self, iterate: Iterate, condensed: CondensedDynamics | None) -> Point | None:
        """Solve R = 0 for the states at fixed control; None if it does not converge.

        `condensed` are factors from a nearby iterate, or None to factor here.
        """
        for _ in range(self.restoration.factorisations):
            if condensed is None:
                try:
                    condensed = self.linearise(iterate)
                except FloatingPointError:
                    return None
            with np.errstate(all="ignore"):  # what diverges is found by its size
                iterate, functions = self._chord(iterate, condensed)
            if functions is not None:
                return self._point(iterate, functions)
            if not np.all(np.isfinite(iterate.states)):
                return None
            condensed = None
        return None

    def within_bounds(self, iterate: Iterate) -> Iterate:
        """The iterate with its steered angles cut at their bounds, and the rates that fly it so.

        The rows of the subproblem keep the bounds to first order; a step in control and final time
        leaves them by their product. The merit knows nothing of these bounds, so no iterate may lie
        beyond: a small trust region would then hold no step back. Between the nodes a tenth of what
        counts as kept is left to the second order; a profile that overshoots by more is scaled.
        """
        for k, angle in enumerate(self.problem.angles):
            if angle.is_bounded:
                iterate = self._cut(iterate, k, angle)
        return iterate

    def _cut(self, iterate: Iterate, k: int, angle: SteeredAngle) -> Iterate:
        t, m, final_time = self.transcription, self.problem.n_controls, iterate.final_time
        turned = t.half_lengths(final_time) * angle.rate_limit * iterate.controls[k::m]
        start = iterate.states[0, angle.state]
        flown = np.concatenate([[start], start + t.integration @ turned])
        cut = np.clip(flown, angle.lower, angle.upper)
        middle, half = angle.middle, angle.half_width
        overshoot = float(np.abs(t.between @ cut - middle).max()) / half
        if overshoot > 1.0 + 0.1 * KEPT:
            cut = middle + (cut - middle) / overshoot
        if angle.entry is not None:
            cut[0] = start
        if np.array_equal(cut, flown):
            return iterate
        states, controls = iterate.states.copy(), iterate.controls.copy()
        states[:, angle.state] = cut
        rate = collocated_rate(self.problem.mesh, cut, final_time)[1:]
        controls[k::m] = np.clip(rate / angle.rate_limit, -1.0, 1.0)
        return Iterate(states, controls, final_time)

    def _chord(
        self, iterate: Iterate, condensed: CondensedDynamics
    ) -> tuple[Iterate, Array | None]:
        """The last iterate; (g, L) there, as of before its last, negligible change, if it converged."""
        t, problem, evaluate = self.transcription, self.problem, self.problem.dynamics.values
        x, u, final_time = iterate.batch
        x, rate, times, before = x.copy(), self.rates(u), t.times(final_time), np.inf
        converged = None
        for _ in range(self.restoration.corrections):
            rates, functions = evaluate.one_by_one(x, rate, times, problem.numbers)
            change = condensed.correction(t.residual(x, rates, final_time), ONE)
            size = float(np.abs(change).max())
            if not size < 2.0 * before:  # diverging, or not a number
                break
            x[:, :, 1:] += change.transpose(2, 0, 1)
            before = size
            if size < self.restoration.tolerance:
                converged = functions[:, 0]
                break
        return Iterate(x[:, 0].T.copy(), iterate.controls, iterate.final_time), converged

    def evaluate(self, iterate: Iterate) -> Point:
        """Path constraints, cost and target error."""
        t, problem = self.transcription, self.problem
        x, u, final_time = iterate.batch
        _, functions = problem.dynamics.values.one_by_one(
            x, self.rates(u), t.times(final_time), problem.numbers
        )
        return self._point(iterate, functions[:, 0])

    def _point(self, iterate: Iterate, functions: Array) -> Point:
        t, problem = self.transcription, self.problem
        path, integrands = functions[: problem.n_limits].T.copy(), functions[problem.n_limits :]
        _, u, final_time = iterate.batch
        smooth = smooth_cost(problem, t, u, final_time, integrands[:, None])
        terminal = terminal_cost(problem, iterate.states[-1:].T, one_by_one=True)
        if terminal is not None:
            smooth = smooth + terminal.value
        return Point(
            iterate=iterate,
            path=path,
            smooth_cost=float(smooth[0]),
            absolute=AbsoluteTerms.of(problem, t, u[0], iterate.final_time, integrands),
            target_error=problem.target.error(iterate.states[-1]),
            excess=limit_excess(path),
        )

    def first_point(self, guess: NodalGuess) -> Point | None:
        """The guess in scaled units, moved to this problem's entry state and restored to flight.

        Its steered angles are cut at this problem's bounds: no step of a small trust region leads back.
        """
        states = guess.states / np.array(self.problem.scaling.states)
        states[0, :BANK] = self.problem.entry
        for angle in self.problem.angles:
            if angle.entry is not None:
                states[0, angle.state] = angle.entry
        rate = np.clip(scaled_controls(self.problem, [guess])[0], -1.0, 1.0)
        iterate = self.within_bounds(Iterate(states, rate, guess.final_time))
        states = iterate.states
        try:
            condensed = self.linearise(iterate)
        except FloatingPointError:
            return None
        point = self.restore(iterate, condensed)
        if point is None:
            return None
        moved = float(np.abs(point.iterate.states - states).max())
        return replace(point, condensed=condensed if moved < self.restoration.near else None)
