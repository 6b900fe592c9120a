"""Condensing (`condensing`, Eqs. (1) to (4)) for c cases of a family at once.

The same algebra with one more axis, of cases. Every sum runs within a case, so that no case depends on
its company: the axis of cases is never one of a matrix product's own two.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.state import BANK, CORE, LONGITUDE, N_CORE, N_STATES
from ampi.pseudospectral.mesh import Segment
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.tracing.derivatives import trace
from ampi.tracing.node_functions import NodeFunctions
from ampi.tracing.vectorised import VectorisedFunction

Array = NDArray[np.float64]
Entries = dict[
    tuple[int, int], Array
]  # a sparse matrix at every point: (row, column) → (c, points)

MOVING = (*CORE, BANK)  # the states that enter rates, in the order of Z's rows
TIME = N_STATES  # the column of t among derivatives over (x, t)


@dataclass(frozen=True, eq=False)
class FamilyDynamics:
    """The traced physics, vectorised over points: x (7, points), û and t (1, points)."""

    values: VectorisedFunction  # f, g
    first: VectorisedFunction  # f, ∂f/∂x, ∂f/∂t
    second: VectorisedFunction  # ∂²(μᵀf)/∂(x, t)², with μ (7, points)


def family_dynamics(problem: OptimalControlProblem) -> FamilyDynamics:
    """Traced once per process and model."""
    return _traced(
        problem.model, problem.functions, problem.scaling.states, problem.bank_rate_limit
    )


@lru_cache(maxsize=16)
def _traced(
    model: FlightModel,
    functions: NodeFunctions,
    state_scale: tuple[float, ...],
    rate_scale: float,
) -> FamilyDynamics:
    traced = trace(model, functions, state_scale, rate_scale)
    x, u, t, f = traced.x, traced.u, traced.t, ca.densify(traced.f)
    mu = ca.SX.sym("mu", N_STATES)
    hessian = ca.hessian(ca.dot(mu, f), ca.vertcat(x, t))[0]
    return FamilyDynamics(
        VectorisedFunction([x, u, t], [f, ca.densify(traced.g)]),
        VectorisedFunction([x, u, t], [f, traced.jacobian, ca.jacobian(f, t)]),
        VectorisedFunction([x, u, t, mu], [hessian]),
    )


@dataclass(frozen=True, eq=False)
class CondensedFamily:
    """Z of every case and the factors that made it."""

    problem: OptimalControlProblem  # any of the family
    transcription: RadauTranscription
    half: Array  # h, (c, n − 1)
    stretched: Entries  # h ∂f/∂x at the collocation points
    time_derivative: Array  # ∂f/∂t, (7, c, n − 1)
    factors: tuple[tuple[tuple[Array, Array], ...], ...]  # LU, pivots by segment and case
    moving: Array  # Z of the moving states, (c, n, 6, n_z)
    along: Array  # rows over z whose running integral is Z of the longitude, (c, n − 1, n_z)

    @property
    def final_map(self) -> Array:
        """Z of all states at the last node, (c, 7, n_z)."""
        final = np.empty((len(self.moving), N_STATES, self.moving.shape[3]))
        final[:, MOVING] = self.moving[:, -1]
        final[:, LONGITUDE] = (self.transcription.integration[-1:] @ self.along)[:, 0]
        return final

    def change(self, z: Array, cases: NDArray[np.intp]) -> Array:
        """Z z, (7, k, n), of z (k, n_z) of `cases`."""
        n = self.moving.shape[1]
        found = np.zeros((N_STATES, len(cases), n))
        for k, case in enumerate(cases):
            found[list(MOVING), k] = (self.moving[case] @ z[k]).T
            found[LONGITUDE, k, 1:] = self.transcription.integration @ (self.along[case] @ z[k])
        return found

    def correction(self, residual: Array, cases: NDArray[np.intp]) -> Array:
        """Change (c, n − 1, 7) at fixed entry state, u and t_f that cancels `residual` of `cases`."""
        integration = self.transcription.integration
        change = np.empty_like(residual)
        change[:, :, BANK] = -_integrated(integration, residual[:, :, BANK])
        right = -residual[:, :, CORE]
        for i, state in enumerate(CORE):
            if (state, BANK) in self.stretched:
                right[:, :, i] += self.stretched[state, BANK][cases] * change[:, :, BANK]
        start = np.zeros((len(right), N_CORE))
        for s, factors in zip(self.transcription.mesh.segments, self.factors, strict=True):
            here = right[:, s.collocation] - s.rule.derivative[:, :1] * start[:, None]
            for k, case in enumerate(cases):
                solution = dgetrs(*factors[case], here[k].ravel())[0]
                right[k, s.collocation] = solution.reshape(-1, N_CORE)
            start = right[:, s.collocation.stop - 1]
        change[:, :, CORE] = right
        along = -residual[:, :, LONGITUDE]
        for state in MOVING:
            if (LONGITUDE, state) in self.stretched:
                along = along + self.stretched[LONGITUDE, state][cases] * change[:, :, state]
        change[:, :, LONGITUDE] = _integrated(integration, along)
        return change

    def multipliers(
        self, final_gradient: Array, cases: NDArray[np.intp], along: Array | None = None
    ) -> Array:
        """μ (7, k, n − 1) of `cases` from the cost's gradient over the final states (k, 7).

        `along` (k, n − 1, 6) is the gradient over the moving states on the way, if there is one.
        """
        integration, mesh = self.transcription.integration, self.transcription.mesh
        points = self.half.shape[1]
        mu = np.empty((N_STATES, len(cases), points))
        mu[LONGITUDE] = -integration[-1] * final_gradient[:, LONGITUDE, None]
        right = np.zeros((len(cases), points, len(MOVING))) if along is None else -along
        for i, state in enumerate(MOVING):
            if (LONGITUDE, state) in self.stretched:
                right[:, :, i] += self.stretched[LONGITUDE, state][cases] * mu[LONGITUDE]
        right[:, -1] -= final_gradient[:, MOVING]
        carried = np.zeros((len(cases), N_CORE))
        core = right[:, :, :N_CORE]
        for s, factors in reversed(list(zip(mesh.segments, self.factors, strict=True))):
            core[:, s.collocation.stop - 1] -= carried
            for k, case in enumerate(cases):
                solution = dgetrs(*factors[case], core[k, s.collocation].ravel(), trans=1)[0]
                core[k, s.collocation] = solution.reshape(-1, N_CORE)
            carried = s.rule.derivative[:, 0] @ core[:, s.collocation]
        mu[list(CORE)] = core.transpose(2, 0, 1)
        on_bank = right[:, :, N_CORE]
        for i, state in enumerate(CORE):
            if (state, BANK) in self.stretched:
                on_bank = on_bank + self.stretched[state, BANK][cases] * core[:, :, i]
        mu[BANK] = _integrated(integration.T, on_bank)
        return mu

    def projected(self, gradient: Array, cases: NDArray[np.intp]) -> Array:
        """Zᵀ of a gradient over the moving states at the points (k, n − 1, 6) of `cases`: (k, n_z)."""
        n_z = self.moving.shape[3]
        found = np.empty((len(cases), n_z))
        for k, case in enumerate(cases):
            found[k] = gradient[k].ravel() @ self.moving[case, 1:].reshape(-1, n_z)
        return found


@dataclass(frozen=True, eq=False)
class FamilyCurvature:
    """∇²L of the dynamics' part of the Lagrangian, μᵀR; t_f is the scaled one."""

    linear: CondensedFamily
    over_states: Array  # of the moving states at every point, (c, n − 1, 6, 6)
    states_time: Array  # ∂²/∂x∂t_f, (c, n − 1, 6)
    control_time: Array  # ∂²/∂u∂t_f, (c, n − 1)
    over_time: Array  # ½ ∂²/∂t_f², (c,)

    @classmethod
    def of(cls, linear: CondensedFamily, curvature: Entries, mu: Array) -> FamilyCurvature:
        """`curvature` is that of −h μᵀf over (x, t)."""
        t, scale = linear.transcription, linear.problem.scaling.final_time
        cases, points = linear.half.shape
        over_states = np.zeros((cases, points, len(MOVING), len(MOVING)))
        by_time = np.zeros((cases, points, len(MOVING)))
        twice = np.zeros((cases, points))
        for (row, column), values in curvature.items():
            if row in MOVING and column in MOVING:
                over_states[:, :, MOVING.index(row), MOVING.index(column)] = values
            elif row in MOVING and column == TIME:
                by_time[:, :, MOVING.index(row)] = values
            elif row == column == TIME:
                twice = values
        step = t.node_free[1:] * scale  # of the node's time per δt_f
        # what multiplies δt_f: W_xt of the nodes that move with it, and h(t_f) in −h μᵀ A δx
        stretch = -(t.half_free * scale) / linear.half
        states_time = by_time * step[:, None]
        for (row, column), values in linear.stretched.items():
            states_time[:, :, MOVING.index(column)] += stretch * values * mu[row]
        grown = -(t.half_free * scale) * mu
        along = np.zeros((cases, points))
        for state in range(N_STATES):
            along = along + grown[state] * linear.time_derivative[state]
        own = along * step + 0.5 * twice * step**2
        control_time = grown[BANK] * linear.problem.bank_rate_limit
        return cls(linear, over_states, states_time, control_time, own.sum(axis=1))

    def reduced(self) -> Array:
        """Condensing's Eq. (4), Zᵀ ∇²L Z: (c, n_z, n_z)."""
        cases, points = self.control_time.shape
        inner = self.linear.moving[:, 1:]
        n_z = inner.shape[3]
        hessian = np.zeros((cases, n_z, n_z))
        for s in self.linear.transcription.mesh.segments:
            rows, stop = s.collocation, s.collocation.stop
            # no later control has any part in these points; the last two columns are t_f's and σ₀'s
            before, last = inner[:, rows, :, :stop], inner[:, rows, :, -2:]
            weight = self.over_states[:, rows]
            transposed = before.reshape(cases, -1, stop).transpose(0, 2, 1)
            side = transposed @ (weight @ last).reshape(cases, -1, 2)
            hessian[:, :stop, :stop] += transposed @ (weight @ before).reshape(cases, -1, stop)
            hessian[:, :stop, -2:] += side
            hessian[:, -2:, :stop] += side.transpose(0, 2, 1)
            ends = last.reshape(cases, -1, 2)
            corner = ends.transpose(0, 2, 1) @ (weight @ last).reshape(cases, -1, 2)
            hessian[:, -2:, -2:] += corner
        flat = inner.reshape(cases, -1, n_z)
        coupling = (self.states_time.reshape(cases, 1, -1) @ flat)[:, 0]
        coupling[:, :points] += self.control_time
        coupling[:, -2] += self.over_time
        hessian[:, -2] += coupling
        hessian[:, :, -2] += coupling
        return np.asarray(hessian)

    def product(self, shift: Array, cases: NDArray[np.intp]) -> Array:
        """Zᵀ ∇²L of a change of the states (k, n − 1, 7) of `cases`: (k, n_z)."""
        moved = shift[:, :, MOVING]
        bent = (self.over_states[cases] @ moved[..., None])[..., 0]
        product = self.linear.projected(bent, cases)
        product[:, -2] += _dots(self.states_time[cases], moved)
        return product

    def bent(self, change: Array, time_change: Array, cases: NDArray[np.intp]) -> Array:
        """∇²L over the moving states of a change of states (k, n − 1, 7) and scaled t_f (k,)."""
        moved = change[:, :, MOVING]
        bent = (self.over_states[cases] @ moved[..., None])[..., 0]
        return np.asarray(bent + self.states_time[cases] * time_change[:, None, None])


