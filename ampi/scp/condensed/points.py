"""Where c cases stand: states, control and final time, and what follows from them at the nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, N_STATES
from ampi.scp.condensed.condensing import Cases, CondensedDynamics, NodeDerivatives, condense
from ampi.scp.condensed.cost import smooth_cost
from ampi.scp.condensed.transcription import RadauTranscription, radau_transcription
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
    x: Array  # (7, c, n)
    u: Array  # û at the collocation points, (c, n − 1)
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
        rate = np.stack([g.bank_rate[1:] for g in guesses]) / by_case(problem.bank_rate_limit)
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
        if self.problem.entry_bank_angle is not None:
            self.x[BANK, :, 0] = self.problem.entry_bank_angle

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
        """û at all nodes, (k, n)."""
        return self.transcription.nodal_rate(self.u[cases])

    def evaluate(
        self, function: NodeFunction, cases: Cases, *weights: Array, first: int = 0
    ) -> list[Array]:
        """A traced function at the nodes of `cases` from `first` on."""
        times = self.transcription.times(self.final_time[cases])
        x, rate, numbers = self.x[:, cases, first:], self.rate(cases), self.problem.numbers
        evaluate = function.one_by_one if self.one_by_one else function.together
        return evaluate(x, rate[:, first:], times[:, first:], at_cases(numbers, cases), *weights)

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
            rate_scale=by_case(problem.bank_rate_limit),
            final_time_scale=problem.scaling.final_time,
            entry_bank_is_free=problem.entry_bank_angle is None,
        )

    def shift(self, condensed: CondensedDynamics, rates: Array, cases: Cases) -> Array:
        """c of `cases`, what the states miss of flying (k, n − 1, 7), with f (7, k, n)."""
        x, final_time = self.x[:, cases], self.final_time[cases]
        return condensed.correction(self.transcription.residual(x, rates, final_time), cases)

    def errors(self, cases: Cases, shift: Array) -> Array:
        """Of the rows that always hold after `shift`, (k, r): target rows, a given bank rate."""
        problem, held = self.problem, self.problem.target.held
        target = problem.at(cases).target
        error = target.error(self.x[:, cases, -1].T)[:, held] + shift[:, -1, target.state[held]]
        if problem.entry_bank_rate is None:
            return np.asarray(error)
        given = by_case(problem.at(cases).entry_rate)
        return np.concatenate([error, self.rate(cases)[:, :1] - given], axis=1)

    def take(self, cases: Cases, z: Array, change: Array, shift: Array) -> Array:
        """Move `cases` by z, `change` = Z z and c; the size of the step, ‖(δσ, δt_f)‖_∞, (k,)."""
        change[:, :, 1:] += shift.transpose(2, 0, 1)
        self.x[:, cases] += change
        self.u[cases] += z[:, :-2]
        self.final_time[cases] += z[:, -2] * self.problem.scaling.final_time
        return np.maximum(np.abs(change[BANK]).max(axis=1), np.abs(z[:, -2]))

    def cost(self, cases: Cases) -> Array:
        """In the mission's units, (k,)."""
        problem = self.problem.at(cases)
        integrands = self.functions[problem.n_limits :, cases]
        total = smooth_cost(
            problem, self.transcription, self.u[cases], self.final_time[cases], integrands
        )
        error = problem.target.error(self.x[:, cases, -1].T)
        total = total + problem.target.quadratic(error)
        return np.asarray(total * by_case(problem.objective.cost_scale)[:, 0])

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Go on with these cases."""
        self.problem = self.problem.at(np.flatnonzero(chosen))
        self.x, self.functions = self.x[:, chosen], self.functions[:, chosen]
        self.u, self.final_time = self.u[chosen], self.final_time[chosen]


def zero_states(points: Points, cases: Cases) -> Array:
    """No change of any state, (7, k, n)."""
    return np.zeros((N_STATES, len(cases), points.x.shape[2]))
