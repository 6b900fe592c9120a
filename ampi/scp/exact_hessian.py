"""Sequential convex programming with a convexified exact Hessian: the iteration.

Every iterate flies: after each convex step the collocation equations are solved again at the new
control, so the merit needs no weight for dynamics defects. A merit with such weights was rejected:
beside the stiff terminal cost it crawls.

    repeat
        linearise and condense     δx = Z z                          (condensing, Eq. (1))
        model                      exact gradient, convex Hessian    (quadratic_model)
        convex step                Clarabel                          (subproblem, Eq. (1))
        restore                    R(x, u, t_f) = 0 at the new control
        second-order correction    the target row shifted by what linearisation missed
        accept, or shrink          actual over predicted reduction   (trust_region)
    until the step is small

The second-order correction (Nocedal & Wright 2006, Section 18.3) is what lets long steps along the
curved set of controls that reach the target pass the merit test.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ampi.scp.condensing import CondensedDynamics, Iterate
from ampi.scp.convergence import ConvergenceSettings, verdict
from ampi.scp.elastic_target import ElasticSettings, huber, is_elastic, reference_price
from ampi.scp.guess import NodalGuess
from ampi.scp.iterate import Flight, Point, RestorationSettings
from ampi.scp.penalty import PenaltySettings
from ampi.scp.problem import N_TARGETS, OptimalControlProblem
from ampi.scp.quadratic_model import (
    CurvatureSettings,
    Multipliers,
    quadratic_subproblem,
    with_merit,
)
from ampi.scp.subproblem import ConvexSubproblem, Step, solve_subproblem
from ampi.scp.trust_region import TrustRegion, TrustRegionSettings
from ampi.trajectory import IterationRecord, Statistics, Status, Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """All numbers that steer the method; none depends on the mission."""

    max_iterations: int = 200
    patience: int = 40  # iterations given to a raised price or penalty before it counts as vain
    trust_region: TrustRegionSettings = field(default_factory=TrustRegionSettings)
    elastic: ElasticSettings = field(default_factory=ElasticSettings)
    penalty: PenaltySettings = field(default_factory=PenaltySettings)
    curvature: CurvatureSettings = field(default_factory=CurvatureSettings)
    restoration: RestorationSettings = field(default_factory=RestorationSettings)
    convergence: ConvergenceSettings = field(default_factory=ConvergenceSettings)


_CONVERGED = (Status.TARGET_MISSED, Status.LIMITS_EXCEEDED)


@dataclass(eq=False)
class _Candidate:
    """A step, the point it leads to and the reduction of the merit it achieves."""

    step: Step
    point: Point | None
    reduction: float


class ExactHessianIteration:
    """One run of the iteration."""

    def __init__(self, problem: OptimalControlProblem, settings: SolverSettings) -> None:
        self.problem, self.settings = problem, settings
        self.flight = Flight.of(problem, settings.restoration)
        self.region = TrustRegion(settings.trust_region, settings.trust_region.initial)
        self.multipliers = Multipliers.zero(problem.mesh.n_nodes)
        self.price = np.zeros(N_TARGETS)
        self.penalty = 0.0
        self.price_growths = self.penalty_growths = 0
        self.settled = 0  # accepted steps since the elastic targets last changed
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
            if model is None:
                if iteration == 1:
                    model = self.first_model(point, guess if warm else None)
                else:
                    model = self.model(point, self.met())
            condensed, quadratic = model
            convex = with_merit(
                quadratic, radius=self.region.radius, price=self.price, penalty=self.penalty
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
                self.accept(Multipliers.of(best.step, convex))
            self.record(iteration, point, best.step, size, ratio, accepted)
            if small and accepted and not self.grow_penalties(point):
                status = verdict(
                    self.settings.convergence,
                    self.problem,
                    point.iterate.states[-1],
                    point.excess,
                    bought_off=bool(self.elastic().any()),
                )
                break
            if not small:
                self.region.update(ratio, size)
            if self.region.collapsed:
                status = Status.STALLED
                break
            if self.fallback is not None and iteration > self.grown_at + self.settings.patience:
                break
        if self.fallback is not None and status not in (Status.SOLVED, *_CONVERGED):
            # no dearer price led anywhere: the flight that had converged before it is the answer
            point = self.fallback
            final = point.iterate.states[-1]
            status = verdict(
                self.settings.convergence, self.problem, final, point.excess, bought_off=True
            )
        return self.result(point, status)

    def elastic(self) -> NDArray[np.bool_]:
        """Targets that the last step bought off."""
        return is_elastic(self.multipliers.target, self.price)

    def accept(self, multipliers: Multipliers) -> None:
        """Keep the multipliers of an accepted step and see whether what is elastic has settled."""
        before, self.multipliers = self.elastic(), multipliers
        self.settled = self.settled + 1 if np.array_equal(before, self.elastic()) else 0

    def met(self) -> NDArray[np.bool_] | None:
        """Targets that hold the step; None while the elastic ones still change."""
        elastic = self.elastic()
        if elastic.any() and self.settled < self.settings.elastic.settled:
            return None
        return ~elastic

    def first_model(
        self, point: Point, neighbour: NodalGuess | None
    ) -> tuple[CondensedDynamics, ConvexSubproblem]:
        """First linearisation; it sets the elastic price and the penalty (elastic_target, Eq. (3))."""
        problem, settings = self.problem, self.settings
        if neighbour is not None:  # a neighbour's terminal errors are its multipliers, λ = 2 w e
            scale = np.array(problem.scaling.states)
            error = problem.target_error(neighbour.states[-1] / scale)
            known = 2.0 * problem.target_weights * error
            self.multipliers = Multipliers(known, self.multipliers.limits, self.multipliers.bank)
        everything = np.ones(N_TARGETS, dtype=bool)
        model = self.model(point, None if neighbour is None else everything)
        effort = problem.reference_effort(point.iterate.final_time)
        condensed, convex = model
        n_u = condensed.n_variables - 2
        half = self.flight.transcription.half_lengths(point.iterate.final_time)
        curvature = 2.0 * problem.effort_weight * half * self.flight.transcription.weights
        price = reference_price(convex.target_map[:, :n_u], curvature, 2.0 * effort)
        self.price = settings.elastic.price * np.maximum(price, np.abs(self.multipliers.target))
        self.penalty = settings.penalty.initial * effort
        return model

    def model(
        self, point: Point, met: NDArray[np.bool_] | None
    ) -> tuple[CondensedDynamics, ConvexSubproblem]:
        """Linearise and condense at `point`, and build the quadratic model."""
        linearised = self.flight.linearise(point.iterate)
        convex = quadratic_subproblem(
            self.flight,
            point,
            linearised,
            self.multipliers,
            met=met,
            settings=self.settings.curvature,
        )
        return linearised.condensed, convex

    def try_step(
        self, point: Point, condensed: CondensedDynamics, convex: ConvexSubproblem
    ) -> tuple[_Candidate, float, float]:
        """Best of the convex step and its second-order correction; step size; reduction ratio."""
        first = self.candidate(point, condensed, convex)
        if not first.step.usable:
            return first, np.inf, -1.0
        z = first.step.z
        size = max(float(np.abs(convex.bank_rows @ z).max()), abs(float(z[-2])))
        predicted = self.merit(point) - (
            point.effort
            + 0.5 * z @ convex.hessian @ z
            + convex.gradient @ z
            + huber(
                point.target_error + convex.target_map @ z,
                self.problem.target_weights,
                self.price,
            )
            + self.penalty * float(first.step.slack.sum())
        )
        best = first
        worth_correcting = first.reduction < 0.9 * predicted
        if first.point is not None and worth_correcting and size > self.settings.convergence.step:
            shifted = first.point.target_error - convex.target_map @ z
            second = self.candidate(point, condensed, convex.with_target_error(shifted))
            if second.step.usable and second.reduction > first.reduction:
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
        step = solve_subproblem(convex)
        self.subproblem_seconds += time.perf_counter() - clock
        if not step.usable:
            return _Candidate(step, None, -np.inf)
        here = point.iterate
        trial = self.flight.restore(
            Iterate(
                here.states + condensed.state_map @ step.z,
                here.bank_rate + step.z[: len(here.bank_rate)],
                here.final_time + step.z[-2] * condensed.final_time_scale,
            ),
            condensed,
        )
        reduction = -np.inf if trial is None else self.merit(point) - self.merit(trial)
        return _Candidate(step, trial, float(reduction))

    def merit(self, point: Point) -> float:
        """Merit at the current price and penalty."""
        return point.merit(self.problem.target_weights, self.price, self.penalty)

    def grow_penalties(self, point: Point) -> bool:
        """At convergence: raise what is still open; False when nothing is, or nothing helps."""
        settings = self.settings
        elastic, exceeded = self.elastic(), bool(point.excess.max() > settings.penalty.tolerance)
        raise_price = bool(elastic.any()) and self.price_growths < settings.elastic.growths
        raise_penalty = exceeded and self.penalty_growths < settings.penalty.growths
        if raise_price:
            self.price = np.where(elastic, settings.elastic.growth * self.price, self.price)
            self.price_growths += 1
        if raise_penalty:
            self.penalty *= settings.penalty.growth
            self.penalty_growths += 1
        if not (raise_price or raise_penalty):
            return False
        if self.fallback is None or point.excess.sum() <= self.fallback.excess.sum():
            self.fallback = point
        self.grown_at = len(self.log)
        self.region.radius = settings.trust_region.initial
        return True

    def record(
        self, iteration: int, point: Point, step: Step, size: float, ratio: float, accepted: bool
    ) -> None:
        """One row of the log."""
        scale = self.problem.cost_scale
        cost = point.effort + float(self.problem.target_weights @ point.target_error**2)
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
            states, rate, final_time = np.full((n, 7), np.nan), np.full(n, np.nan), np.nan
            cost, excess = np.nan, np.full(3, np.nan)
        else:
            states = point.iterate.states * np.array(problem.scaling.states)
            rate = self.flight.transcription.nodal_rate(point.iterate.bank_rate)
            rate = rate * problem.bank_rate_limit
            final_time, excess = point.iterate.final_time, point.excess
            cost = point.effort + float(problem.target_weights @ point.target_error**2)
        return Trajectory(
            mesh=problem.mesh,
            states=states.T.copy(),
            bank_rate=rate,
            final_time=float(final_time),
            cost=float(cost * problem.cost_scale),
            status=status,
            statistics=Statistics(
                iterations=len(self.log),
                solve_seconds=time.perf_counter() - self.began,
                subproblem_seconds=self.subproblem_seconds,
                limit_excess=(float(excess[0]), float(excess[1]), float(excess[2])),
                log=tuple(self.log),
            ),
        )