def _dots(a: Array, b: Array) -> Array:
    """Inner products (c,) of what is contiguous by case."""
    return np.asarray((a.reshape(len(a), 1, -1) @ b.reshape(len(b), -1, 1))[:, 0, 0])


def condense_family(
    problem: OptimalControlProblem,
    t: RadauTranscription,
    dynamics: FamilyDynamics,
    derivatives: list[Array],
    final_time: Array,
) -> CondensedFamily:
    """Z of every case, from `dynamics.first` at all nodes, case by case, and `final_time` (c,)."""
    cases, n = len(final_time), t.mesh.n_nodes
    n_z = n + 1
    jacobian = derivatives[1]
    half = t.half_fixed + t.half_free * final_time[:, None]
    stretched = {
        entry: half * row.reshape(cases, n)[:, 1:]
        for entry, row in zip(dynamics.first.nonzeros[1], jacobian, strict=True)
    }
    time_derivative, by_time = with_final_time(t, dynamics, derivatives, half)
    by_time *= problem.scaling.final_time

    moving = np.zeros((cases, n, len(MOVING), n_z))
    bank = moving[:, :, N_CORE]
    bank[:, :, -1] = 1.0
    bank[:, 1:, :-2] = t.integration * (half * problem.bank_rate_limit)[:, None]
    bank[:, 1:, -2] = _integrated(t.integration, by_time[BANK])
    factors = []
    for s, derivative in zip(t.mesh.segments, t.core_derivative, strict=True):
        rows = s.collocation
        after = slice(rows.start + 1, rows.stop + 1)
        factored = _factored(derivative, stretched, rows, cases)
        right = _right_sides(s, stretched, bank, by_time)
        solved = right.reshape(cases, right.shape[1], -1)
        for case, factor in enumerate(factored):
            solved[case] = dgetrs(*factor, solved[case].T, overwrite_b=1)[0].T
        # of the controls before this segment, its own, t_f and σ₀; no later one has any part in it
        start, block = moving[:, rows.start], moving[:, after, :N_CORE]
        carried = solved[:, : N_CORE + 1].transpose(0, 2, 1)
        shape = (cases, rows.stop - rows.start, N_CORE, -1)
        if rows.start:
            block[..., : rows.start] = (carried @ start[:, :, : rows.start]).reshape(shape)
        block[..., rows] = solved[:, N_CORE + 1 : -1].transpose(0, 2, 1).reshape(shape)
        block[..., -2:] = (carried @ start[:, :, -2:]).reshape(shape)
        block[..., -2] += solved[:, -1].reshape(shape[:3])
        factors.append(factored)
    turning = np.zeros((cases, n - 1, 1, len(MOVING)))
    for i, state in enumerate(MOVING):
        if (LONGITUDE, state) in stretched:
            turning[:, :, 0, i] = stretched[LONGITUDE, state]
    along = (turning @ moving[:, 1:])[:, :, 0]
    along[:, :, -2] += by_time[LONGITUDE]
    return CondensedFamily(
        problem, t, half, stretched, time_derivative, tuple(factors), moving, along
    )


