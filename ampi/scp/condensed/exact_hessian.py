"""Sequential convex programming with a convexified exact Hessian: the iteration.

Every iterate flies: after each convex step the collocation equations are solved again at the new
control, so the merit needs no weight for dynamics defects. A merit with such weights was rejected:
beside the stiff terminal cost it crawls.

    repeat
        linearise and condense     δx = Z z                          (condensing, Eq. (1))
        model                      exact gradient, convex Hessian    (quadratic_model)
        convex step                Clarabel                          (subproblem, Eq. (1))
        restore                    R(x, u, t_f) = 0 at the new control
        second-order correction    the rows shifted by what linearisation missed
        accept, or shrink          actual over predicted reduction   (trust_region)
    until the step is small

The second-order correction (Nocedal & Wright 2006, Section 18.3) is what lets long steps along the
curved set of controls that reach the target pass the merit test. Where the target is to be met exactly
it is repeated while it pays; where it is soft, one is enough, and more were seen to jump between
branches.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.scp.condensed.active_set import solve_active_set
from ampi.scp.condensed.condensing import CondensedDynamics
from ampi.scp.condensed.convexify import CurvatureFloor
from ampi.scp.condensed.curvature import reference_curvature
from ampi.scp.condensed.elastic_target import elastic_cost, held_targets
from ampi.scp.condensed.iterate import ONE, Flight, Iterate, Point
from ampi.scp.condensed.merit_weights import MeritWeights
from ampi.scp.condensed.quadratic_model import (
    Multipliers,
    quadratic_subproblem,
    with_merit,
)
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.condensed.subproblem import ConvexSubproblem, Step, solve_subproblem
from ampi.scp.condensed.trust_region import TrustRegion
from ampi.scp.guess import NodalGuess
from ampi.scp.problem.convergence import converged_status
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.trajectory import IterationRecord, Statistics, Status, Trajectory

Array = NDArray[np.float64]


_CONVERGED = (Status.TARGET_MISSED, Status.LIMITS_EXCEEDED)


@dataclass(eq=False)
class _Candidate:
    """A step, the point it leads to and the reduction of the merit it achieves."""

    step: Step
    point: Point | None
    reduction: float


class ExactHessianIteration:
    """One run of the iteration."""

    def __init__(
        self,
        problem: OptimalControlProblem,
        settings: SolverSettings,
        subproblem: Callable[[ConvexSubproblem], Step] | None = None,
    ) -> None:
        self.problem, self.settings = problem, settings
        self.solve_subproblem = subproblem or _solve_subproblem
        self.flight = Flight.of(problem, settings.restoration)
        self.region = TrustRegion(settings.trust_region, settings.trust_region.initial)
        self.multipliers: Multipliers
        self.weights = MeritWeights(
            problem.target, settings.elastic, settings.penalty, settings.relief
        )
        self.floor = CurvatureFloor(settings.curvature.floor, settings.curvature.floor)
        self.fallback: Point | None = None  # converged, with something open
        self.grown_at = 0
        self.log: list[IterationRecord] = []
        self.subproblem_seconds = 0.0
        self.began = time.perf_counter()

    def run(self, guess: NodalGuess | None, *, warm: bool) -> Trajectory:
        """Iterate from `guess`; `warm` if it solves a neighbouring problem."""
        point = None if guess is None else self.flight.first_point(guess)
        if guess is None or point is None:
            return self.result(None, Status.GUESS_FAILED)
        status, model = Status.ITERATION_LIMIT, None
        for iteration in range(1, self.settings.max_iterations + 1):
            if self.settings.is_over(self.began):
                status = Status.TIME_LIMIT
                break
            if model is None:
                if iteration == 1:
                    model = self.first_model(point, guess if warm else None)
                else:
                    model = self.model(point, self.met())
            condensed, quadratic = model
            convex = with_merit(
                quadratic,
                radius=self.region.radius,
                price=self.weights.price,
                penalty=self.weights.penalty,
            )
            best, size, ratio = self.try_step(point, condensed, convex)
            if not best.step.usable:
                status = Status.SUBPROBLEM_FAILED
                break
            # a step that the trust region cut short says nothing about convergence
            small = size < min(self.settings.convergence.step, 0.9 * self.region.radius)
            accepted = best.point is not None and (
                small or ratio > self.settings.trust_region.accept
            )
            if accepted and best.point is not None:
                point, model = best.point, None
                multipliers = Multipliers.of(best.step, convex)
                before, self.multipliers = self.multipliers.target, multipliers
                self.weights.accept(before, multipliers.target, multipliers.limits)
            self.record(iteration, point, best.step, size, ratio, accepted)
            if small and accepted and not self.grow_penalties(point):
                status = self.status_of(point, bought_off=bool(self.elastic().any()))
                break
            if not small:
                self.region.update(ratio, size)
                self.floor.update(ratio, accepted=accepted)
            if self.region.collapsed:
                status = Status.STALLED
                break
            if self.fallback is not None and iteration > self.grown_at + self.settings.patience:
                break
        if self.fallback is not None and status not in (Status.SOLVED, *_CONVERGED):
            # no dearer price led anywhere: the flight that had converged before it is the answer
            point = self.fallback
            status = self.status_of(point, bought_off=True)
        return self.result(point, status)

    def status_of(self, point: Point, *, bought_off: bool) -> Status:
        """Of a converged point."""
        settings, final = self.settings.convergence, point.iterate.states[-1]
        return converged_status(settings, self.problem, final, point.excess, bought_off=bought_off)

    def elastic(self) -> NDArray[np.bool_]:
        """Rows of the target that the last step bought off."""
        return self.weights.bought_off(self.multipliers.target)

    def met(self) -> NDArray[np.bool_] | None:
        """Rows of the target that hold the step; None while the elastic ones still change."""
        multiplier = self.multipliers.target
        if not self.weights.settled(multiplier):
            return None
        return held_targets(self.problem.target, multiplier, self.weights.price)

    def first_model(
        self, point: Point, neighbour: NodalGuess | None
    ) -> tuple[CondensedDynamics, ConvexSubproblem]:
        """First linearisation; it sets the elastic price and the penalty (elastic_target, Eq. (3))."""
        problem = self.problem
        self.multipliers = Multipliers.first(problem, point)
        multipliers = None if neighbour is None else _multipliers_of(neighbour, problem)
        known = multipliers is not None
        if multipliers is not None:
            self.multipliers = replace(self.multipliers, target=multipliers)
        final_time = point.iterate.final_time
        curvature = reference_curvature(problem, self.flight.transcription, np.array([final_time]))[
            0
        ]
        everything = np.ones(len(problem.target), dtype=bool)
        condensed, convex = self.model(point, everything if known else None)
        self.weights.start(
            convex.target_map[:, : len(curvature)],
            curvature,
            problem.reference_cost(final_time),
            self.multipliers.target,
        )
        if neighbour is None or known:
            return condensed, convex
        self.estimate_multipliers(convex)
        return self.model(point, self.met())

    def estimate_multipliers(self, convex: ConvexSubproblem) -> None:
        """Near an optimum: those of a short step in the Gauss–Newton model, which is not taken."""
        short = with_merit(
            convex,
            radius=self.settings.trust_region.estimate,
            price=self.weights.price,
            penalty=self.weights.penalty,
        )
        step = self.solve_subproblem(short)
        if step.usable:
            self.multipliers = Multipliers.of(step, short)
            self.weights.relieve(self.multipliers.target, self.multipliers.limits)

    def model(
        self, point: Point, met: NDArray[np.bool_] | None
    ) -> tuple[CondensedDynamics, ConvexSubproblem]:
        """Linearise and condense at `point`, and build the quadratic model."""
        condensed = point.condensed or self.flight.linearise(point.iterate)
        convex = quadratic_subproblem(
            self.flight,
            point,
            condensed,
            self.multipliers,
            met=met,
            settings=replace(self.settings.curvature, floor=self.floor.value),
        )
        return condensed, convex

    def try_step(
        self, point: Point, condensed: CondensedDynamics, convex: ConvexSubproblem
    ) -> tuple[_Candidate, float, float]:
        """Best of the convex step and its second-order correction; step size; reduction ratio."""
        best = first = self.candidate(point, condensed, convex)
        if not first.step.usable:
            return first, np.inf, -1.0
        z = first.step.z
        nodal = convex.angle_rows[: len(convex.rate)] @ z
        size = max(float(np.abs(nodal).max()), abs(float(z[convex.final_time_column])))
        inside = convex.absolute_value + convex.absolute_rows @ z
        error = point.target_error + convex.target_map @ z
        predicted = self.merit(point) - (
            point.smooth_cost
            + 0.5 * z @ convex.hessian @ z
            + convex.gradient @ z
            + convex.absolute_weight @ np.abs(inside)
            + elastic_cost(error, self.problem.target, self.weights.price)
            + self.weights.penalty * float(first.step.slack.sum())
        )
        soft = bool(np.all(self.problem.target.weight > 0.0))
        for _ in range(1 if soft else self.settings.corrections):
            there = best.point
            enough = best.reduction > 0.9 * predicted
            if there is None or enough or size < self.settings.convergence.step:
                break
            moved = best.step.z
            shifted = convex.corrected(moved, there.target_error, there.path, there.absolute.value)
            second = self.candidate(point, condensed, shifted)
            if not (second.step.usable and second.reduction > best.reduction):
                break
            best = second
        # Near a solution both reductions drown in rounding; such a step is a good one.
        noise = 1e-10 * max(1.0, abs(self.merit(point)))
        if best.point is not None and abs(predicted) < noise and abs(best.reduction) < noise:
            return best, size, 1.0
        return best, size, best.reduction / max(float(predicted), noise)

    def candidate(
        self, point: Point, condensed: CondensedDynamics, convex: ConvexSubproblem
    ) -> _Candidate:
        """Solve the subproblem and fly its step."""
        clock = time.perf_counter()
        step = self.solve_subproblem(convex)
        self.subproblem_seconds += time.perf_counter() - clock
        if not step.usable:
            return _Candidate(step, None, -np.inf)
        here = point.iterate
        there = Iterate(
            here.states + condensed.change(step.z[None], ONE)[:, 0].T,
            here.controls + step.z[: len(here.controls)],
            here.final_time + step.z[condensed.time_column] * condensed.final_time_scale,
        )
        trial = self.flight.restore(self.flight.within_bounds(there), condensed)
        reduction = -np.inf if trial is None else self.merit(point) - self.merit(trial)
        return _Candidate(step, trial, float(reduction))

    def merit(self, point: Point) -> float:
        """Merit at the current price and penalty."""
        return point.merit(self.problem.target, self.weights.price, self.weights.penalty)

    def grow_penalties(self, point: Point) -> bool:
        """At convergence: raise what is still open; False when nothing is, or nothing helps."""
        if not self.weights.grow(self.multipliers.target, point.excess):
            return False
        if self.fallback is None or point.excess.sum() <= self.fallback.excess.sum():
            self.fallback = point
        self.grown_at = len(self.log)
        self.region.radius = self.settings.trust_region.initial
        return True

    def record(
        self, iteration: int, point: Point, step: Step, size: float, ratio: float, accepted: bool
    ) -> None:
        """One row of the log."""
        scale = self.problem.objective.cost_scale
        cost = point.cost + self.problem.target.quadratic(point.target_error)
        self.log.append(
            IterationRecord(
                iteration=iteration,
                cost=cost * scale,
                merit=self.merit(point) * scale,
                step=size,
                final_time=point.iterate.final_time,
                trust_radius=self.region.radius,
                ratio=ratio,
                accepted=accepted,
                subproblem=step.status,
            )
        )

    def result(self, point: Point | None, status: Status) -> Trajectory:
        """Back to SI; without a point, all NaN."""
        problem, n = self.problem, self.problem.mesh.n_nodes
        if point is None:
            states, final_time = np.full((n, problem.n_states), np.nan), np.nan
            rates = np.full((problem.n_controls, n), np.nan)
            cost, excess = np.nan, np.full(problem.n_limits, np.nan)
        else:
            states = point.iterate.states * np.array(problem.scaling.states)
            rates = problem.in_si(self.flight.rates(point.iterate.controls[None])[:, 0])
            final_time, excess = point.iterate.final_time, point.excess
            cost = point.cost + problem.target.quadratic(point.target_error)
        known = None
        if point is not None and self.log:
            known = self.multipliers.target / problem.multiplier_scale
        return Trajectory(
            mesh=problem.mesh,
            states=states.T.copy(),
            bank_rate=rates[0],
            angle_of_attack_rate=rates[1] if len(rates) > 1 else None,
            final_time=float(final_time),
            cost=float(cost * problem.objective.cost_scale),
            status=status,
            statistics=Statistics(
                iterations=len(self.log),
                solve_seconds=time.perf_counter() - self.began,
                subproblem_seconds=self.subproblem_seconds,
                limit_excess=tuple(excess.tolist()),
                log=tuple(self.log),
            ),
            target_multipliers=known,
        )


def _solve_subproblem(convex: ConvexSubproblem) -> Step:
    """By the active set where that is enough, else by the interior-point method."""
    return solve_active_set(convex) or solve_subproblem(convex)


def _multipliers_of(neighbour: NodalGuess, problem: OptimalControlProblem) -> Array | None:
    """λ (m,) of a neighbour, scaled: its own, or where all rows are weighted, 2 w e of its end."""
    if neighbour.target_multipliers is not None:
        return neighbour.target_multipliers * problem.multiplier_scale
    if np.all(problem.target.weight > 0.0):
        error = problem.target.error(neighbour.states[-1] / np.array(problem.scaling.states))
        return 2.0 * problem.target.weight * error
    return None
