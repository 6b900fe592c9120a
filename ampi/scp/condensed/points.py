"""Where c cases stand: states, control and final time, and what follows from them at the nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK
from ampi.scp.condensed.condensing import Cases, CondensedDynamics, NodeDerivatives, condense
from ampi.scp.condensed.cost import Terminal, smooth_cost, terminal_cost
from ampi.scp.condensed.transcription import RadauTranscription, by_control, radau_transcription
from ampi.scp.guess import NodalGuess
from ampi.scp.problem.scaled_problem import OptimalControlProblem, by_case
from ampi.tracing.dynamics import NodeFunction
from ampi.tracing.numbers import at_cases

Array = NDArray[np.float64]


@dataclass(eq=False)
class Points:
    """Scaled variables of c cases; an iterate need not fly before the end."""

    problem: OptimalControlProblem
    one_by_one: bool  # how the physics is evaluated (tracing)
    x: Array  # (s, c, n)
    u: Array  # û at the collocation points, (c, (n − 1) m), the m controls of a point side by side
    final_time: Array  # (c,)
    functions: Array  # g and integrands as of the last evaluation, (m + k, c, n)
    transcription: RadauTranscription

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, guesses: Sequence[NodalGuess], *, one_by_one: bool
    ) -> Points:
        """All cases at their guesses, moved to their entry states."""
        scale, n = np.array(problem.scaling.states), problem.mesh.n_nodes
        x = np.stack([g.states.T for g in guesses], axis=1) / scale[:, None, None]
        rate = scaled_controls(problem, guesses)
        found = cls(
            problem=problem,
            one_by_one=one_by_one,
            x=x,
            u=np.clip(rate, -1.0, 1.0),
            final_time=np.array([g.final_time for g in guesses]),
            functions=np.zeros((problem.n_functions, len(guesses), n)),
            transcription=radau_transcription(problem.mesh),
        )
        found.enter()
        return found

    def enter(self) -> None:
        """Move the first node of all cases to the entry states of their problem."""
        self.x[:BANK, :, 0] = np.reshape(self.problem.entry, (-1, BANK)).T
        for angle in self.problem.angles:
            if angle.entry is not None:
                self.x[angle.state, :, 0] = angle.entry

    def of_problem(self, problem: OptimalControlProblem) -> Points:
        """A copy, moved to the entry states of another problem of as many cases."""
        x, u, functions = self.x.copy(), self.u.copy(), np.zeros_like(self.functions)
        found = replace(
            self, problem=problem, x=x, u=u, final_time=self.final_time.copy(), functions=functions
        )
        found.enter()
        return found

    def __len__(self) -> int:
        return len(self.final_time)

    @property
    def everyone(self) -> Cases:
        """All cases."""
        return np.arange(len(self))

    @property
    def path(self) -> Array:
        """g as of the last evaluation, (m, c, n)."""
        return self.functions[: self.problem.n_limits]

    def rate(self, cases: Cases) -> Array:
        """û at all nodes, (k, n m)."""
        return self.transcription.nodal_rate(self.u[cases], self.problem.n_controls)

    def evaluate(
        self, function: NodeFunction, cases: Cases, *weights: Array, first: int = 0
    ) -> list[Array]:
        """A traced function at the nodes of `cases` from `first` on."""
        times = self.transcription.times(self.final_time[cases])
        x, numbers = self.x[:, cases, first:], self.problem.numbers
        rate = by_control(self.rate(cases), self.problem.n_controls)[:, :, first:]
        evaluate = function.one_by_one if self.one_by_one else function.together
        return evaluate(x, rate, times[:, first:], at_cases(numbers, cases), *weights)

    def derivatives(self, cases: Cases) -> NodeDerivatives:
        """First derivatives at all nodes; `functions` are brought up to date."""
        function = self.problem.dynamics.first
        found = NodeDerivatives.of(function, self.evaluate(function, cases))
        assert found.functions is not None
        self.functions[:, cases] = found.functions
        return found

    def condensed(self) -> CondensedDynamics:
        """The dynamics of all cases, linearised here."""
        problem = self.problem
        return condense(
            self.transcription,
            self.derivatives(self.everyone),
            self.final_time,
            rate_scale=tuple(by_case(angle.rate_limit) for angle in problem.angles),
            final_time_scale=problem.scaling.final_time,
            free_angles=tuple(angle.entry is None for angle in problem.angles),
        )

    def shift(self, condensed: CondensedDynamics, rates: Array, cases: Cases) -> Array:
        """c of `cases`, what the states miss of flying (k, n − 1, s), with f (s, k, n)."""
        x, final_time = self.x[:, cases], self.final_time[cases]
        return condensed.correction(self.transcription.residual(x, rates, final_time), cases)

    def errors(self, cases: Cases, shift: Array) -> Array:
        """Of the rows that always hold after `shift`, (k, r): target rows, given rates of the entry."""
        problem, held = self.problem, self.problem.target.held
        target = problem.at(cases).target
        error = target.error(self.x[:, cases, -1].T)[:, held] + shift[:, -1, target.state[held]]
        given = problem.at(cases).given_rates
        if not given:
            return np.asarray(error)
        first = self.rate(cases)
        on_rates = [first[:, k : k + 1] - by_case(rate) for k, rate in given]
        return np.concatenate([error, *on_rates], axis=1)

    def take(self, cases: Cases, z: Array, change: Array, shift: Array) -> Array:
        """Move `cases` by z, `change` = Z z and c; the size of the step, ‖(δy, δt_f)‖_∞, (k,)."""
        column = -1 - self.problem.n_controls
        change[:, :, 1:] += shift.transpose(2, 0, 1)
        self.x[:, cases] += change
        self.u[cases] += z[:, :column]
        self.final_time[cases] += z[:, column] * self.problem.scaling.final_time
        return np.maximum(np.abs(change[BANK:]).max(axis=(0, 2)), np.abs(z[:, column]))

    def nothing_changed(self) -> Array:
        """No gradient over the states after the first node, (c, n − 1, s)."""
        s, cases, n = self.x.shape
        return np.zeros((cases, n - 1, s))

    def terminal(self, cases: Cases) -> Terminal | None:
        """m(x_f) and its derivatives, if the objective has it."""
        final, problem = self.x[:, cases, -1], self.problem.at(cases)
        return terminal_cost(problem, final, one_by_one=self.one_by_one)

    def cost(self, cases: Cases) -> Array:
        """In the mission's units, (k,)."""
        problem = self.problem.at(cases)
        integrands = self.functions[problem.n_limits :, cases]
        total = smooth_cost(
            problem, self.transcription, self.u[cases], self.final_time[cases], integrands
        )
        error = problem.target.error(self.x[:, cases, -1].T)
        total = total + problem.target.quadratic(error)
        terminal = self.terminal(cases)
        if terminal is not None:
            total = total + terminal.value
        return np.asarray(total * by_case(problem.objective.cost_scale)[:, 0])

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Go on with these cases."""
        self.problem = self.problem.at(np.flatnonzero(chosen))
        self.x, self.functions = self.x[:, chosen], self.functions[:, chosen]
        self.u, self.final_time = self.u[chosen], self.final_time[chosen]


def zero_states(points: Points, cases: Cases) -> Array:
    """No change of any state, (s, k, n)."""
    return np.zeros((len(points.x), len(cases), points.x.shape[2]))


def scaled_controls(problem: OptimalControlProblem, guesses: Sequence[NodalGuess]) -> Array:
    """û of c guesses at the collocation points, (c, (n − 1) m)."""
    rates = np.stack([g.controls[:, 1:].T for g in guesses])
    limits = [np.broadcast_to(by_case(a.rate_limit)[:, 0], len(rates)) for a in problem.angles]
    return (rates / np.stack(limits, axis=1)[:, None]).reshape(len(rates), -1)
