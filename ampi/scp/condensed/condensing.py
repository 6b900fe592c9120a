"""Condensing: the linearised dynamics solved for the states, segment by segment, for c cases at once.

Linearising R_s = 0 (transcription, Eq. (1)) at the iterate, with A = ∂f/∂x and t = a + b t_f,

    (D⊗I − h A) δx = −(D₀⊗I) δx_start + h B δu + (β f + h b f_t) δt_f − R      (1)

Some states are quadratures: no state enters σ̇ = u, nor α̇ where the angle of attack is steered, and the
longitude enters no rate. They are running integrals (`RadauTranscription.integration`), the steered
angles y = σ or (σ, α) before and θ after the core of five,

    (D⊗I − h A_cc) δx_c = −(D₀⊗I) δx_c,start + h A_cy δy + (β f_c + h b f_c,t) δt_f − R_c   (2)

whose inverse per segment gives the affine map δx = Z z + c of the free variables

    z = (δu at the collocation points, δt_f, δy₀),                               (3)

the m controls of a point side by side.

The same inverses, transposed and swept backwards, give the multipliers μ of R = 0; with them the
Hessian of the Lagrangian is reduced to z (curvature, Eq. (1)). An inverse costs three times as much as
its factors, but is used a dozen times, and solving with those costs four times as much as its product.

Every sum runs within a case, so that no case depends on its company: the axis of cases is never one of a
matrix product's own two. Arrays of states have their axis first, (s, c, n); residuals have it last.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, CORE, LONGITUDE, N_CORE
from ampi.pseudospectral.mesh import Segment
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.tracing.dynamics import Entries, NodeFunction, entries

Array = NDArray[np.float64]
Cases = NDArray[np.intp]


def moving_states(n_states: int) -> tuple[int, ...]:
    """The states that enter rates, in the order of Z's rows: the core, then the steered angles."""
    return (*CORE, *range(BANK, n_states))


@dataclass(frozen=True, eq=False)
class NodeDerivatives:
    """f and its first derivatives at all nodes; those of limits and integrands where asked for."""

    rates: Array  # f, (s, c, n)
    places: tuple[tuple[int, int], ...]  # (row, column) of the nonzeros of ∂f/∂x, by columns
    jacobian: Array  # ∂f/∂x there, (nonzeros, c, n)
    by_time: Entries  # ∂f/∂t, (row, 0) → (c, n)
    functions: Array | None = None  # (g, L), (m + k, c, n)
    functions_jacobian: Entries | None = None  # over (x, t)

    @classmethod
    def of(cls, function: NodeFunction, outputs: list[Array]) -> NodeDerivatives:
        """From what `NodeDynamics.first` or `first` gave."""
        rates, jacobian, by_time, *functions = outputs
        over_x, over_t = function.nonzeros[1:3]
        found = cls(rates, over_x, jacobian, entries(over_t, by_time))
        if not functions:
            return found
        values, over_xt = functions
        return replace(
            found, functions=values, functions_jacobian=entries(function.nonzeros[4], over_xt)
        )

    def gradient_of(self, row: int) -> Array:
        """∂/∂(x, t) of one limit or integrand at all nodes, (c, n, s + 1)."""
        assert self.functions_jacobian is not None
        found = np.zeros((*self.rates.shape[1:], len(self.rates) + 1))
        for (at, column), values in self.functions_jacobian.items():
            if at == row:
                found[:, :, column] = values
        return found


