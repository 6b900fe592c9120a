"""Newton's iteration for many neighbouring problems at once.

Beside a solved neighbour most cases of a database need nothing of what makes `exact_hessian` robust: no
limit is active, nothing is bought off, full steps converge. What is left of an iteration is Newton's
method on the condensed problem, the same for every case, and here it runs for all of them together:

    repeat
        δx = Z z + c                                       linearised dynamics; c from R (condensing)
        H = Zᵀ ∇²L Z                                        (condensing, Eq. (4))
        [ H   Cᵀ          ] [z]     [ g + Zᵀ ∇²L c ]
        [ C  −diag(1/2w)  ] [λ] = − [ e + c_f      ]       (1); 1/2w is 0 where a target is met exactly
    until the step is small, then restore R = 0

An iterate need not fly before the end: with the term in c this is Newton's method on states, control and
multipliers together. (Restoring the guess first and dropping c was tried: the first step is then none
of Newton's, and a third of the cases take an iteration more.) Matrices and tolerances are those of
`exact_hessian`. A case that steps beyond a limit, whose Hessian is not positive definite under the
target, or that does not contract is left to it. Nothing of a case depends on its company, not even its
last bit: a database may be solved in any portions.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

from ampi.scp.condensing import Iterate
from ampi.scp.convergence import verdict
from ampi.scp.convexify import STIFF
from ampi.scp.cost import Cost, cost_of
from ampi.scp.exact_hessian import SolverSettings
from ampi.scp.family_condensing import (
    CondensedFamily,
    Entries,
    condense_family,
    family_dynamics,
)
from ampi.scp.guess import NodalGuess
from ampi.scp.penalty import limit_excess
from ampi.scp.problem import BANK, N_STATES, OptimalControlProblem
from ampi.scp.transcription import RadauTranscription, radau_transcription
from ampi.trajectory import IterationRecord, Statistics, Status, Trajectory

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Cases = NDArray[np.intp]

LARGEST_STEP = 0.3  # rad: what is farther away is no neighbour
CONTRACTION = 0.5  # of the step from one iteration to the next, at least
MOST_ITERATIONS = 6


def suits(problem: OptimalControlProblem) -> bool:
    """Whether the iteration knows the whole problem: effort and flight time, targets without range."""
    objective, target = problem.objective, problem.target
    ranged = (target.weight == 0.0) & (target.lower < target.upper)
    smooth = objective.variation == 0.0 and objective.descent == 0.0
    return smooth and problem.functions.n_smooth == 0 and not bool(ranged.any())


def kind(problem: OptimalControlProblem) -> Hashable:
    """What problems of one call of `newton` have in common: all but entry state and target."""
    target = problem.target
    rows = (target.state, target.weight, target.lower, target.upper)
    return (
        *(problem.model, problem.functions, problem.mesh, problem.objective, problem.scaling),
        *(problem.bank_limit, problem.bank_rate_limit),
        *(tuple(row.tolist()) for row in rows),
    )


def newton(
    problems: Sequence[OptimalControlProblem],
    guesses: Sequence[NodalGuess],
    settings: SolverSettings | None = None,
) -> Iterator[tuple[int, Trajectory]]:
    """Solve problems that differ in entry state and target alone, each from nearby.

    Parameters
    ----------
    problems
        At least one; all of one `kind`.
    guesses
        On that mesh, with multipliers of the target.
    settings
        Of `exact_hessian`: its tolerances hold here.

    Yields
    ------
    int, Trajectory
        Place and solution of each case that converges, as soon as it has; the others are to be left to
        `exact_hessian`.
    """
    if suits(problems[0]):
        began = time.perf_counter()
        yield from _Newton.begin(problems, guesses, settings).run(began)


@dataclass(eq=False)
class _Newton:
    """The cases under way."""

    settings: SolverSettings
    problems: list[OptimalControlProblem]
    numbers: NDArray[np.intp]  # their places in the family
    x: Array  # (7, c, n)
    u: Array  # û at the collocation points, (c, n − 1)
    final_time: Array  # (c,)
    multipliers: Array  # λ, (c, m)
    path: Array  # g, (limits, c, n)
    logs: list[list[IterationRecord]]

    @classmethod
    def begin(
        cls,
        problems: Sequence[OptimalControlProblem],
        guesses: Sequence[NodalGuess],
        settings: SolverSettings | None,
    ) -> _Newton:
        """All cases at their guesses, moved to their entry states."""
        p = problems[0]
        scale = np.array(p.scaling.states)
        x = np.stack([g.states.T for g in guesses], axis=1) / scale[:, None, None]
        x[:BANK, :, 0] = np.stack([q.entry for q in problems], axis=1)
        rate = np.stack([g.bank_rate[1:] for g in guesses]) / p.bank_rate_limit
        known = [np.asarray(g.target_multipliers) for g in guesses]
        return cls(
            settings=settings or SolverSettings(),
            problems=list(problems),
            numbers=np.arange(len(problems)),
            x=x,
            u=np.clip(rate, -1.0, 1.0),
            final_time=np.array([g.final_time for g in guesses]),
            multipliers=np.stack(known) * p.multiplier_scale,
            path=np.zeros((p.n_limits, len(problems), p.mesh.n_nodes)),
            logs=[[] for _ in problems],
        )

    def run(self, began: float) -> Iterator[tuple[int, Trajectory]]:
        """(number, solution) of every case that converges."""
        everyone, size = len(self.problems), np.full(len(self.problems), np.inf)
        for iteration in range(1, MOST_ITERATIONS + 1):
            # a case that diverges is dropped, its company goes on
            with np.errstate(all="ignore"):
                linear, shift = self.linearised()
                z, multipliers = self.newton_steps(linear, shift)
                before, size = size, self.sizes(linear, z, shift)
                good = (size < LARGEST_STEP) & (size < CONTRACTION * before)
                self.take(linear, z, shift, multipliers)
                done = good & (size < self.settings.convergence.step)
                done &= self.restore(linear, done) & self.inside()
                self.record(iteration, size)
            for case in np.flatnonzero(done):
                solution = self.trajectory(int(case), (time.perf_counter() - began) / everyone)
                if solution.status.ok:
                    yield int(self.numbers[case]), solution
            left = good & ~(size < self.settings.convergence.step)
            self.keep(left)
            size = size[left]
            if not len(self.problems):
                return

    @property
    def problem(self) -> OptimalControlProblem:
        """Any of the family."""
        return self.problems[0]

    @property
    def transcription(self) -> RadauTranscription:
        """That of all cases."""
        return radau_transcription(self.problem.mesh)

    @property
    def everyone(self) -> Cases:
        """All cases under way."""
        return np.arange(len(self.problems))

    def nodal(self, cases: Cases, first: int = 0) -> tuple[Array, Array, Array]:
        """x (7, points), û and t (1, points) at the nodes from `first` on, case by case."""
        t, u = self.transcription, self.u[cases]
        entry = u[:, None, : len(t.entry_rate)] @ t.entry_rate[:, None]
        rate = np.concatenate([entry[:, 0], u], axis=1)
        times = t.node_fixed + t.node_free * self.final_time[cases, None]
        x = self.x[:, cases, first:].reshape(N_STATES, -1)
        return x, rate[:, first:].reshape(1, -1), times[:, first:].reshape(1, -1)

    def linearised(self) -> tuple[CondensedFamily, Array]:
        """Z at the current points, and c (c, n − 1, 7)."""
        dynamics = family_dynamics(self.problem)
        derivatives = dynamics.first(*self.nodal(self.everyone))
        linear = condense_family(
            self.problem, self.transcription, dynamics, derivatives, self.final_time
        )
        residual = self.residual(derivatives[0].reshape(self.x.shape), self.everyone)
        return linear, linear.correction(residual, self.everyone)

    def newton_steps(self, linear: CondensedFamily, shift: Array) -> tuple[Array, Array]:
        """z (c, n_z) and λ (c, m); not a number where the Hessian is not positive definite."""
        target = self.problem.target
        rows = linear.final_map[:, target.state]
        gradient, hessian = self.model(linear, shift)
        error = self.errors() + shift[:, -1, target.state]
        give = np.zeros(len(target))  # 1/2w
        np.divide(0.5, target.weight, out=give, where=target.weight > 0.0)
        z, multipliers = np.full_like(gradient, np.nan), np.full_like(error, np.nan)
        for case, system in enumerate(zip(hessian, rows, gradient, error, strict=True)):
            with suppress(np.linalg.LinAlgError):
                z[case], multipliers[case] = _kkt_solution(*system, give)
        return z, multipliers

    def model(self, linear: CondensedFamily, shift: Array) -> tuple[Array, Array]:
        """Hessian (c, n_z, n_z) of the Lagrangian; gradient (c, n_z), without the target's, after c."""
        t, objective = self.transcription, self.problem.objective
        scale = self.problem.scaling.final_time
        final_gradient = np.zeros((len(self.problems), N_STATES))
        final_gradient[:, self.problem.target.state] = self.multipliers
        mu = linear.multipliers(final_gradient)
        hessian, gradient = linear.reduced_hessian(self.curvature(-linear.half * mu), mu, shift)
        quadrature, growth = linear.half * t.weights, t.half_free * t.weights * scale
        n_u = self.u.shape[1]
        gradient[:, :n_u] += 2.0 * objective.effort * quadrature * self.u
        gradient[:, -2] += objective.effort * (growth * self.u**2).sum(axis=1)
        gradient[:, -2] += objective.final_time * scale
        hessian[:, range(n_u), range(n_u)] += 2.0 * objective.effort * quadrature
        coupling = 2.0 * objective.effort * growth * self.u
        hessian[:, :n_u, -2] += coupling
        hessian[:, -2, :n_u] += coupling
        return gradient, hessian

    def curvature(self, weights: Array) -> Entries:
        """Second derivatives of Σ weights f over (x, t) at the collocation points; (7, c, n − 1)."""
        second = family_dynamics(self.problem).second
        found = second(*self.nodal(self.everyone, first=1), weights.reshape(N_STATES, -1))[0]
        return {
            entry: row.reshape(self.u.shape)
            for entry, row in zip(second.nonzeros[0], found, strict=True)
        }

    def sizes(self, linear: CondensedFamily, z: Array, shift: Array) -> Array:
        """‖(δσ, δt_f)‖_∞ (c,), as `exact_hessian` measures a step."""
        bank = (linear.moving[:, :, -1] @ z[:, :, None])[:, :, 0]
        bank[:, 1:] += shift[:, :, BANK]
        return np.asarray(np.maximum(np.abs(bank).max(axis=1), np.abs(z[:, -2])))

    def take(self, linear: CondensedFamily, z: Array, shift: Array, multipliers: Array) -> None:
        """The whole step."""
        self.x = self.x + linear.change(z)
        self.x[:, :, 1:] += shift.transpose(2, 0, 1)
        self.u = self.u + z[:, : self.u.shape[1]]
        self.final_time = self.final_time + z[:, -2] * self.problem.scaling.final_time
        self.multipliers = multipliers

    def restore(self, linear: CondensedFamily, chosen: Flags) -> Flags:
        """Solve R = 0 of the `chosen` at fixed control by chord steps; which have converged (c,)."""
        settings, values = self.settings.restoration, family_dynamics(self.problem).values
        converged = np.zeros_like(chosen)
        open_ = np.flatnonzero(chosen)
        before = np.full(len(open_), np.inf)
        for _ in range(settings.corrections):
            if not len(open_):
                break
            f, g = (v.reshape(-1, len(open_), self.x.shape[2]) for v in values(*self.nodal(open_)))
            change = linear.correction(self.residual(f, open_), open_)
            self.x[:, open_, 1:] += change.transpose(2, 0, 1)
            self.path[:, open_] = g[: self.problem.n_limits]
            size = np.abs(change).max(axis=(1, 2))
            there = _left(size, before) < settings.tolerance
            converged[open_[there]] = True
            going = ~there & (size < 2.0 * before)
            open_, before = open_[going], size[going]
        return converged

    def residual(self, rates: Array, cases: Cases) -> Array:
        """R (c, n − 1, 7) of `cases` with f (7, c, n)."""
        t = self.transcription
        half = t.half_fixed + t.half_free * self.final_time[cases, None]
        found = -(half * rates[:, :, 1:]).transpose(1, 2, 0)
        x = self.x[:, cases].transpose(1, 2, 0)
        for s in t.mesh.segments:
            found[:, s.collocation] += s.rule.derivative @ x[:, s.nodes]
        return found

    def errors(self) -> Array:
        """e (c, m)."""
        pairs = zip(self.problems, self.x[:, :, -1].T, strict=True)
        return np.stack([problem.target.error(final) for problem, final in pairs])

    def inside(self) -> Flags:
        """Whether every limit is kept at every node (c,)."""
        problem, rate = self.problem, self.nodal(self.everyone)[1].reshape(len(self.problems), -1)
        kept = np.abs(self.x[BANK]).max(axis=1) < problem.bank_limit
        kept &= np.abs(rate).max(axis=1) < 1.0
        return np.asarray(kept & (self.path.max(axis=(0, 2)) < 1.0))

    def keep(self, chosen: Flags) -> None:
        """Go on with these cases."""
        indices = np.flatnonzero(chosen)
        self.problems = [self.problems[i] for i in indices]
        self.logs = [self.logs[i] for i in indices]
        self.numbers, self.u = self.numbers[chosen], self.u[chosen]
        self.x, self.path = self.x[:, chosen], self.path[:, chosen]
        self.final_time, self.multipliers = self.final_time[chosen], self.multipliers[chosen]

    def cost(self, case: int) -> Cost:
        """Cost of one case without the target's."""
        here = Iterate(self.x[:, case].T, self.u[case], float(self.final_time[case]))
        nothing = np.zeros((len(here.states), 0))
        return cost_of(self.problem.objective, self.transcription, here, nothing)

    def record(self, iteration: int, size: Array) -> None:
        """One row of every log."""
        for case, log in enumerate(self.logs):
            total = self.total(case)
            log.append(
                IterationRecord(
                    iteration=iteration,
                    cost=total,
                    merit=total,
                    step=float(size[case]),
                    final_time=float(self.final_time[case]),
                    trust_radius=LARGEST_STEP,
                    ratio=1.0,
                    accepted=True,
                    subproblem="Solved",
                )
            )

    def total(self, case: int) -> float:
        """Cost in the mission's units."""
        problem = self.problems[case]
        error = problem.target.error(self.x[:, case, -1])
        total = self.cost(case).total + problem.target.quadratic(error)
        return float(total * problem.objective.cost_scale)

    def trajectory(self, case: int, seconds: float) -> Trajectory:
        """One converged case in SI."""
        problem, settings = self.problems[case], self.settings.convergence
        excess = limit_excess(self.path[:, case].T)
        status: Status = verdict(settings, problem, self.x[:, case, -1], excess, bought_off=False)
        rate = self.transcription.nodal_rate(self.u[case]) * problem.bank_rate_limit
        return Trajectory(
            mesh=problem.mesh,
            states=self.x[:, case] * np.array(problem.scaling.states)[:, None],
            bank_rate=rate,
            final_time=float(self.final_time[case]),
            cost=self.total(case),
            status=status,
            statistics=Statistics(
                iterations=len(self.logs[case]),
                solve_seconds=seconds,
                limit_excess=tuple(excess.tolist()),
                log=tuple(self.logs[case]),
            ),
            target_multipliers=self.multipliers[case] / problem.multiplier_scale,
        )