def with_final_time(
    t: RadauTranscription, dynamics: FamilyDynamics, derivatives: list[Array], half: Array
) -> tuple[Array, Array]:
    """∂f/∂t and ∂(h f)/∂t_f at the collocation points, (7, c, n − 1), from `dynamics.first`."""
    cases, points = half.shape
    f, _, over_time = derivatives
    time_derivative = np.zeros((N_STATES, cases, points))
    for (state, _), row in zip(dynamics.first.nonzeros[2], over_time, strict=True):
        time_derivative[state] = row.reshape(cases, -1)[:, 1:]
    by_time = t.half_free * f.reshape(N_STATES, cases, -1)[:, :, 1:]
    by_time += half * t.node_free[1:] * time_derivative
    return time_derivative, by_time


def _right_sides(s: Segment, stretched: Entries, bank: Array, by_time: Array) -> Array:
    """Right sides of condensing's Eq. (2) on a segment, by columns: (c, columns, degree, 5).

    The columns: start of the core, start of the bank angle, δu of this segment, δt_f.
    """
    cases, count, rows = len(bank), s.rule.degree, s.collocation
    after = slice(rows.start + 1, rows.stop + 1)
    by_bank = np.zeros((cases, count, N_CORE))
    for i, state in enumerate(CORE):
        if (state, BANK) in stretched:
            by_bank[:, :, i] = stretched[state, BANK][:, rows]
    right = np.zeros((cases, N_CORE + 1 + count + 1, count, N_CORE))
    for i in range(N_CORE):
        right[:, i, :, i] = -s.rule.derivative[:, 0]
    right[:, N_CORE] = by_bank
    inside = bank[:, after] - bank[:, rows.start, None]
    right[:, N_CORE + 1 : -1] = inside[:, :, rows].transpose(0, 2, 1)[..., None] * by_bank[:, None]
    right[:, -1] = by_time[list(CORE)][:, :, rows].transpose(1, 2, 0)
    right[:, -1] += inside[:, :, -2, None] * by_bank
    return right


def _factored(
    derivative: Array, stretched: Entries, rows: slice, cases: int
) -> tuple[tuple[Array, Array], ...]:
    """LU and pivots of D⊗I₅ − h A_cc of one segment, by case; singular ones give what is not finite."""
    size = len(derivative)
    transposed = np.broadcast_to(derivative.T, (cases, size, size)).copy()
    blocks = transposed.reshape(cases, size // N_CORE, N_CORE, size // N_CORE, N_CORE)
    diagonal = np.einsum("ckjki->ckji", blocks)
    for i, row in enumerate(CORE):
        for j, column in enumerate(CORE):
            if (row, column) in stretched:
                diagonal[:, :, j, i] -= stretched[row, column][:, rows]
    found = (dgetrf(matrix.T, overwrite_a=1) for matrix in transposed)
    return tuple((lu, pivots) for lu, pivots, _ in found)


def _integrated(integration: Array, rates: Array) -> Array:
    """Running integrals (c, n − 1) of `rates` (c, n − 1), case by case."""
    return np.asarray((integration @ rates[:, :, None])[:, :, 0])