@dataclass(frozen=True, eq=False)
class CondensedDynamics:
    """Z of every case and the inverses that made it."""

    transcription: RadauTranscription
    derivatives: NodeDerivatives
    half: Array  # h, (c, n − 1)
    scaled: Array  # h ∂f/∂x at the collocation points, (nonzeros, c, n − 1)
    jacobian: Entries  # the same by place
    time_derivative: Array  # ∂f/∂t, (s, c, n − 1)
    inverses: tuple[Array, ...]  # of Eq. (2), (c, 5 N, 5 N) by segment
    moving: Array  # Z of the moving states, (c, n, 5 + m, n_z)
    longitude_rate: (
        Array  # rows over z whose running integral is Z of the longitude, (c, n − 1, n_z)
    )
    final_time_scale: float  # s per unit of z's δt_f
    rate_scale: tuple[Array, ...]  # rad/s per unit of δu, (c, 1) of each control

    @property
    def n_variables(self) -> int:
        """Length of z, Eq. (3)."""
        return int(self.moving.shape[3])

    @cached_property
    def n_states(self) -> int:
        """s: seven, or eight."""
        return len(self.derivatives.rates)

    @cached_property
    def n_controls(self) -> int:
        """m: one, or two."""
        return self.n_states - BANK

    @cached_property
    def states(self) -> tuple[int, ...]:
        """`moving_states`."""
        return moving_states(self.n_states)

    @cached_property
    def time_column(self) -> int:
        """The column of δt_f in z, from behind; those of δy₀ follow."""
        return -1 - self.n_controls

    @property
    def final_map(self) -> Array:
        """Z of all states at the last node, (c, s, n_z)."""
        final = np.empty((len(self.moving), self.n_states, self.n_variables))
        final[:, self.states] = self.moving[:, -1]
        final[:, LONGITUDE] = (self.transcription.integration[-1:] @ self.longitude_rate)[:, 0]
        return final

    def longitude_map(self) -> Array:
        """Z of the longitude at the nodes after the first, (c, n − 1, n_z)."""
        return np.asarray(self.transcription.integration @ self.longitude_rate)

    def change(self, z: Array, cases: Cases) -> Array:
        """Z z, (s, k, n), of z (k, n_z) of `cases`."""
        n, n_z = self.moving.shape[1], self.n_variables
        moving = self._of(cases, self.moving).reshape(len(cases), -1, n_z) @ z[:, :, None]
        rate = (self._of(cases, self.longitude_rate) @ z[:, :, None])[:, :, 0]
        found = np.zeros((self.n_states, len(cases), n))
        found[list(self.states)] = moving.reshape(len(cases), n, len(self.states)).transpose(
            2, 0, 1
        )
        found[LONGITUDE, :, 1:] = _integrated(self.transcription.integration, rate)
        return found

    def _of(self, cases: Cases, values: Array) -> Array:
        """Those of `cases`, in order; of all without a copy."""
        return values if len(cases) == len(values) else values[cases]

    def _cases_of(self, cases: Cases, values: Array) -> Array:
        """The same of an array with another axis before that of cases."""
        return values if len(cases) == values.shape[1] else values[:, cases]

    def _inverses(self, cases: Cases) -> list[Array]:
        return [self._of(cases, inverse) for inverse in self.inverses]

    def correction(self, residual: Array, cases: Cases) -> Array:
        """Change (k, n − 1, s) at fixed entry state, u and t_f that cancels `residual` of `cases`."""
        integration = self.transcription.integration
        change = np.empty_like(residual)
        right = -residual[:, :, CORE]
        for angle in range(BANK, self.n_states):
            change[:, :, angle] = -_integrated(integration, residual[:, :, angle])
            for i, state in enumerate(CORE):
                if (state, angle) in self.jacobian:
                    right[:, :, i] += self.jacobian[state, angle][cases] * change[:, :, angle]
        start = np.zeros((len(right), N_CORE))
        for s, inverse in zip(self.transcription.mesh.segments, self._inverses(cases), strict=True):
            here = right[:, s.collocation] - s.rule.derivative[:, :1] * start[:, None]
            solution = inverse @ here.reshape(len(cases), -1, 1)
            right[:, s.collocation] = solution.reshape(here.shape)
            start = right[:, s.collocation.stop - 1]
        change[:, :, CORE] = right
        rate = -residual[:, :, LONGITUDE]
        for state in self.states:
            if (LONGITUDE, state) in self.jacobian:
                rate = rate + self.jacobian[LONGITUDE, state][cases] * change[:, :, state]
        change[:, :, LONGITUDE] = _integrated(integration, rate)
        return change

    def multipliers(self, gradient: Array, cases: Cases) -> Array:
        """μ (s, k, n − 1) of `cases`: one backward sweep.

        `gradient` (k, n − 1, s) is that of cost, target and limits over the states after the first node.
        """
        integration, mesh = self.transcription.integration, self.transcription.mesh
        mu = np.empty((self.n_states, *gradient.shape[:2]))
        mu[LONGITUDE] = -_integrated(integration.T, gradient[:, :, LONGITUDE])
        right = -gradient[:, :, self.states]
        for i, state in enumerate(self.states):
            if (LONGITUDE, state) in self.jacobian:
                right[:, :, i] += self.jacobian[LONGITUDE, state][cases] * mu[LONGITUDE]
        carried = np.zeros((len(cases), N_CORE))
        core = right[:, :, :N_CORE]
        for s, inverse in reversed(list(zip(mesh.segments, self._inverses(cases), strict=True))):
            core[:, s.collocation.stop - 1] -= carried
            here = core[:, s.collocation]
            solution = here.reshape(len(cases), 1, -1) @ inverse
            core[:, s.collocation] = solution.reshape(here.shape)
            carried = s.rule.derivative[:, 0] @ core[:, s.collocation]
        mu[list(CORE)] = core.transpose(2, 0, 1)
        for k, angle in enumerate(range(BANK, self.n_states)):
            on_angle = right[:, :, N_CORE + k]
            for i, state in enumerate(CORE):
                if (state, angle) in self.jacobian:
                    on_angle = on_angle + self.jacobian[state, angle][cases] * core[:, :, i]
            mu[angle] = _integrated(integration.T, on_angle)
        return mu

    def change_of_transpose(
        self, derivatives: NodeDerivatives, half: Array, mu: Array, cases: Cases
    ) -> Array:
        """(M_new − M)ᵀ μ of `cases`, (k, n − 1, s); M_new is Eq. (1)'s matrix at `derivatives`."""
        grown = half * derivatives.jacobian[:, :, 1:] - self._cases_of(cases, self.scaled)
        rows, columns = np.array(self.derivatives.places).T
        grown *= -mu[rows]
        found = np.zeros((self.n_states, *half.shape))
        present, first = np.unique(columns, return_index=True)
        found[present] = np.add.reduceat(grown, first, axis=0)
        return found.transpose(1, 2, 0)

    def projected(self, gradient: Array, cases: Cases) -> Array:
        """Zᵀ of a gradient over the states after the first node (k, n − 1, s): (k, n_z)."""
        count, n_z = len(cases), self.n_variables
        rows = self._of(cases, self.moving).reshape(count, -1, n_z)[:, len(self.states) :]
        found = gradient[:, :, self.states].reshape(count, 1, -1) @ rows
        on_rate = _integrated(self.transcription.integration.T, gradient[:, :, LONGITUDE])
        found += on_rate[:, None] @ self._of(cases, self.longitude_rate)
        return np.asarray(found[:, 0])

    def rows(self, case: int, node: NDArray[np.intp], gradient: Array) -> Array:
        """Rows over z (r, n_z) of one case: a `gradient` (r, s + 1) over (x, t) at each `node` (r,)."""
        found = np.einsum("ri,riz->rz", gradient[:, self.states], self.moving[case, node])
        on_longitude = gradient[:, LONGITUDE]
        if on_longitude.any():
            integration = self.transcription.integration
            reaching = np.vstack([np.zeros((1, integration.shape[1])), integration])[node]
            found += on_longitude[:, None] * (reaching @ self.longitude_rate[case])
        free = self.transcription.node_free[node] * self.final_time_scale
        found[:, self.time_column] += gradient[:, -1] * free
        return np.asarray(found)


