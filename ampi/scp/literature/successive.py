"""Sequential convex programming as the entry literature does it: linearise, solve, step, compare.

    repeat
        linearise about (x, u, s_f)                     Zhou Eq. 18, Liu Eq. 46, Wang Eq. 27
        convex subproblem under a trust region          Zhou Eq. 38, Liu Eqs. 64–69, Wang P1
        take the whole step
        adapt the mesh, where the method does           Zhou Section 3.2
        or linearise further on, where it relaxes       `acceleration` (ours)
    until the convergence condition holds               Zhou Eqs. 43 or 44, Liu Eq. 70, Wang Eq. 36

There is no merit function and no rejected step. What the methods differ in are the named parts of
`Method`: formulation, transcription, mesh, trust region, penalty, relaxation, convergence test,
refinement.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.acceleration import AitkenRelaxation
from ampi.scp.literature.collocation import Collocation
from ampi.scp.literature.formulation import Formulation, Linearisation, TermKind
from ampi.scp.literature.sparse_subproblem import (
    AbsoluteTerm,
    SparseStep,
    SparseSubproblem,
    TargetRow,
    solve_sparse_subproblem,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StateTrustRegion:
    """|x − x_k| ≤ η Δ, Zhou 2021, Eqs. (29), (34); without a price η = 1, Liu 2015, Eq. (48)."""

    radius: tuple[float, ...]  # Δ per state, SI or rad
    price: float | None = None  # c_η


@dataclass(frozen=True)
class Prices:
    """Exact penalties, in units of the scaled cost."""

    target: tuple[float, ...]  # per state, per SI unit or rad; inf: a hard constraint
    limits: float  # per unit of g, each limit


@dataclass(frozen=True, eq=False)
class Iterate:
    """Scaled states (n, n_x), controls (n, n_u), final value of the independent variable, mesh."""

    mesh: Mesh
    states: Array
    controls: Array
    final: float


@dataclass(frozen=True)
class SubproblemRecord:
    """One row of the log."""

    iteration: int
    nodes: int
    cost: float  # objective of the nonlinear problem, scaled
    quadratic_penalty: float  # ρ
    relaxation: float  # η
    final: float  # s or the final energy
    change: tuple[float, ...]  # greatest change of every state, SI or rad
    target_slack: float
    limit_slack: float
    status: str
    seconds: float  # in the solver
    global_error: tuple[float, ...] = ()  # Δx_f, Zhou Eq. (41), SI or rad


Solver = Callable[[SparseSubproblem], SparseStep]


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearised:
    """What turns an iterate into a convex subproblem: the constants of a method."""

    formulation: Formulation
    trust_region: StateTrustRegion
    prices: Prices
    cost_scale: float  # scaled cost per unit of the mission's cost
    frozen_time: bool = False  # ∫ dτ instead of ∫ dt in the cost: Zhou 2021, Eq. (34)
    final_bounds: tuple[float, float] = (-np.inf, np.inf)
    limit_margin: float = 0.0  # limits are held to 1 − margin
    curved_states: tuple[int, ...] = ()  # along which the Lagrangian's curvature is kept

    def subproblem(
        self,
        rule: Collocation,
        at: Iterate,
        quadratic_penalty: float = 0.0,
        multipliers: Array | None = None,
    ) -> SparseSubproblem:
        """Eq. (1) of `sparse_subproblem` about an iterate.

        `quadratic_penalty` ρ adds ρ mean_i Σ (δx_i / Δ)² to the cost.
        """
        form, x, u = self.formulation, at.states, at.controls
        lin = form.linearise(at.mesh, x, u, at.final)
        n, n_x, n_u = rule.n_nodes, form.n_states, form.n_controls
        width = n * (n_x + n_u) + 1
        radius = np.array(self.trust_region.radius) / form.state_scale
        lower, upper = self._bounds(at, width)
        fixed = np.flatnonzero(np.isfinite(form.entry))
        fixed_change = form.entry[fixed] - x[0, fixed]
        target = []
        for held in form.target:
            price = self.prices.target[held.state] * form.state_scale[held.state]
            least, greatest = held.change(float(x[-1, held.state]))
            if np.isinf(price):
                fixed = np.append(fixed, (n - 1) * n_x + held.state)
                fixed_change = np.append(fixed_change, least)
            else:
                target.append(TargetRow(held.state, least, greatest, price))
        limit_rows, room, kind = _limits(lin, rule, form.final_scale)
        gradient, curvature, absolute = self._cost(lin, rule, at)
        if quadratic_penalty > 0.0:
            curvature[: n * n_x] += np.tile(2.0 * quadratic_penalty / n / radius**2, n)
        if multipliers is not None and self.curved_states:
            curvature[: n * n_x] += self._curvature(rule, at, multipliers).ravel()
        return SparseSubproblem(
            n_nodes=n,
            n_states=n_x,
            n_controls=n_u,
            dynamics=_dynamics(lin, rule, at.final, form),
            residual=rule.residual(x, lin.rates, at.final).ravel(),
            fixed=fixed,
            fixed_change=fixed_change,
            target=tuple(target),
            lower=lower,
            upper=upper,
            trust_radius=radius,
            trust_price=self.trust_region.price,
            limit_rows=limit_rows,
            limit_room=room - self.limit_margin,
            limit_kind=kind,
            n_limits=lin.limits.shape[1],
            limit_price=self.prices.limits,
            gradient=gradient,
            curvature=curvature,
            absolute=absolute,
            states=x,
            controls=u,
            control_cone=form.control_cone,
        )

    def _curvature(self, rule: Collocation, at: Iterate, multipliers: Array) -> Array:
        """∂²L/∂x² (n, n_x) along `curved_states`, where positive; multipliers (m, n_x)."""
        form = self.formulation
        weights = [self._scale(at) * term.weight for term in form.terms]
        w = np.outer(rule.weights(at.final), weights)
        mu = -rule.right.T @ (rule.half_lengths(at.final)[:, None] * multipliers)
        found = form.curvature(at.mesh, at.states, at.controls, at.final, mu, w)
        held = np.isin(np.arange(form.n_states), self.curved_states)
        return np.where(held, np.maximum(found, 0.0), 0.0)

    def cost(self, rule: Collocation, at: Iterate) -> float:
        """The objective of the nonlinear problem at an iterate, scaled."""
        form = self.formulation
        lin = form.linearise(at.mesh, at.states, at.controls, at.final)
        total = form.final_cost * at.final if form.final_is_free else 0.0
        for k, term in enumerate(form.terms):
            value = lin.integrands[:, k]
            value = np.abs(value) if term.kind is TermKind.ABSOLUTE else value
            total += term.weight * float(rule.weights(at.final) @ value)
        return self._scale(at) * total

    def _scale(self, at: Iterate) -> float:
        return self.cost_scale / (at.final if self.frozen_time else 1.0)

    def _bounds(self, at: Iterate, width: int) -> tuple[Array, Array]:
        form, n = self.formulation, len(at.states)
        parts = []
        for k in range(2):
            states = np.tile(form.state_bounds[k], (n, 1)) - at.states
            controls = np.tile(form.control_bounds[k], (n, 1)) - at.controls
            final = (self.final_bounds[k] - at.final) / form.final_scale
            parts.append(np.concatenate([states.ravel(), controls.ravel(), [final]]))
        if not form.final_is_free:
            parts[0][-1] = parts[1][-1] = 0.0
        return parts[0], parts[1]

    def _cost(
        self, lin: Linearisation, rule: Collocation, at: Iterate
    ) -> tuple[Array, Array, tuple[AbsoluteTerm, ...]]:
        form, n = self.formulation, rule.n_nodes
        n_x, n_u = form.n_states, form.n_controls
        width = n * (n_x + n_u) + 1
        gradient, curvature = np.zeros(width), np.zeros(width)
        scale = self._scale(at)
        free = not self.frozen_time and form.final_is_free
        gradient[-1] += form.final_cost * scale * form.final_scale if form.final_is_free else 0.0
        weights, growth = rule.weights(at.final), rule.weight_free * form.final_scale * free
        absolute = []
        for k, term in enumerate(form.terms):
            w, dw = scale * term.weight * weights, scale * term.weight * growth
            value, along_x = lin.integrands[:, k], lin.integrand_state[:, k]
            along_u = lin.integrand_control[:, k]
            if term.kind is TermKind.ABSOLUTE:
                held = np.flatnonzero(w != 0.0)  # the first Radau node has no weight
                rows = _node_rows(w[:, None] * along_x, w[:, None] * along_u, dw * value)
                absolute.append(AbsoluteTerm((w * value)[held], rows[held]))
                continue
            gradient[: n * n_x] += (w[:, None] * along_x).ravel()
            gradient[n * n_x : -1] += (w[:, None] * along_u).ravel()
            gradient[-1] += dw @ value
            if term.kind is TermKind.CONVEX:
                bend = np.maximum(w[:, None] * lin.integrand_curvature[:, k], 0.0)
                curvature[: n * n_x] += bend[:, :n_x].ravel()
                curvature[n * n_x : -1] += bend[:, n_x:].ravel()
        return gradient, curvature, tuple(absolute)


def _node_rows(along_x: Array, along_u: Array, along_s: Array) -> sparse.csr_array:
    """One row a node over (δx, δu, δs)."""
    n = len(along_x)
    return (
        sparse.hstack(
            [
                sparse.block_diag(list(along_x[:, None, :])),
                sparse.block_diag(list(along_u[:, None, :])),
                sparse.csr_array(along_s[:, None]),
            ]
        ).tocsr()
        if n
        else sparse.csr_array((0, 0))
    )


def _blocks(matrices: Array) -> sparse.bsr_array:
    """Block-diagonal of (n, r, c)."""
    n = len(matrices)
    return sparse.bsr_array(
        (matrices, np.arange(n), np.arange(n + 1)),
        shape=(n * matrices.shape[1], n * matrices.shape[2]),
    )


def _dynamics(
    lin: Linearisation, rule: Collocation, final: float, form: Formulation
) -> sparse.csr_array:
    """(D_x, D_u, D_s): derivative of `Collocation`, Eq. (1), with s_j = a_j + b_j s_f."""
    n_x = form.n_states
    half = rule.half_lengths(final)
    eye = sparse.eye_array(n_x)
    right = sparse.kron(sparse.diags_array(half) @ rule.right, eye).tocsr()
    d_x = sparse.kron(rule.left, eye).tocsr() - right @ _blocks(lin.state_jacobian).tocsr()
    d_u = -right @ _blocks(lin.control_jacobian).tocsr()
    _, moving = rule.mesh.node_time
    by_drift = half[:, None] * (rule.right @ (moving[:, None] * lin.drift))
    by_length = rule.half_free[:, None] * (rule.right @ lin.rates)
    d_s = -(by_length + by_drift).reshape(-1, 1) * form.final_scale
    return sparse.hstack([d_x, d_u, sparse.csr_array(d_s)]).tocsr()


def _limits(
    lin: Linearisation, rule: Collocation, final_scale: float
) -> tuple[sparse.csr_array, Array, NDArray[np.intp]]:
    """Linearised limits, Zhou Eq. (30), kind after kind; those far from active are left out."""
    n, kinds = lin.limits.shape
    _, moving = rule.mesh.node_time
    n_u = lin.integrand_control.shape[2]
    nothing = np.zeros((n, n_u))
    rows = [
        _node_rows(lin.limit_jacobian[:, k], nothing, lin.limit_drift[:, k] * moving * final_scale)
        for k in range(kinds)
    ]
    room = 1.0 - lin.limits.T.ravel()
    kind = np.repeat(np.arange(kinds), n)
    return sparse.vstack(rows).tocsr(), room, kind


@dataclass(frozen=True)
class StateChange:
    """max_i |x_i^{k+1} − x_i^k| ≤ ε: Zhou 2021, Eq. (44); Liu 2015, Eq. (70); Wang 2020, Eq. (36)."""

    tolerance: tuple[float, ...]  # ε per state, SI or rad; inf where not asked

    def reached(self, log: list[SubproblemRecord]) -> bool:
        """Whether the last step was small."""
        return bool(np.all(np.array(log[-1].change) <= np.array(self.tolerance)))


@dataclass(frozen=True)
class GlobalErrorChange:
    """|Δx_f^{k+1} − Δx_f^k| ≤ ε with Δx_f the end error of the flight flown again: Zhou, Eq. (43)."""

    tolerance: tuple[float, ...]  # ε per state, SI or rad

    def reached(self, log: list[SubproblemRecord]) -> bool:
        """Whether the end error has settled."""
        if len(log) < 2:
            return False
        n = len(self.tolerance)
        change = np.subtract(log[-1].global_error[:n], log[-2].global_error[:n])
        return bool(np.all(np.abs(change) <= np.array(self.tolerance)))


@dataclass(frozen=True, kw_only=True)
class VariableQuadraticPenalty:
    """A proximal term that comes and goes: Liu et al. 2024, Section 4.3 (its rule is our reading).

    A linearised problem with a fixed trust region may jump between two flights for ever. The sign of
    that is an objective that goes up and down by steps that do not shrink: then ρ appears, and grows
    while it goes on. As soon as the objective is steady ρ falls again, for it slows convergence.
    """

    initial: float = 0.0  # ρ of the first subproblem
    first: float = 0.05  # ρ when it appears, in units of the scaled cost
    grow: float = 4.0
    shrink: float = 0.5
    settled: float = 0.7  # |ΔJ| must fall below this share of the last one to count as shrinking

    def update(self, penalty: float, costs: list[float]) -> float:
        """ρ of the next subproblem from the objectives so far."""
        if len(costs) < 3:
            return penalty
        now, before = costs[-1] - costs[-2], costs[-2] - costs[-3]
        if now * before < 0.0 and abs(now) > self.settled * abs(before):
            return max(self.first, self.grow * penalty)
        return self.shrink * penalty if penalty > 0.01 * self.first else 0.0


Convergence = StateChange | GlobalErrorChange
Adaptation = Callable[[Formulation, Iterate], Iterate]
EndError = Callable[[Formulation, Iterate], Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class Successive:
    """The iteration with all its parts."""

    linearised: Linearised
    transcribe: Callable[[Mesh], Collocation]
    convergence: Convergence
    max_iterations: int
    penalty: VariableQuadraticPenalty | None = None
    relaxation: AitkenRelaxation | None = None  # on a mesh that does not change
    adapt: Adaptation | None = None
    end_error: EndError | None = None
    solver: Solver = solve_sparse_subproblem

    def run(self, start: Iterate) -> Run:
        """Iterate from `start` until convergence, the iteration limit or an unusable step."""
        form, at, log = self.linearised.formulation, start, list[SubproblemRecord]()
        rule = self.transcribe(at.mesh)
        status = "iteration limit"
        quadratic = 0.0 if self.penalty is None else self.penalty.initial
        costs, multipliers = [self.linearised.cost(rule, at)], None
        last, length = None, 1.0
        for iteration in range(1, self.max_iterations + 1):
            problem = self.linearised.subproblem(rule, at, quadratic, multipliers)
            built = time.perf_counter()
            step = self.solver(problem)
            seconds = time.perf_counter() - built
            if not step.usable:
                status = f"subproblem: {step.status}"
                break
            at = Iterate(
                at.mesh,
                at.states + step.states,
                at.controls + step.controls,
                at.final + step.final * form.final_scale,
            )
            multipliers = step.dynamics_multipliers
            costs.append(self.linearised.cost(rule, at))
            error = () if self.end_error is None else tuple(self.end_error(form, at))
            change = np.abs(step.states).max(axis=0) * form.state_scale
            log.append(
                SubproblemRecord(
                    iteration=iteration,
                    nodes=at.mesh.n_nodes,
                    cost=costs[-1],
                    quadratic_penalty=quadratic,
                    relaxation=step.relaxation,
                    final=at.final,
                    change=tuple(change),
                    target_slack=float(step.target_slack.max(initial=0.0)),
                    limit_slack=float(step.limit_slack.max(initial=0.0)),
                    status=step.status,
                    seconds=seconds,
                    global_error=error,
                )
            )
            if self.convergence.reached(log):
                status = "converged"
                break
            if self.penalty is not None:
                quadratic = self.penalty.update(quadratic, costs)
            if self.relaxation is not None and iteration < self.max_iterations:
                in_radii = step.states / problem.trust_radius
                length = self.relaxation.length(in_radii, last, length)
                last, at = in_radii, _further(at, step, length, form)
            if self.adapt is not None and iteration < self.max_iterations:
                adapted = self.adapt(form, at)
                if adapted is not at:
                    at, rule = adapted, self.transcribe(adapted.mesh)
        return Run(at, status, tuple(log))


def _further(at: Iterate, step: SparseStep, length: float, form: Formulation) -> Iterate:
    """`length` of a step of which one was taken; the controls, which may be on their cone, stay."""
    more = length - 1.0
    final = at.final + more * step.final * form.final_scale
    return Iterate(at.mesh, at.states + more * step.states, at.controls, final)


@dataclass(frozen=True, eq=False)
class Run:
    """Where the iteration ended and how it got there."""

    iterate: Iterate
    status: str
    log: tuple[SubproblemRecord, ...]
