"""From an iterate to the convex subproblem about it: what the methods' iterations share.

The objective, the dynamics and the limits of a `Formulation` are linearised at the nodes and transcribed
by a `Collocation`; a method adds its trust region, its prices and what it keeps of the curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.collocation import Collocation
from ampi.scp.literature.formulation import Formulation, Linearisation, TermKind
from ampi.scp.literature.sparse_subproblem import AbsoluteTerm, SparseSubproblem, TargetRow, pick

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StateTrustRegion:
    """|x − x_k| ≤ η Δ, Zhou 2021, Eqs. (29), (34); without a price η = 1, Liu 2015, Eq. (48)."""

    radius: tuple[float, ...]  # Δ per state that there may be, SI or rad
    price: float | None = None  # c_η


@dataclass(frozen=True)
class Prices:
    """Exact penalties, in units of the scaled cost."""

    target: tuple[float, ...]  # per state, per SI unit or rad; inf: a hard constraint
    limits: float  # per unit of g, each limit


@dataclass(frozen=True, eq=False)
class MeshIterate:
    """Scaled states (n, n_x), controls (n, n_u), final value of the independent variable, mesh."""

    mesh: Mesh
    states: Array
    controls: Array
    final: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SubproblemBuilder:
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
        at: MeshIterate,
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
        radius = np.array(self.trust_region.radius[:n_x]) / form.state_scale
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
        limit_rows, room, limit = _limits(lin, rule, form.final_scale)
        gradient, curvature, absolute = self._cost(lin, rule, at)
        if quadratic_penalty > 0.0:
            curvature[: n * n_x] += np.tile(2.0 * quadratic_penalty / n / radius**2, n)
        if multipliers is not None and self.curved_states:
            curvature[: n * n_x] += self._curvature(rule, at, multipliers).ravel()
        prescribed, change = _entry_controls(form, rule, u)
        return SparseSubproblem(
            n_nodes=n,
            n_states=n_x,
            n_controls=n_u,
            dynamics=_dynamics(lin, rule, at.final, form),
            residual=rule.residual(x, lin.rates, at.final).ravel(),
            prescribed=sparse.vstack([pick(fixed, width), *prescribed]).tocsr(),
            prescribed_change=np.append(fixed_change, change),
            target=tuple(target),
            lower=lower,
            upper=upper,
            trust_radius=radius,
            trust_price=self.trust_region.price,
            limit_rows=limit_rows,
            limit_room=room - self.limit_margin,
            limit_index=limit,
            n_limits=lin.limits.shape[1],
            limit_price=self.prices.limits,
            gradient=gradient,
            curvature=curvature,
            absolute=absolute,
            states=x,
            controls=u,
            control_cone=form.control_cone,
        )

    def _curvature(self, rule: Collocation, at: MeshIterate, multipliers: Array) -> Array:
        """∂²L/∂x² (n, n_x) along `curved_states`, where positive; multipliers (m, n_x)."""
        form = self.formulation
        weights = [self._scale(at) * term.weight for term in form.terms]
        w = np.outer(rule.weights(at.final), weights)
        mu = -rule.right.T @ (rule.half_lengths(at.final)[:, None] * multipliers)
        found = form.curvature(at.mesh, at.states, at.controls, at.final, mu, w)
        held = np.isin(np.arange(form.n_states), self.curved_states)
        return np.where(held, np.maximum(found, 0.0), 0.0)

    def cost(self, rule: Collocation, at: MeshIterate) -> float:
        """The objective of the nonlinear problem at an iterate, scaled."""
        form = self.formulation
        lin = form.linearise(at.mesh, at.states, at.controls, at.final)
        total = form.final_cost * at.final if form.final_is_free else 0.0
        for k, term in enumerate(form.terms):
            value = lin.integrands[:, k]
            value = np.abs(value) if term.kind is TermKind.ABSOLUTE else value
            total += term.weight * float(rule.weights(at.final) @ value)
        total += form.terminal(at.states[-1])[0]
        return self._scale(at) * total

    def _scale(self, at: MeshIterate) -> float:
        return self.cost_scale / (at.final if self.frozen_time else 1.0)

    def _bounds(self, at: MeshIterate, width: int) -> tuple[Array, Array]:
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
        self, lin: Linearisation, rule: Collocation, at: MeshIterate
    ) -> tuple[Array, Array, tuple[AbsoluteTerm, ...]]:
        form, n = self.formulation, rule.n_nodes
        n_x, n_u = form.n_states, form.n_controls
        width = n * (n_x + n_u) + 1
        gradient, curvature = np.zeros(width), np.zeros(width)
        scale = self._scale(at)
        free = not self.frozen_time and form.final_is_free
        gradient[-1] += form.final_cost * scale * form.final_scale if form.final_is_free else 0.0
        weights, growth = rule.weights(at.final), rule.weight_free * form.final_scale * free
        gradient[(n - 1) * n_x : n * n_x] += scale * form.terminal(at.states[-1])[1]
        absolute = []
        for k, term in enumerate(form.terms):
            w, dw = scale * term.weight * weights, scale * term.weight * growth
            value, by_state = lin.integrands[:, k], lin.integrand_state[:, k]
            by_control = lin.integrand_control[:, k]
            if term.kind is TermKind.ABSOLUTE:
                held = np.flatnonzero(w != 0.0)  # the first Radau node has no weight
                rows = _node_rows(w[:, None] * by_state, w[:, None] * by_control, dw * value)
                absolute.append(AbsoluteTerm((w * value)[held], rows[held]))
                continue
            gradient[: n * n_x] += (w[:, None] * by_state).ravel()
            gradient[n * n_x : -1] += (w[:, None] * by_control).ravel()
            gradient[-1] += dw @ value
            if term.kind is TermKind.CONVEX:
                convex = np.maximum(w[:, None] * lin.integrand_curvature[:, k], 0.0)
                curvature[: n * n_x] += convex[:, :n_x].ravel()
                curvature[n * n_x : -1] += convex[:, n_x:].ravel()
        return gradient, curvature, tuple(absolute)


def _entry_controls(
    form: Formulation, rule: Collocation, u: Array
) -> tuple[list[sparse.sparray], Array]:
    """Rows over (δx, δu, δs) that hold the controls given at the first node, and their changes."""
    n, n_x, n_u = rule.n_nodes, form.n_states, form.n_controls
    rows: list[sparse.sparray] = []
    change: list[float] = []
    for k in np.flatnonzero(np.isfinite(form.entry_controls)):
        of_controls = np.zeros((len(rule.first_control), n * n_u))
        of_controls[:, k::n_u] = rule.first_control
        nothing = np.zeros((len(of_controls), n * n_x))
        rows.append(sparse.csr_array(np.hstack([nothing, of_controls, nothing[:, :1]])))
        change.extend(form.entry_controls[k] - rule.first_control @ u[:, k])
    return rows, np.array(change)


def _node_rows(by_state: Array, by_control: Array, by_final: Array) -> sparse.csr_array:
    """One row a node over (δx, δu, δs)."""
    n = len(by_state)
    return (
        sparse.hstack(
            [
                sparse.block_diag(list(by_state[:, None, :])),
                sparse.block_diag(list(by_control[:, None, :])),
                sparse.csr_array(by_final[:, None]),
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
    """Linearised limits, Zhou Eq. (30), limit after limit; those far from active are left out."""
    n, limits = lin.limits.shape
    _, moving = rule.mesh.node_time
    n_u = lin.integrand_control.shape[2]
    nothing = np.zeros((n, n_u))
    rows = [
        _node_rows(lin.limit_jacobian[:, k], nothing, lin.limit_drift[:, k] * moving * final_scale)
        for k in range(limits)
    ]
    room = 1.0 - lin.limits.T.ravel()
    limit = np.repeat(np.arange(limits), n)
    return sparse.vstack(rows).tocsr(), room, limit
