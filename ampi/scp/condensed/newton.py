"""Newton's iteration for many neighbouring problems at once.

Beside a solved neighbour most cases of a database need nothing of what makes `exact_hessian` robust:
nothing is bought off, full steps converge. What is left of an iteration is Newton's method on the
condensed problem, the same for every case, and here it runs for all of them together:

    repeat
        δx = Z z + c                                       linearised dynamics; c from R (condensing)
        H = Zᵀ ∇²L Z                                        (curvature, Eq. (1))
        [ H   Kᵀ          ] [z]     [ g + Zᵀ ∇²L c ]
        [ K  −diag(1/2w)  ] [λ] = − [ e + c_f      ]       (1); 1/2w is 0 where a target is met exactly
        simplified steps: Z, H and K stay, c, g and e are those of the new point
    until the step is small, then restore R = 0

K holds the rows of the target and of those limits that hold the step (limit_rows): within one set of
matrices the held set is changed until no other row is violated and no held one pulls inwards;
simplified steps keep it. A set that the guess does not know costs one solution of Eq. (1) that is not
taken, for its multipliers weigh the curvature of the limits.

An iterate need not fly before the end: with the term in c this is Newton's method on states, control and
multipliers together. (Restoring the guess first and dropping c was tried: the first step is then none
of Newton's, and a third of the cases take an iteration more.) A step that is not small is followed by
simplified ones: the first says as much of convergence as Newton's next step would, for a quarter of its
cost. They converge linearly, so they have to come closer. Matrices and tolerances are those of
`exact_hessian`. A case whose Hessian is not positive definite under K, whose held set does not settle,
or that does not contract is left to it. Nothing of a case depends on its company, not even its last bit:
a database may be solved in any portions.

References
----------
Deuflhard (2011), "Newton Methods for Nonlinear Problems", Section 2.1 (simplified Newton corrections).
Hintermüller, Ito, Kunisch (2003), SIAM J. Optim. 13, 865–888 (the held set).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK
from ampi.scp.condensed.condensing import Cases, CondensedDynamics, NodeDerivatives, with_final_time
from ampi.scp.condensed.cost import smooth_gradient
from ampi.scp.condensed.limit_rows import LimitRows, n_rows
from ampi.scp.condensed.newton_system import Multipliers, NewtonStep, NewtonSystem
from ampi.scp.condensed.points import Points
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.condensed.transcription import by_control
from ampi.scp.cone_program import ConeStatus
from ampi.scp.guess import NodalGuess
from ampi.scp.problem.convergence import converged_status
from ampi.scp.problem.penalty import limit_excess
from ampi.scp.problem.scaled_problem import OptimalControlProblem, by_case
from ampi.trajectory import IterationRecord, Statistics, Status, Trajectory

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def is_known(problem: OptimalControlProblem) -> bool:
    """Whether the iteration knows the objective: no absolute values."""
    objective = problem.objective
    return not (np.any(objective.variation > 0.0) or np.any(objective.descent > 0.0))


def newton(
    problem: OptimalControlProblem,
    guesses: Sequence[NodalGuess],
    settings: SolverSettings | None = None,
    *,
    one_by_one: bool = False,
) -> Iterator[tuple[int, Trajectory]]:
    """Solve the cases of a problem, each from nearby.

    Parameters
    ----------
    problem
        Of a family (`OptimalControlProblem.of`).
    guesses
        One for each case, on its mesh, with multipliers of the target.
    settings
        Of `exact_hessian`: its tolerances hold here.
    one_by_one
        Evaluate the physics case by case, which is faster for one; last bits differ.

    Yields
    ------
    int, Trajectory
        Place and solution of each case that converges, as soon as it has; the others are to be left to
        `exact_hessian`.
    """
    if len(guesses) and is_known(problem):
        points = Points.of(problem, guesses, one_by_one=one_by_one)
        yield from NewtonIteration.begin(points, guesses, settings or SolverSettings()).run()


@dataclass(eq=False)
class NewtonIteration:
    """The cases under way."""

    settings: SolverSettings
    points: Points
    multipliers: Multipliers
    numbers: NDArray[np.intp]  # their places in the family
    logs: list[list[IterationRecord]]
    began: float = field(default_factory=time.perf_counter)

    @classmethod
    def begin(
        cls, points: Points, guesses: Sequence[NodalGuess], settings: SolverSettings
    ) -> NewtonIteration:
        """No limit is held yet."""
        problem, count = points.problem, len(points)
        known = np.stack([np.asarray(g.target_multipliers) for g in guesses])
        known = (known * problem.multiplier_scale)[:, problem.target.held]
        on_rate = np.zeros((count, len(problem.given_rates)))
        rows = n_rows(problem, len(points.transcription.between))
        multipliers = Multipliers(
            target=np.concatenate([known, on_rate], axis=1),
            limits=np.zeros((count, rows)),
            side=np.zeros((count, rows), dtype=np.int8),
        )
        return cls(settings, points, multipliers, np.arange(count), [[] for _ in guesses])

    def run(self) -> Iterator[tuple[int, Trajectory]]:
        """(place, solution) of every case that converges."""
        size = np.full(len(self.numbers), np.inf)
        settings, everyone = self.settings.newton, len(size)
        for iteration in range(settings.iterations):
            if self.settings.is_over(self.began):
                return
            # a case that diverges is dropped, its company goes on
            with np.errstate(all="ignore"):
                system = NewtonSystem.of(self.points, self.multipliers)
                shift = self.shift(system)
                step = self.solution(system, shift)
                if iteration == 0:
                    system, step = self.with_known_multipliers(system, shift, step)
                before, size = size, self.newton_step(shift, step)
                good = (size < settings.largest_step) & (size < settings.contraction * before)
                done, last = self.simplified_steps(system, good, size)
                ongoing = good & ~done
                done &= self.restore(system.condensed, done, last)
                kept = self.keeps_limits(system.rows)
            yield from self.solutions(np.flatnonzero(done & kept), everyone)
            size[done & ~kept] = np.inf  # one more limit is to be held: by a step of any size
            ongoing |= done & ~kept
            self.keep(ongoing)
            size = size[ongoing]
            if not len(self.numbers):
                return

    def solution(
        self, system: NewtonSystem, shift: Array, cases: Cases | None = None
    ) -> NewtonStep:
        """Of `system`, with the limits that hold it; of `cases` or of all."""
        return system.solution(
            *system.right_side(shift), self.multipliers.side, self.settings.newton, cases
        )

    def with_known_multipliers(
        self, system: NewtonSystem, shift: Array, first: NewtonStep
    ) -> tuple[NewtonSystem, NewtonStep]:
        """The system weighed by the multipliers of its `first` solution, and its solution then.

        Where that holds no limit, the multipliers of the neighbour are as good, and the first will do.
        """
        multipliers = self.multipliers
        indefinite = np.flatnonzero(~np.isfinite(first.z[:, 0]))
        if len(indefinite):  # it may be a limit alone that keeps H positive definite
            multipliers.side[indefinite] = 0
            convex = system.gauss_newton(self.settings.curvature)
            found = self.solution(convex, shift, indefinite)
            first.target[indefinite] = found.target[indefinite]
            first.limits[indefinite] = found.limits[indefinite]
        limited = np.flatnonzero(multipliers.side.any(axis=1))
        if not len(limited):
            return system, first
        multipliers.target[limited] = first.target[limited]
        multipliers.limits[limited] = first.limits[limited]
        system = system.with_curvature_of(multipliers)
        second = self.solution(system, shift, limited)
        first.z[limited], first.change[:, limited] = second.z[limited], second.change[:, limited]
        first.target[limited] = second.target[limited]
        first.limits[limited] = second.limits[limited]
        return system, first

    def shift(self, system: NewtonSystem) -> Array:
        """c of all cases where the matrices were made."""
        rates = system.condensed.derivatives.rates
        return self.points.shift(system.condensed, rates, self.points.everyone)

    def newton_step(self, shift: Array, step: NewtonStep) -> Array:
        """Take the whole step: its size (c,)."""
        points, multipliers = self.points, self.multipliers
        multipliers.target, multipliers.limits = step.target, step.limits
        size = points.take(points.everyone, step.z, step.change, shift)
        self.record(points.everyone, size, ConeStatus.SOLVED)
        return size

    def simplified_steps(
        self, system: NewtonSystem, good: Flags, size: Array
    ) -> tuple[Flags, Array]:
        """Which cases have converged, and the size of their last step; `size` is that of Newton's."""
        settings, tolerance = self.settings.newton, self.settings.convergence.step
        done, going, last = good & (size < tolerance), good & (size >= tolerance), size
        changed = self.points.nothing_changed()
        for _ in range(settings.simplified_steps):
            if not going.any():
                break
            before, last, chosen = last, last.copy(), np.flatnonzero(going)
            last[chosen] = self.simplified_step(system, changed, chosen)
            done |= going & (_remaining(last, before) < tolerance**2)
            going &= ~done & (last < settings.fast * before)
        return done, last

    def simplified_step(self, system: NewtonSystem, changed: Array, cases: Cases) -> Array:
        """One more step of `cases` with the matrices of the last: its size (k,).

        What it costs are first derivatives at the new points. The multipliers there are found with the
        factors of M, from M_newᵀ μ = −∂(…)/∂x; `changed` (c, n − 1, s) is the last (M_new − M)ᵀ μ.
        """
        points, multipliers, condensed = self.points, self.multipliers, system.condensed
        column, derivatives = condensed.time_column, points.derivatives(cases)
        shift = points.shift(condensed, derivatives.rates, cases)
        path = np.stack([derivatives.gradient_of(k) for k in range(points.problem.n_limits)])
        on_states, on_time = self.node_gradient(system.rows, derivatives, path, cases)
        for _ in range(2):  # the first is off by what M has changed, the second by its square
            mu = condensed.multipliers(on_states + changed[cases], cases)
            now = condensed.change_of_transpose(derivatives, self.half(cases), mu, cases)
            left, changed[cases] = now - changed[cases], now
        gradient = self.control_gradient(derivatives, mu, cases)
        gradient[:, column] += on_time
        gradient += system.rows.on_control(multipliers.limits[cases], path)
        over_states, over_time = system.curvature.product(shift, cases)
        gradient += condensed.projected(left + over_states, cases)
        gradient[:, column] += over_time
        errors = points.errors(cases, shift)
        errors -= system.compliance[cases] * multipliers.target[cases]
        value = system.limit_values(shift, cases)
        z = np.empty_like(gradient)
        for k, case in enumerate(cases):
            z[k], on_target, on_limits = system.held_solution(
                int(case), multipliers.side[case], gradient[k], errors[k], value[k]
            )
            multipliers.target[case] += on_target
            multipliers.limits[case] += on_limits
        size = points.take(cases, z, condensed.change(z, cases), shift)
        self.record(cases, size, "Simplified")
        return size

    def half(self, cases: Cases) -> Array:
        """h at the collocation points, (k, n − 1)."""
        return self.points.transcription.half_lengths(self.points.final_time[cases])

    def node_gradient(
        self, rows: LimitRows, derivatives: NodeDerivatives, path: Array, cases: Cases
    ) -> tuple[Array, Array]:
        """∂(λᵀe + νᵀg + J)/∂(x after the first node, scaled t_f), with ∂g/∂(x, t) in `path`."""
        points, problem, t = self.points, self.points.problem, self.points.transcription
        on_states, at_times = rows.node_gradient(self.multipliers.limits[cases], path)
        held = problem.target.held
        on_states[:, -1, problem.target.state[held]] += self.multipliers.target[cases, : len(held)]
        on_time = (at_times * t.node_free).sum(axis=1)
        if problem.functions.n_smooth:
            weight = t.weights * self.half(cases)
            jacobian = derivatives.gradient_of(problem.n_limits)[:, 1:]
            on_states += weight[..., None] * jacobian[:, :, :-1]
            on_time += (weight * jacobian[:, :, -1] * t.node_free[1:]).sum(axis=1)
            values = points.functions[problem.n_limits, cases, 1:]
            on_time += (t.half_free * t.weights * values).sum(axis=1)
        if (terminal := points.terminal(cases)) is not None:
            on_states[:, -1] += terminal.gradient
        return on_states, on_time * problem.scaling.final_time

    def control_gradient(self, derivatives: NodeDerivatives, mu: Array, cases: Cases) -> Array:
        """∇L over z where no state moves (k, n_z): effort, flight time and the dynamics."""
        points, problem, t = self.points, self.points.problem.at(cases), self.points.transcription
        half, u, final_time = self.half(cases), points.u[cases], points.final_time[cases]
        gradient, m = smooth_gradient(problem, t, u, final_time), problem.n_controls
        _, by_time = with_final_time(t, derivatives, half)
        for of_state, rate in zip(mu, by_time, strict=True):
            gradient[:, -1 - m] -= problem.scaling.final_time * (of_state * rate).sum(axis=1)
        for k, angle in enumerate(problem.angles):
            gradient[:, k : -1 - m : m] -= half * by_case(angle.rate_limit) * mu[BANK + k]
            if angle.entry is None:
                first = t.mesh.segments[0]  # its polynomial alone knows y₀
                on_start = mu[BANK + k][:, first.collocation] * first.rule.derivative[:, 0]
                gradient[:, k - m] += on_start.sum(axis=1)
        return gradient

    def restore(self, condensed: CondensedDynamics, chosen: Flags, last: Array) -> Flags:
        """Solve R = 0 of the `chosen` at fixed control by chord steps; which have converged (c,).

        `last` (c,) is the size of the step that left R; the first chord step converges relative to it.
        """
        settings, points = self.settings.restoration, self.points
        converged = np.zeros_like(chosen)
        moving = np.flatnonzero(chosen)
        before = last[moving]
        for _ in range(settings.corrections):
            if not len(moving):
                break
            rates, points.functions[:, moving] = points.evaluate(
                points.problem.dynamics.values, moving
            )
            change = points.shift(condensed, rates, moving)
            points.x[:, moving, 1:] += change.transpose(2, 0, 1)
            size = np.abs(change).max(axis=(1, 2))
            there = _remaining(size, before) < settings.tolerance
            converged[moving[there]] = True
            going = ~there & (size < 2.0 * before)
            moving, before = moving[going], size[going]
        return converged

    def keeps_limits(self, rows: LimitRows) -> Flags:
        """Whether a case is within every limit, as far as this iteration looks, (c,)."""
        points, error = self.points, self.settings.newton.limit_error
        everyone = points.everyone
        target = points.problem.target
        value = rows.value(target, points.x, points.rate(everyone), points.path)
        return np.all((value <= rows.upper + error) & (value >= rows.lower - error), axis=1)

    def keep(self, chosen: Flags) -> None:
        """Go on with these cases."""
        self.points.keep(chosen)
        self.multipliers.keep(chosen)
        self.logs = [self.logs[i] for i in np.flatnonzero(chosen)]
        self.numbers = self.numbers[chosen]

    def record(self, cases: Cases, size: Array, subproblem: str) -> None:
        """One row of the logs of `cases`."""
        largest = self.settings.newton.largest_step
        for case, cost, step in zip(cases, self.points.cost(cases), size, strict=True):
            self.logs[case].append(
                IterationRecord(
                    iteration=len(self.logs[case]) + 1,
                    cost=float(cost),
                    merit=float(cost),
                    step=float(step),
                    final_time=float(self.points.final_time[case]),
                    trust_radius=largest,
                    ratio=1.0,
                    accepted=True,
                    subproblem=subproblem,
                )
            )

    def solutions(self, cases: Cases, everyone: int) -> Iterator[tuple[int, Trajectory]]:
        """(place, solution) of those of the converged `cases` that meet the target."""
        if not len(cases):
            return
        seconds = (time.perf_counter() - self.began) / everyone
        rates, costs = self.points.rate(cases), self.points.cost(cases).tolist()
        for case, rate, cost in zip(cases.tolist(), rates, costs, strict=True):
            solution = self.trajectory(case, rate, cost, seconds)
            if solution.status.ok:
                yield int(self.numbers[case]), solution

    def trajectory(self, case: int, rate: Array, cost: float, seconds: float) -> Trajectory:
        """One converged case in SI, with û (n m,) and its cost; `seconds` is its share of the time."""
        points, problem = self.points, self.points.problem.at(case)
        excess = limit_excess(points.path[:, case].T)
        final, settings = points.x[:, case, -1], self.settings.convergence
        status: Status = converged_status(settings, problem, final, excess, bought_off=False)
        rows = self.logs[case]
        log = (*rows[:-1], replace(rows[-1], cost=cost, merit=cost))  # restored since
        multipliers, target = np.zeros(len(problem.target)), problem.target
        multipliers[target.held] = self.multipliers.target[case, : len(target.held)]
        if len(target.ranged):
            multipliers[target.ranged] = self.multipliers.limits[case, -len(target.ranged) :]
        rates = problem.in_si(by_control(rate[None], problem.n_controls)[:, 0])
        return Trajectory(
            mesh=problem.mesh,
            states=points.x[:, case] * np.array(problem.scaling.states)[:, None],
            bank_rate=rates[0],
            angle_of_attack_rate=rates[1] if len(rates) > 1 else None,
            final_time=float(points.final_time[case]),
            cost=cost,
            status=status,
            statistics=Statistics(
                iterations=len(log),
                solve_seconds=seconds,
                limit_excess=tuple(excess.tolist()),
                log=log,
            ),
            target_multipliers=multipliers / problem.multiplier_scale,
        )


def _remaining(size: Array, before: Array) -> Array:
    """What linearly convergent iterations have left after steps of `before`, then `size` (c,).

    Hairer & Wanner 1996, Eq. (IV.8.10): the sum of the steps to come, by their ratio.
    """
    series = size * (size / before) / (1.0 - size / before)
    return np.where((size < before) & np.isfinite(before), series, size)