def _kkt_solution(
    hessian: Array, rows: Array, gradient: Array, error: Array, give: Array
) -> tuple[Array, Array]:
    """z and λ of one case, Eq. (1); LinAlgError unless H is positive definite under the target.

    With some of the target's stiffness, S = H + Cᵀ s C = L Lᵀ and B = I − s/2w, Eq. (1) is

        (C S⁻¹ Cᵀ B + 1/2w) λ = e − C S⁻¹ (g + Cᵀ s e),   z = −S⁻¹ (g + Cᵀ s e + Cᵀ B λ),

    and one Cholesky factor is both the solution and the test.
    """
    norms = np.einsum("ij,ij->i", rows, rows)
    with np.errstate(divide="ignore"):
        stiff = np.minimum(STIFF * float(np.linalg.norm(hessian)) / norms, 1.0 / give)
    weighted = rows.T * stiff
    factor, info = dpotrf(hessian + weighted @ rows, lower=1)
    if info != 0:
        raise np.linalg.LinAlgError("the Hessian is not positive definite under the target")
    half = dpotrs(factor, np.column_stack([gradient + weighted @ error, rows.T]), lower=1)[0]
    reduced, left = rows @ half, 1.0 - stiff * give
    multipliers = np.linalg.solve(reduced[:, 1:] * left + np.diag(give), error - reduced[:, 0])
    return -half[:, 0] - half[:, 1:] @ (left * multipliers), multipliers


def _left(size: Array, before: Array) -> Array:
    """What linearly convergent iterations have left after steps of `before`, then `size` (c,).

    Hairer & Wanner 1996, Eq. (IV.8.10): the sum of the steps to come, by their ratio.
    """
    series = size * (size / before) / (1.0 - size / before)
    return np.where((size < before) & np.isfinite(before), series, size)
