"""The Hessian of the Lagrangian L = J + Σ μᵀR + Σ νᵀg, reduced to z, for c cases at once.

    H = Zᵀ ∇²L Z = Σ_i J_iᵀ W_i J_i + r eᵀ + e rᵀ + terms in û,                  (1)

J_i = [Z_i; b_i eᵀ] the map of z to (x, t) at node i, e the unit vector of δt_f, W_i the Hessian of
−h μᵀf + νᵀg + ωᵀL over (x, t), L the integrands of the cost with multipliers ω, and r the coupling of
t_f through h(t_f): r = Σ (β/h) [−h μᵀ(A δx + B δu + b f_t δt_f) + ωᵀ(L_x δx + b L_t δt_f)]. The terms in
û and in the final state are those of the cost (cost). The first node has no part in it: its state is
given, but for the bank angle, which no limit and no integrand knows, and a free angle of attack, whose
limits there enter by their gradients alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, LONGITUDE
from ampi.scp.condensed.condensing import Cases, CondensedDynamics
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.scp.problem.scaled_problem import OptimalControlProblem, by_case
from ampi.tracing.dynamics import Entries

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CurvatureSettings:
    """Relative to the mean curvature of the reference effort over δu."""

    floor: float = 1e-3  # least eigenvalue kept by the convexification
    free_variables: float = 10.0  # Gauss–Newton curvature given to δt_f and δy₀
    no_effort: float = 1e-2  # Gauss–Newton curvature given to δu, at least
    screening: float = 0.6  # path rows enter the subproblem where g exceeds this
    bank_screening: float = 0.85  # rows between the nodes where the bank angle exceeds this share
    kink: float = 0.999  # an absolute value is held at zero below this share of its weight


def reference_curvature(
    problem: OptimalControlProblem, t: RadauTranscription, final_time: Array
) -> Array:
    """Curvature over δu (c, (n − 1) m) that an effort worth the whole objective would have."""
    by_control = [
        2.0 * by_case(weight) * t.half_lengths(final_time) * t.weights
        for weight in problem.objective.reference_effort
    ]
    return np.stack(by_control, axis=2).reshape(len(final_time), -1)


def gauss_newton(
    problem: OptimalControlProblem,
    t: RadauTranscription,
    final_time: Array,
    settings: CurvatureSettings,
) -> Array:
    """The diagonal of Gauss–Newton's model, (c, n_z): the effort's curvature, or a little of it."""
    reference, objective = reference_curvature(problem, t, final_time), problem.objective
    m = problem.n_controls
    efforts = zip(objective.effort, objective.reference_effort, strict=True)
    own = [np.broadcast_to(by_case(e / r), (len(reference), 1)) for e, r in efforts]
    share = np.maximum(np.concatenate(own, axis=1), settings.no_effort)
    free = settings.free_variables * reference.mean(axis=1, keepdims=True)
    on_rates = (share[:, None] * reference.reshape(len(reference), -1, m)).reshape(reference.shape)
    return np.concatenate([on_rates, share[:, :1] * free, share * free], axis=1)


def hold_given_angles(hessian: Array, problem: OptimalControlProblem) -> None:
    """Add to H (c, n_z, n_z): δy₀ of an angle that is given moves nothing, and is to be zero."""
    m = problem.n_controls
    for k, angle in enumerate(problem.angles):
        if angle.entry is not None:
            hessian[:, k - m, k - m] += 1.0


@dataclass(frozen=True, eq=False)
class Curvature:
    """∇²L without the terms in û; t_f is the scaled one.

    `states` are those that it knows: the moving ones, and the longitude where there are no-fly zones.
    """

    condensed: CondensedDynamics
    states: tuple[int, ...]
    over_states: Array  # at every point after the first node, (c, n − 1, s, s)
    states_time: Array  # ∂²/∂x∂t_f, (c, n − 1, s)
    control_time: Array  # ∂²/∂u∂t_f, (c, (n − 1) m)
    over_time: Array  # ½ ∂²/∂t_f², (c,)

    @classmethod
    def of(
        cls,
        condensed: CondensedDynamics,
        second: Entries,
        mu: Array,
        running: Array | None = None,
    ) -> Curvature:
        """From W (`second`, over (x, t) at the points) and μ (s, c, n − 1).

        `running` (c, n − 1, s + 1) is ωᵀ∂L/∂(x, t), if there are integrands.
        """
        t, scale = condensed.transcription, condensed.final_time_scale
        shape, time = condensed.half.shape, condensed.n_states  # the column of t
        states = condensed.states
        if any(LONGITUDE in entry for entry in second):
            states = (*states, LONGITUDE)
        place = {state: k for k, state in enumerate(states)}
        over_states = np.zeros((*shape, len(states), len(states)))
        by_time, twice = np.zeros((*shape, len(states))), np.zeros(shape)
        for (row, column), values in second.items():
            if row in place and column in place:
                over_states[:, :, place[row], place[column]] = values
            elif row in place and column == time:
                by_time[:, :, place[row]] = values
            elif row == column == time:
                twice = values
        step = t.node_free[1:] * scale  # of the node's time per δt_f
        # what multiplies δt_f: W_xt of the nodes that move with it, and h(t_f) in −h μᵀ A δx
        growth = t.half_free * scale
        states_time = by_time * step[:, None]
        for (row, column), values in condensed.jacobian.items():
            states_time[:, :, place[column]] -= growth / condensed.half * values * mu[row]
        at_points = np.zeros(shape)
        for state in range(condensed.n_states):
            at_points = at_points - growth * mu[state] * condensed.time_derivative[state]
        if running is not None:
            relative = (growth / condensed.half)[..., None] * running
            states_time += relative[:, :, list(states)]
            at_points = at_points + relative[:, :, time]
        own = at_points * step + 0.5 * twice * step**2
        rates = enumerate(condensed.rate_scale)
        control_time = np.stack([-growth * mu[BANK + k] * scale for k, scale in rates], axis=2)
        control_time = control_time.reshape(len(own), -1)
        return cls(condensed, states, over_states, states_time, control_time, own.sum(axis=1))

    def reduced(self) -> Array:
        """Eq. (1) without the terms in û, (c, n_z, n_z)."""
        cases, n_u = self.control_time.shape
        m, column = self.condensed.n_controls, self.condensed.time_column
        inner = self.condensed.moving[:, 1:]
        if len(self.states) > inner.shape[2]:
            longitude = self.condensed.longitude_map()[:, :, None]
            inner = np.concatenate([inner, longitude], axis=2)
        n_z = inner.shape[3]
        hessian = np.zeros((cases, n_z, n_z))
        for s in self.condensed.transcription.mesh.segments:
            rows, stop = s.collocation, m * s.collocation.stop
            # no later control has any part in these points; the last columns are t_f's and y₀'s
            before, last = inner[:, rows, :, :stop], inner[:, rows, :, column:]
            weight = self.over_states[:, rows]
            transposed = before.reshape(cases, -1, stop).transpose(0, 2, 1)
            side = transposed @ (weight @ last).reshape(cases, -1, 1 + m)
            hessian[:, :stop, :stop] += transposed @ (weight @ before).reshape(cases, -1, stop)
            hessian[:, :stop, column:] += side
            hessian[:, column:, :stop] += side.transpose(0, 2, 1)
            ends = last.reshape(cases, -1, 1 + m)
            corner = ends.transpose(0, 2, 1) @ (weight @ last).reshape(cases, -1, 1 + m)
            hessian[:, column:, column:] += corner
        flat = inner.reshape(cases, -1, n_z)
        coupling = (self.states_time.reshape(cases, 1, -1) @ flat)[:, 0]
        coupling[:, :n_u] += self.control_time
        coupling[:, column] += self.over_time
        hessian[:, column] += coupling
        hessian[:, :, column] += coupling
        return np.asarray(hessian)

    def product(self, shift: Array, cases: Cases) -> tuple[Array, Array]:
        """∇²L of a change of the states (k, n − 1, s) of `cases`.

        Over the states (k, n − 1, s), still to be projected, and over the scaled t_f (k,).
        """
        moved = shift[:, :, list(self.states)]
        over_states = np.zeros_like(shift)
        over_states[:, :, list(self.states)] = (self.over_states[cases] @ moved[..., None])[..., 0]
        return over_states, _dots(self.states_time[cases], moved)


def _dots(a: Array, b: Array) -> Array:
    """Inner products (c,) of what is contiguous by case."""
    return np.asarray((a.reshape(len(a), 1, -1) @ b.reshape(len(b), -1, 1))[:, 0, 0])
