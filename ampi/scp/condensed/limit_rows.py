"""The inequalities of c cases as rows over z, and which of them hold a step.

    lower ≤ value + row·z ≤ upper                                                (1)

in the order rates at the nodes (the controls of a node side by side), each steered angle at the nodes,
each between them, each path limit at the nodes, target rows that are ranges. Rows of matrices are made
of those alone that are held; where a step leads all others follows from the change of the states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, N_CORE
from ampi.scp.condensed.condensing import Cases, CondensedDynamics
from ampi.scp.problem.scaled_problem import OptimalControlProblem, Target, by_case

Array = NDArray[np.float64]
Sides = NDArray[np.int8]  # (c, rows): +1 held at the upper bound, −1 at the lower, 0 not held

FEASIBLE = 1e-9  # beyond its bound by less, a row counts as inside


def n_rows(problem: OptimalControlProblem, between: int) -> int:
    """How many rows a case has."""
    n, m = problem.mesh.n_nodes, problem.n_controls
    return m * (2 * n + between) + problem.n_limits * n + len(problem.target.ranged)


@dataclass(frozen=True, eq=False)
class LimitRows:
    """Eq. (1) at the points where `condensed` was made."""

    problem: OptimalControlProblem
    condensed: CondensedDynamics
    path_gradient: Array  # ∂g/∂(x, t), (limits, c, n, s + 1)
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
        one = np.ones((cases, problem.n_controls * n))
        path = np.ones((cases, problem.n_limits * n))
        low, high = (
            [
                np.broadcast_to(by_case(getattr(angle, side)), (cases, width))
                for width in (n, len(between))
                for angle in problem.angles
            ]
            for side in ("lower", "upper")
        )
        span = (cases, len(ranged))
        least = np.broadcast_to(target.lower[..., ranged], span)
        greatest = np.broadcast_to(target.upper[..., ranged], span)
        return cls(
            problem,
            condensed,
            np.stack(gradients),
            lower=np.concatenate([-one, *low, np.full_like(path, -np.inf), least], axis=1),
            upper=np.concatenate([one, *high, path, greatest], axis=1),
        )

    def value(self, target: Target, x: Array, rate: Array, path: Array) -> Array:
        """Values (k, rows) at states (s, k, n), û (k, n m), g (limits, k, n); `target` of the cases."""
        final = target.error(x[:, :, -1].T)[:, target.ranged]
        by_limit = path.transpose(1, 0, 2).reshape(x.shape[1], -1)
        return np.concatenate([rate, *self._of_angles(x), by_limit, final], axis=1)

    def _of_angles(self, x: Array) -> list[Array]:
        """Of states (s, k, n) the steered angles at the nodes, then between them."""
        t, angles = self.condensed.transcription, list(x[BANK:])
        return angles + [(t.between @ angle[:, :, None])[:, :, 0] for angle in angles]

    def moved(self, change: Array, rate: Array, time_change: Array, cases: Cases) -> Array:
        """What a change of states (s, k, n), û (k, n m) and scaled t_f (k,) adds to the values."""
        t, target = self.condensed.transcription, self.problem.target
        gradient = self.path_gradient[:, cases]
        path = (gradient[..., :-1] * change.transpose(1, 2, 0)).sum(axis=3)
        step = t.node_free * self.condensed.final_time_scale
        path += gradient[..., -1] * step * time_change[:, None]
        final = change[:, :, -1].T[:, target.state[target.ranged]]
        by_limit = path.transpose(1, 0, 2).reshape(change.shape[1], -1)
        return np.concatenate([rate, *self._of_angles(change), by_limit, final], axis=1)

    def matrix(self, case: int, held: NDArray[np.intp]) -> Array:
        """The rows `held` of one case over z, (r, n_z)."""
        t, condensed, target = self.condensed.transcription, self.condensed, self.problem.target
        n, m = t.mesh.n_nodes, condensed.n_controls
        widths = [m * n, *[n] * m, *[len(t.between)] * m, self.problem.n_limits * n]
        firsts = np.cumsum([0, *widths])
        on_rate, *on_angles, on_path, on_final = (
            held[(held >= first) & (held < last)] - first
            for first, last in zip(firsts, [*firsts[1:], np.inf], strict=True)
        )
        angles = [condensed.moving[case, :, N_CORE + k] for k in range(m)]
        at_nodes = [angle[rows] for angle, rows in zip(angles, on_angles[:m], strict=True)]
        between = [t.between[rows] @ a for a, rows in zip(angles, on_angles[m:], strict=True)]
        limit, node = np.divmod(on_path, n)
        path = condensed.rows(case, node, self.path_gradient[limit, case, node])
        final = condensed.final_map[case, target.state[target.ranged[on_final]]]
        return np.concatenate([self._rate_rows(on_rate), *at_nodes, *between, path, final])

    def _rate_rows(self, held: NDArray[np.intp]) -> Array:
        """û at the nodes over z, of those rows."""
        entry, m = self.condensed.transcription.entry_rate, self.condensed.n_controls
        rows = np.zeros((len(held), self.condensed.n_variables))
        rows[held >= m, held[held >= m] - m] = 1.0
        for k in range(m):
            rows[held == k, k : m * len(entry) : m] = entry
        return rows

    def node_gradient(self, multipliers: Array, path_gradient: Array) -> tuple[Array, Array]:
        """What multipliers (k, rows) of Eq. (1) give in the Lagrangian's gradient.

        Over the states after the first node (k, n − 1, s), and over the times of the nodes (k, n), with
        ∂g/∂(x, t) (limits, k, n, s + 1) at the points in question. What `on_control` gives is not among
        them.
        """
        gradient = np.einsum("kmn,mkni->kni", self._on_path(multipliers), path_gradient)
        for k, on_angle in enumerate(self._on_angles(multipliers)):
            gradient[:, :, BANK + k] += on_angle
        ranged = self.problem.target.ranged
        states = self.problem.target.state[ranged]
        gradient[:, -1, states] += multipliers[:, multipliers.shape[1] - len(ranged) :]
        return gradient[:, 1:, :-1], gradient[:, :, -1]

    def _on_path(self, multipliers: Array) -> Array:
        """Those of the path limits, (k, limits, n)."""
        n, limits = self.problem.mesh.n_nodes, self.problem.n_limits
        first = self.condensed.n_controls * (2 * n + len(self.condensed.transcription.between))
        return multipliers[:, first : first + limits * n].reshape(-1, limits, n)

    def path_multipliers(self, multipliers: Array) -> Array:
        """Those of the path limits at the nodes after the first, (limits, k, n − 1)."""
        return np.ascontiguousarray(self._on_path(multipliers).transpose(1, 0, 2)[:, :, 1:])

    def on_control(self, multipliers: Array, path_gradient: Array) -> Array:
        """Those of the rows on û and on what is free at the entry, as a gradient over z, (k, n_z).

        Path limits there know nothing of the bank angle, but of the angle of attack.
        """
        t, n, m = self.condensed.transcription, self.problem.mesh.n_nodes, self.condensed.n_controls
        gradient = np.zeros((len(multipliers), self.condensed.n_variables))
        gradient[:, : m * (n - 1)] = multipliers[:, m : m * n]
        for k, on_angle in enumerate(self._on_angles(multipliers)):
            entry = slice(k, m * len(t.entry_rate), m)
            gradient[:, entry] += multipliers[:, k : k + 1] * t.entry_rate
            if self.problem.angles[k].entry is None:
                gradient[:, k - m] = on_angle[:, 0]
                if k:
                    on_path, by_angle = self._on_path(multipliers), path_gradient[..., BANK + k]
                    gradient[:, k - m] += (on_path[:, :, 0] * by_angle[:, :, 0].T).sum(axis=1)
        return gradient

    def _on_angles(self, multipliers: Array) -> list[Array]:
        """Those of each steered angle as a gradient over it at the nodes, (k, n) each."""
        t, n, m = self.condensed.transcription, self.problem.mesh.n_nodes, self.condensed.n_controls
        at_nodes, b = m * n, len(t.between)
        inside, found = 2 * m * n, []
        for k in range(m):
            between = multipliers[:, None, inside + k * b : inside + (k + 1) * b]
            own = multipliers[:, at_nodes + k * n : at_nodes + (k + 1) * n]
            found.append(np.asarray(own + (between @ t.between)[:, 0]))
        return found


def following(side: Sides, multipliers: Array, value: Array, lower: Array, upper: Array) -> Sides:
    """Which rows hold the next step (k, rows): those that keep their sign, and the violated ones.

    A semi-smooth Newton method on the conditions of complementarity (Hintermüller, Ito, Kunisch 2003).
    """
    above = (value > upper + FEASIBLE) | ((side > 0) & (multipliers > 0.0))
    below = (value < lower - FEASIBLE) | ((side < 0) & (multipliers < 0.0))
    return np.asarray(above.astype(np.int8) - below.astype(np.int8))
