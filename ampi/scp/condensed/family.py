"""Newton's iteration for many neighbouring problems at once.

Beside a solved neighbour most cases of a database need nothing of what makes `exact_hessian` robust: no
limit is active, nothing is bought off, full steps converge. What is left of an iteration is Newton's
method on the condensed problem, the same for every case, and here it runs for all of them together:

    repeat
        δx = Z z + c                                       linearised dynamics; c from R (condensing)
        H = Zᵀ ∇²L Z                                        (condensing, Eq. (4))
        [ H   Cᵀ          ] [z]     [ g + Zᵀ ∇²L c ]
        [ C  −diag(1/2w)  ] [λ] = − [ e + c_f      ]       (1); 1/2w is 0 where a target is met exactly
        simplified steps: Z, H and C stay, c, g and e are those of the new point
    until the step is small, then restore R = 0

An iterate need not fly before the end: with the term in c this is Newton's method on states, control and
multipliers together. (Restoring the guess first and dropping c was tried: the first step is then none
of Newton's, and a third of the cases take an iteration more.) A step that is not small is followed by
simplified ones: the first says as much of convergence as Newton's next step would, for a quarter of its
cost. They converge linearly, so they have to come closer. Matrices and tolerances are those of
`exact_hessian`. A case that steps beyond a limit, whose Hessian is not positive definite under the
target, or that does not contract is left to it. Nothing of a case depends on its company, not even its
last bit: a database may be solved in any portions.

References
----------
Deuflhard (2011), "Newton Methods for Nonlinear Problems", Section 2.1 (simplified Newton corrections).
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, N_STATES
from ampi.scp.condensed.exact_hessian import SolverSettings
from ampi.scp.condensed.family_condensing import (
    MOVING,
    CondensedFamily,
    FamilyCurvature,
    condense_family,
    family_dynamics,
    with_final_time,
)
from ampi.scp.condensed.family_system import NewtonSystem
from ampi.scp.condensed.transcription import RadauTranscription, radau_transcription
from ampi.scp.guess import NodalGuess
from ampi.scp.problem.convergence import verdict
from ampi.scp.problem.penalty import limit_excess
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.trajectory import IterationRecord, Statistics, Status, Trajectory

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Cases = NDArray[np.intp]

LARGEST_STEP = 0.3  # rad: what is farther away is no neighbour
CONTRACTION = 0.5  # of the step from one iteration to the next, at least
MOST_ITERATIONS = 6  # with matrices of their own
SIMPLIFIED_STEPS = 3  # with the same matrices, at most, and only while they contract like `FAST`
FAST = 0.1


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
        tolerance = self.settings.convergence.step
        for _ in range(MOST_ITERATIONS):
            # a case that diverges is dropped, its company goes on
            with np.errstate(all="ignore"):
                system, shift = self.system()
                before, (size, along) = size, self.newton_step(system, shift)
                good = (size < LARGEST_STEP) & (size < CONTRACTION * before)
                done, going, last = good & (size < tolerance), good & (size >= tolerance), size
                for _ in range(SIMPLIFIED_STEPS):
                    if not going.any():
                        break
                    before, last = last, last.copy()
                    last[going] = self.simplified_step(system, along, np.flatnonzero(going))
                    done |= going & (_left(last, before) < tolerance**2)
                    going &= ~done & (last < FAST * before)
                left = good & ~done
                done &= self.restore(system.linear, done, last) & self.inside()
            for case in np.flatnonzero(done):
                solution = self.trajectory(int(case), (time.perf_counter() - began) / everyone)
                if solution.status.ok:
                    yield int(self.numbers[case]), solution
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

    def system(self) -> tuple[NewtonSystem, Array]:
        """Eq. (1) at the current points, and c (c, n − 1, 7)."""
        dynamics = family_dynamics(self.problem)
        derivatives = dynamics.first(*self.nodal(self.everyone))
        linear = condense_family(
            self.problem, self.transcription, dynamics, derivatives, self.final_time
        )
        residual = self.residual(derivatives[0].reshape(self.x.shape), self.everyone)
        shift = linear.correction(residual, self.everyone)
        curvature = self.curvature(linear)
        return NewtonSystem.factored(linear, curvature, self.hessian(curvature)), shift

    def newton_step(self, system: NewtonSystem, shift: Array) -> tuple[Array, Array]:
        """Take the whole step: its size (c,), and ∇²L over the moving states times it (c, n − 1, 6)."""
        gradient = self.gradient(self.everyone) + system.curvature.product(shift, self.everyone)
        error = self.errors(self.everyone) + shift[:, -1, self.problem.target.state]
        z, multipliers = system.solution(gradient, error, self.everyone)
        self.multipliers = np.zeros_like(self.multipliers)
        size, bent = self.take(self.everyone, system, z, shift, multipliers)
        self.record(self.everyone, size, "Solved")
        return size, bent

    def simplified_step(self, system: NewtonSystem, along: Array, cases: Cases) -> Array:
        """One more step of `cases` with the matrices of the last: its size (k,).

        What it costs are first derivatives at the new points. `along` (c, n − 1, 6) is what the
        multipliers there, Mᵀ μ = −∂(λᵀe)/∂x − `along`, owe to the steps since M was formed.
        """
        linear, target = system.linear, self.problem.target
        derivatives = family_dynamics(self.problem).first(*self.nodal(cases))
        rates = derivatives[0].reshape(N_STATES, len(cases), -1)
        shift = linear.correction(self.residual(rates, cases), cases)
        mu = linear.multipliers(self.final_gradient(cases), cases, along[cases])
        gradient, left = self.lagrangian_gradient(linear, derivatives, mu, cases)
        left -= along[cases]
        gradient += linear.projected(left, cases) + system.curvature.product(shift, cases)
        error = self.errors(cases) + shift[:, -1, target.state]
        error -= system.give * self.multipliers[cases]
        z, multipliers = system.solution(gradient, error, cases)
        size, bent = self.take(cases, system, z, shift, multipliers)
        self.record(cases, size, "Simplified")
        along[cases] += left + bent
        return size

    def lagrangian_gradient(
        self, linear: CondensedFamily, derivatives: list[Array], mu: Array, cases: Cases
    ) -> tuple[Array, Array]:
        """∇L over z where no state moves (k, n_z), and over the moving states (k, n − 1, 6).

        The latter is what h (∂f/∂x)ᵀ μ has changed since `linear`; `derivatives` are at the new points.
        """
        problem, t, dynamics = self.problem, self.transcription, family_dynamics(self.problem)
        count, n = len(cases), self.x.shape[2]
        half = t.half_fixed + t.half_free * self.final_time[cases, None]
        over_states = np.zeros((count, n - 1, len(MOVING)))
        for (row, column), values in zip(dynamics.first.nonzeros[1], derivatives[1], strict=True):
            grown = half * values.reshape(count, n)[:, 1:] - linear.stretched[row, column][cases]
            over_states[:, :, MOVING.index(column)] -= grown * mu[row]
        gradient = self.gradient(cases)
        gradient[:, : n - 1] -= half * problem.bank_rate_limit * mu[BANK]
        _, by_time = with_final_time(t, dynamics, derivatives, half)
        for of_state, rate in zip(mu, by_time, strict=True):
            gradient[:, -2] -= problem.scaling.final_time * (of_state * rate).sum(axis=1)
        start = t.mesh.segments[0]
        on_start = mu[BANK][:, start.collocation] * start.rule.derivative[:, 0]
        gradient[:, -1] += on_start.sum(axis=1)
        return gradient, over_states

    def final_gradient(self, cases: Cases) -> Array:
        """Of λᵀe over the final states, (k, 7)."""
        gradient = np.zeros((len(cases), N_STATES))
        gradient[:, self.problem.target.state] = self.multipliers[cases]
        return gradient

    def curvature(self, linear: CondensedFamily) -> FamilyCurvature:
        """Second derivatives of −h μᵀf at the collocation points, with μ from λ."""
        mu = linear.multipliers(self.final_gradient(self.everyone), self.everyone)
        second = family_dynamics(self.problem).second
        weights = (-linear.half * mu).reshape(N_STATES, -1)
        found = second(*self.nodal(self.everyone, first=1), weights)[0]
        rows = zip(second.nonzeros[0], found, strict=True)
        entries = {entry: row.reshape(self.u.shape) for entry, row in rows}
        return FamilyCurvature.of(linear, entries, mu)

    def gradient(self, cases: Cases) -> Array:
        """Of effort and flight time over z, (k, n_z)."""
        t, objective, u = self.transcription, self.problem.objective, self.u[cases]
        scale, n_u = self.problem.scaling.final_time, u.shape[1]
        half = t.half_fixed + t.half_free * self.final_time[cases, None]
        gradient = np.zeros((len(cases), n_u + 2))
        gradient[:, :n_u] = 2.0 * objective.effort * half * t.weights * u
        growth = t.half_free * t.weights * scale
        gradient[:, -2] = objective.effort * (growth * u**2).sum(axis=1)
        gradient[:, -2] += objective.final_time * scale
        return gradient

    def hessian(self, curvature: FamilyCurvature) -> Array:
        """H (c, n_z, n_z) of Eq. (1)."""
        t, effort, n_u = self.transcription, self.problem.objective.effort, self.u.shape[1]
        hessian = curvature.reduced()
        hessian[:, range(n_u), range(n_u)] += 2.0 * effort * curvature.linear.half * t.weights
        growth = t.half_free * t.weights * self.problem.scaling.final_time
        coupling = 2.0 * effort * growth * self.u
        hessian[:, :n_u, -2] += coupling
        hessian[:, -2, :n_u] += coupling
        return hessian

    def take(
        self, cases: Cases, system: NewtonSystem, z: Array, shift: Array, multipliers: Array
    ) -> tuple[Array, Array]:
        """Move `cases` by z and c, λ by `multipliers`.

        The size of the step, ‖(δσ, δt_f)‖_∞ (k,) as `exact_hessian` has it, and `FamilyCurvature.bent`.
        """
        change = system.linear.change(z, cases)
        change[:, :, 1:] += shift.transpose(2, 0, 1)
        self.x[:, cases] += change
        self.u[cases] += z[:, : self.u.shape[1]]
        self.final_time[cases] += z[:, -2] * self.problem.scaling.final_time
        self.multipliers[cases] += multipliers
        size = np.maximum(np.abs(change[BANK]).max(axis=1), np.abs(z[:, -2]))
        return size, system.curvature.bent(change[:, :, 1:].transpose(1, 2, 0), z[:, -2], cases)

    def restore(self, linear: CondensedFamily, chosen: Flags, last: Array) -> Flags:
        """Solve R = 0 of the `chosen` at fixed control by chord steps; which have converged (c,).

        `last` (c,) is the size of the step that left R; the first chord step converges relative to it.
        """
        settings, values = self.settings.restoration, family_dynamics(self.problem).values
        converged = np.zeros_like(chosen)
        open_ = np.flatnonzero(chosen)
        before = last[open_]
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

    def errors(self, cases: Cases) -> Array:
        """e (k, m)."""
        finals = self.x[:, cases, -1].T
        pairs = zip(cases, finals, strict=True)
        return np.stack([self.problems[case].target.error(final) for case, final in pairs])

    def inside(self) -> Flags:
        """Whether every limit is kept at every node (c,)."""
        problem, rate = self.problem, self.nodal(self.everyone)[1].reshape(len(self.problems), -1)
        between = self.x[BANK] @ self.transcription.between.T
        bank = np.maximum(np.abs(self.x[BANK]).max(axis=1), np.abs(between).max(axis=1))
        kept = bank < problem.bank_limit
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

    def record(self, cases: Cases, size: Array, subproblem: str) -> None:
        """One row of the logs of `cases`."""
        for case, total, step in zip(cases, self.totals(cases), size, strict=True):
            self.logs[case].append(
                IterationRecord(
                    iteration=len(self.logs[case]) + 1,
                    cost=float(total),
                    merit=float(total),
                    step=float(step),
                    final_time=float(self.final_time[case]),
                    trust_radius=LARGEST_STEP,
                    ratio=1.0,
                    accepted=True,
                    subproblem=subproblem,
                )
            )

    def totals(self, cases: Cases) -> Array:
        """Costs in the mission's units, (k,)."""
        t, objective, final_time = (
            self.transcription,
            self.problem.objective,
            self.final_time[cases],
        )
        quadrature = (t.half_fixed + t.half_free * final_time[:, None]) * t.weights
        total = objective.effort * (quadrature * self.u[cases] ** 2).sum(axis=1)
        total += objective.final_time * final_time
        total += (self.problem.target.weight * self.errors(cases) ** 2).sum(axis=1)
        return np.asarray(total * objective.cost_scale)

    def trajectory(self, case: int, seconds: float) -> Trajectory:
        """One converged case in SI."""
        problem, settings = self.problems[case], self.settings.convergence
        excess = limit_excess(self.path[:, case].T)
        status: Status = verdict(settings, problem, self.x[:, case, -1], excess, bought_off=False)
        rate = self.transcription.nodal_rate(self.u[case]) * problem.bank_rate_limit
        cost, rows = float(self.totals(np.array([case]))[0]), self.logs[case]
        log = (*rows[:-1], replace(rows[-1], cost=cost, merit=cost))  # restored since
        return Trajectory(
            mesh=problem.mesh,
            states=self.x[:, case] * np.array(problem.scaling.states)[:, None],
            bank_rate=rate,
            final_time=float(self.final_time[case]),
            cost=cost,
            status=status,
            statistics=Statistics(
                iterations=len(log),
                solve_seconds=seconds,
                limit_excess=tuple(excess.tolist()),
                log=log,
            ),
            target_multipliers=self.multipliers[case] / problem.multiplier_scale,
        )


def _left(size: Array, before: Array) -> Array:
    """What linearly convergent iterations have left after steps of `before`, then `size` (c,).

    Hairer & Wanner 1996, Eq. (IV.8.10): the sum of the steps to come, by their ratio.
    """
    series = size * (size / before) / (1.0 - size / before)
    return np.where((size < before) & np.isfinite(before), series, size)