def condense(
    t: RadauTranscription,
    derivatives: NodeDerivatives,
    final_time: Array,
    *,
    rate_scale: tuple[Array, ...],
    final_time_scale: float,
    free_angles: tuple[bool, ...],
) -> CondensedDynamics:
    """Factor Eq. (2) on every segment and build Z, of cases with `final_time` (c,).

    What is not finite, or singular, gives a Z that is not finite. A steered angle that is not free at
    the entry has no column in Z.
    """
    m = len(rate_scale)
    half = t.half_lengths(final_time)
    scaled = half * derivatives.jacobian[:, :, 1:]
    jacobian = entries(derivatives.places, scaled)
    time_derivative, by_time = with_final_time(t, derivatives, half)
    by_time *= final_time_scale

    moving = _steered(t, half, by_time, rate_scale, free_angles)
    time_column, cases = -1 - m, len(half)
    inverses = []
    for s, derivative in zip(t.mesh.segments, t.core_derivative, strict=True):
        rows = s.collocation
        after, own = slice(rows.start + 1, rows.stop + 1), slice(m * rows.start, m * rows.stop)
        inverse = _inverse(derivative, jacobian, rows, cases)
        right = _right_sides(s, jacobian, moving[:, :, N_CORE:], by_time)
        solved = right.reshape(cases, right.shape[1], -1) @ inverse.transpose(0, 2, 1)
        # of the controls before this segment, its own, t_f and y₀; no later one has any part in it
        start, block = moving[:, rows.start], moving[:, after, :N_CORE]
        carried = solved[:, : N_CORE + m].transpose(0, 2, 1)
        shape = (cases, rows.stop - rows.start, N_CORE, -1)
        if rows.start:
            block[..., : own.start] = (carried @ start[:, :, : own.start]).reshape(shape)
        block[..., own] = solved[:, N_CORE + m : -1].transpose(0, 2, 1).reshape(shape)
        block[..., time_column:] = (carried @ start[:, :, time_column:]).reshape(shape)
        block[..., time_column] += solved[:, -1].reshape(shape[:3])
        inverses.append(inverse)
    return CondensedDynamics(
        transcription=t,
        derivatives=derivatives,
        half=half,
        scaled=scaled,
        jacobian=jacobian,
        time_derivative=time_derivative,
        inverses=tuple(inverses),
        moving=moving,
        longitude_rate=_longitude_rate(jacobian, moving, by_time),
        final_time_scale=final_time_scale,
        rate_scale=rate_scale,
    )


