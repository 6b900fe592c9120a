"""The inequalities of c cases as rows over z, and which of them hold a step.

    lower ≤ value + row·z ≤ upper                                                (1)

in the order bank rate at the nodes, bank angle at the nodes, bank angle between them, each path limit at
the nodes, target rows that are ranges. Rows of matrices are made of those alone that are held; where a
step leads all others follows from the change of the states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, N_CORE, N_STATES
from ampi.scp.condensed.condensing import Cases, CondensedDynamics
from ampi.scp.problem.scaled_problem import OptimalControlProblem, Target, by_case

Array = NDArray[np.float64]
Sides = NDArray[np.int8]  # (c, rows): +1 held at the upper bound, −1 at the lower, 0 not held

FEASIBLE = 1e-9  # beyond its bound by less, a row counts as inside


def n_rows(problem: OptimalControlProblem, between: int) -> int:
    """How many rows a case has."""
    n = problem.mesh.n_nodes
    return 2 * n + between + problem.n_limits * n + len(problem.target.ranged)


@dataclass(frozen=True, eq=False)
class LimitRows:
    """Eq. (1) at the points where `condensed` was made."""

    problem: OptimalControlProblem
    condensed: CondensedDynamics
    path_gradient: Array  # ∂g/∂(x, t), (m, c, n, 8)
    lower: Array  # (c, rows)
    upper: Array  # (c, rows)

    @classmethod
    def of(cls, problem: OptimalControlProblem, condensed: CondensedDynamics) -> LimitRows:
        """From the derivatives in `condensed`."""
        gradients = [condensed.derivatives.gradient_of(k) for k in range(problem.n_limits)]
        cases, n, between = (
            len(condensed.half),
            problem.mesh.n_nodes,
            condensed.transcription.between,
        )
        target, ranged = problem.target, problem.target.ranged
        bank = np.broadcast_to(by_case(problem.bank_limit), (cases, n + len(between)))
        one, path = np.ones((cases, n)), np.ones((cases, problem.n_limits * n))
        span = (cases, len(ranged))
        least = np.broadcast_to(target.lower[..., ranged], span)
        greatest = np.broadcast_to(target.upper[..., ranged], span)
        return cls(
            problem,
            condensed,
            np.stack(gradients),
            lower=np.concatenate([-one, -bank, np.full_like(path, -np.inf), least], axis=1),
            upper=np.concatenate([one, bank, path, greatest], axis=1),
        )

    def value(self, target: Target, x: Array, rate: Array, path: Array) -> Array:
        """Values (k, rows) at states (7, k, n), û (k, n) and g (m, k, n); `target` of those cases."""
        t, bank = self.condensed.transcription, x[BANK]
        between = (t.between @ bank[:, :, None])[:, :, 0]
        final = target.error(x[:, :, -1].T)[:, target.ranged]
        by_limit = path.transpose(1, 0, 2).reshape(len(bank), -1)
        return np.concatenate([rate, bank, between, by_limit, final], axis=1)

    def moved(self, change: Array, rate: Array, time_change: Array, cases: Cases) -> Array:
        """What a change of states (7, k, n), û (k, n) and scaled t_f (k,) adds to the values."""
        t, target, bank = self.condensed.transcription, self.problem.target, change[BANK]
        between = (t.between @ bank[:, :, None])[:, :, 0]
        gradient = self.path_gradient[:, cases]
        path = (gradient[..., :N_STATES] * change.transpose(1, 2, 0)).sum(axis=3)
        step = t.node_free * self.condensed.final_time_scale
        path += gradient[..., N_STATES] * step * time_change[:, None]
        final = change[:, :, -1].T[:, target.state[target.ranged]]
        by_limit = path.transpose(1, 0, 2).reshape(len(bank), -1)
        return np.concatenate([rate, bank, between, by_limit, final], axis=1)

    def matrix(self, case: int, held: NDArray[np.intp]) -> Array:
        """The rows `held` of one case over z, (r, n_z)."""
        t, condensed, target = self.condensed.transcription, self.condensed, self.problem.target
        n, n_z = t.mesh.n_nodes, condensed.n_variables
        firsts = np.cumsum([0, n, n, len(t.between), self.problem.n_limits * n])
        on_rate, on_bank, on_between, on_path, on_final = (
            held[(held >= first) & (held < last)] - first
            for first, last in zip(firsts, [*firsts[1:], np.inf], strict=True)
        )
        rate = np.zeros((len(on_rate), n_z))
        rate[on_rate > 0, on_rate[on_rate > 0] - 1] = 1.0
        rate[on_rate == 0, : len(t.entry_rate)] = t.entry_rate
        bank = condensed.moving[case, :, N_CORE]
        limit, node = np.divmod(on_path, n)
        path = condensed.rows(case, node, self.path_gradient[limit, case, node])
        final = condensed.final_map[case, target.state[target.ranged[on_final]]]
        return np.concatenate([rate, bank[on_bank], t.between[on_between] @ bank, path, final])

    def node_gradient(self, multipliers: Array, path_gradient: Array) -> tuple[Array, Array]:
        """What multipliers (k, rows) of Eq. (1) give in the Lagrangian's gradient.

        Over the states after the first node (k, n − 1, 7), and over the times of the nodes (k, n), with
        ∂g/∂(x, t) (m, k, n, 8) at the points in question. What `on_control` gives is not among them.
        """
        n, b = self.problem.mesh.n_nodes, len(self.condensed.transcription.between)
        m = self.problem.n_limits
        on_path = multipliers[:, 2 * n + b : 2 * n + b + m * n].reshape(-1, m, n)
        gradient = np.einsum("kmn,mkni->kni", on_path, path_gradient)
        gradient[:, :, BANK] += self._on_bank(multipliers)
        ranged = self.problem.target.ranged
        states = self.problem.target.state[ranged]
        gradient[:, -1, states] += multipliers[:, multipliers.shape[1] - len(ranged) :]
        return gradient[:, 1:, :N_STATES], gradient[:, :, N_STATES]

    def path_multipliers(self, multipliers: Array) -> Array:
        """Those of the path limits at the nodes after the first, (m, k, n − 1)."""
        n, b = self.problem.mesh.n_nodes, len(self.condensed.transcription.between)
        m = self.problem.n_limits
        on_path = multipliers[:, 2 * n + b : 2 * n + b + m * n].reshape(-1, m, n)
        return np.ascontiguousarray(on_path.transpose(1, 0, 2)[:, :, 1:])

    def on_control(self, multipliers: Array) -> Array:
        """Those of the rows on û and on the bank angle at the entry, as a gradient over z, (k, n_z)."""
        t, n = self.condensed.transcription, self.problem.mesh.n_nodes
        gradient = np.zeros((len(multipliers), self.condensed.n_variables))
        gradient[:, : n - 1] = multipliers[:, 1:n]
        gradient[:, : len(t.entry_rate)] += multipliers[:, :1] * t.entry_rate
        if self.problem.entry_bank_angle is None:
            gradient[:, -1] = self._on_bank(multipliers)[:, 0]
        return gradient

    def _on_bank(self, multipliers: Array) -> Array:
        """Those of the bank angle as a gradient over it at the nodes, (k, n)."""
        t, n = self.condensed.transcription, self.problem.mesh.n_nodes
        between = multipliers[:, None, 2 * n : 2 * n + len(t.between)]
        return np.asarray(multipliers[:, n : 2 * n] + (between @ t.between)[:, 0])


def following(side: Sides, multipliers: Array, value: Array, lower: Array, upper: Array) -> Sides:
    """Which rows hold the next step (k, rows): those that keep their sign, and the violated ones.

    A semi-smooth Newton method on the conditions of complementarity (Hintermüller, Ito, Kunisch 2003).
    """
    above = (value > upper + FEASIBLE) | ((side > 0) & (multipliers > 0.0))
    below = (value < lower - FEASIBLE) | ((side < 0) & (multipliers < 0.0))
    return np.asarray(above.astype(np.int8) - below.astype(np.int8))