def _steered(
    t: RadauTranscription,
    half: Array,
    by_time: Array,
    rate_scale: tuple[Array, ...],
    free_angles: tuple[bool, ...],
) -> Array:
    """Z of the moving states (c, n, 5 + m, n_z) with the rows of the steered angles alone."""
    m, n = len(rate_scale), t.mesh.n_nodes
    moving = np.zeros((len(half), n, N_CORE + m, m * n + 1))
    for k, (scale, is_free) in enumerate(zip(rate_scale, free_angles, strict=True)):
        angle = moving[:, :, N_CORE + k]
        angle[:, :, k - m] = float(is_free)
        # h B: ∂f/∂û is the rate of û = 1, in the row of its angle alone
        angle[:, 1:, k : -1 - m : m] = t.integration * (half * scale)[:, None]
        angle[:, 1:, -1 - m] = _integrated(t.integration, by_time[BANK + k])
    return moving


def _longitude_rate(jacobian: Entries, moving: Array, by_time: Array) -> Array:
    """Rows over z whose running integral is Z of the longitude, (c, n − 1, n_z)."""
    turning = np.zeros((*by_time.shape[1:], 1, moving.shape[2]))
    for i, state in enumerate(moving_states(len(by_time))):
        if (LONGITUDE, state) in jacobian:
            turning[:, :, 0, i] = jacobian[LONGITUDE, state]
    rows = (turning @ moving[:, 1:])[:, :, 0]
    rows[:, :, BANK - 1 - len(by_time)] += by_time[LONGITUDE]
    return np.asarray(rows)


def with_final_time(
    t: RadauTranscription, derivatives: NodeDerivatives, half: Array
) -> tuple[Array, Array]:
    """∂f/∂t and ∂(h f)/∂t_f at the collocation points, (s, c, n − 1)."""
    time_derivative = np.zeros((len(derivatives.rates), *half.shape))
    for (state, _), rows in derivatives.by_time.items():
        time_derivative[state] = rows[:, 1:]
    by_time = t.half_free * derivatives.rates[:, :, 1:]
    by_time += half * t.node_free[1:] * time_derivative
    return time_derivative, by_time


def _right_sides(s: Segment, jacobian: Entries, angles: Array, by_time: Array) -> Array:
    """Right sides of Eq. (2) on a segment, by columns: (c, columns, degree, 5).

    The columns: start of the core, start of the steered angles, δu of this segment, δt_f. `angles` are
    their rows of Z, (c, n, m, n_z).
    """
    cases, count, rows, m = len(angles), s.rule.degree, s.collocation, angles.shape[2]
    after, first = slice(rows.start + 1, rows.stop + 1), N_CORE + m
    right = np.zeros((cases, first + m * count + 1, count, N_CORE))
    for i in range(N_CORE):
        right[:, i, :, i] = -s.rule.derivative[:, 0]
    right[:, -1] = by_time[list(CORE)][:, :, rows].transpose(1, 2, 0)
    for k in range(m):
        by_angle = np.zeros((cases, count, N_CORE))
        for i, state in enumerate(CORE):
            if (state, BANK + k) in jacobian:
                by_angle[:, :, i] = jacobian[state, BANK + k][:, rows]
        right[:, N_CORE + k] = by_angle
        inside = angles[:, after, k] - angles[:, rows.start, None, k]
        own = inside[:, :, m * rows.start + k : m * rows.stop : m].transpose(0, 2, 1)
        right[:, first + k : -1 : m] = own[..., None] * by_angle[:, None]
        right[:, -1] += inside[:, :, -1 - m, None] * by_angle
    return right


def _inverse(derivative: Array, jacobian: Entries, rows: slice, cases: int) -> Array:
    """(D⊗I₅ − h A_cc)⁻¹ of one segment, (c, 5 N, 5 N); of a singular one what is not a number."""
    size = len(derivative)
    matrices = np.broadcast_to(derivative, (cases, size, size)).copy()
    blocks = matrices.reshape(cases, size // N_CORE, N_CORE, size // N_CORE, N_CORE)
    diagonal = np.einsum("ckikj->ckij", blocks)
    for i, row in enumerate(CORE):
        for j, column in enumerate(CORE):
            if (row, column) in jacobian:
                diagonal[:, :, i, j] -= jacobian[row, column][:, rows]
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        if cases == 1:
            return np.full_like(matrices, np.nan)
    one_by_one = ({e: a[[k]] for e, a in jacobian.items()} for k in range(cases))
    return np.concatenate([_inverse(derivative, one, rows, 1) for one in one_by_one])


def _integrated(integration: Array, rates: Array) -> Array:
    """Running integrals (c, n − 1) of `rates` (c, n − 1), case by case."""
    return np.asarray((integration @ rates[:, :, None])[:, :, 0])
