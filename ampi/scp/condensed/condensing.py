"""Condensing: the linearised dynamics solved for the states, segment by segment, for c cases at once.

Linearising R_s = 0 (transcription, Eq. (1)) at the iterate, with A = ∂f/∂x and t = a + b t_f,

    (D⊗I − h A) δx = −(D₀⊗I) δx_start + h B δu + (β f + h b f_t) δt_f − R      (1)

Two of the seven states are quadratures: no state enters σ̇ = u, and the longitude enters no rate. Both
are running integrals (`RadauTranscription.integration`), σ before and θ after the core of five,

    (D⊗I − h A_cc) δx_c = −(D₀⊗I) δx_c,start + h A_cσ δσ + (β f_c + h b f_c,t) δt_f − R_c   (2)

whose inverse per segment gives the affine map δx = Z z + c of the free variables

    z = (δu at the collocation points, δt_f, δσ₀).                               (3)

The same inverses, transposed and swept backwards, give the multipliers μ of R = 0; with them the
Hessian of the Lagrangian is reduced to z (curvature, Eq. (1)). An inverse costs three times as much as
its factors, but is used a dozen times, and solving with those costs four times as much as its product.

Every sum runs within a case, so that no case depends on its company: the axis of cases is never one of a
matrix product's own two. Arrays of states have their axis first, (7, c, n); residuals have it last.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK, CORE, LONGITUDE, N_CORE, N_STATES
from ampi.pseudospectral.mesh import Segment
from ampi.scp.condensed.transcription import RadauTranscription
from ampi.tracing.dynamics import Entries, NodeFunction, entries

Array = NDArray[np.float64]
Cases = NDArray[np.intp]

MOVING = (*CORE, BANK)  # the states that enter rates, in the order of Z's rows


@dataclass(frozen=True, eq=False)
class NodeDerivatives:
    """f and its first derivatives at all nodes; those of limits and integrands where asked for."""

    rates: Array  # f, (7, c, n)
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
        """∂/∂(x, t) of one limit or integrand at all nodes, (c, n, 8)."""
        assert self.functions_jacobian is not None
        found = np.zeros((*self.rates.shape[1:], N_STATES + 1))
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
    time_derivative: Array  # ∂f/∂t, (7, c, n − 1)
    inverses: tuple[Array, ...]  # of Eq. (2), (c, 5 N, 5 N) by segment
    moving: Array  # Z of the moving states, (c, n, 6, n_z)
    longitude_rate: (
        Array  # rows over z whose running integral is Z of the longitude, (c, n − 1, n_z)
    )
    final_time_scale: float  # s per unit of z's δt_f
    rate_scale: Array  # rad/s per unit of z's δu, (c, 1)

    @property
    def n_variables(self) -> int:
        """Length of z, Eq. (3)."""
        return int(self.moving.shape[3])

    @property
    def final_map(self) -> Array:
        """Z of all states at the last node, (c, 7, n_z)."""
        final = np.empty((len(self.moving), N_STATES, self.n_variables))
        final[:, MOVING] = self.moving[:, -1]
        final[:, LONGITUDE] = (self.transcription.integration[-1:] @ self.longitude_rate)[:, 0]
        return final

    def longitude_map(self) -> Array:
        """Z of the longitude at the nodes after the first, (c, n − 1, n_z)."""
        return np.asarray(self.transcription.integration @ self.longitude_rate)

    def change(self, z: Array, cases: Cases) -> Array:
        """Z z, (7, k, n), of z (k, n_z) of `cases`."""
        n, n_z = self.moving.shape[1], self.n_variables
        moving = self._of(cases, self.moving).reshape(len(cases), -1, n_z) @ z[:, :, None]
        rate = (self._of(cases, self.longitude_rate) @ z[:, :, None])[:, :, 0]
        found = np.zeros((N_STATES, len(cases), n))
        found[list(MOVING)] = moving.reshape(len(cases), n, len(MOVING)).transpose(2, 0, 1)
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
        """Change (k, n − 1, 7) at fixed entry state, u and t_f that cancels `residual` of `cases`."""
        integration = self.transcription.integration
        change = np.empty_like(residual)
        change[:, :, BANK] = -_integrated(integration, residual[:, :, BANK])
        right = -residual[:, :, CORE]
        for i, state in enumerate(CORE):
            if (state, BANK) in self.jacobian:
                right[:, :, i] += self.jacobian[state, BANK][cases] * change[:, :, BANK]
        start = np.zeros((len(right), N_CORE))
        for s, inverse in zip(self.transcription.mesh.segments, self._inverses(cases), strict=True):
            here = right[:, s.collocation] - s.rule.derivative[:, :1] * start[:, None]
            solution = inverse @ here.reshape(len(cases), -1, 1)
            right[:, s.collocation] = solution.reshape(here.shape)
            start = right[:, s.collocation.stop - 1]
        change[:, :, CORE] = right
        rate = -residual[:, :, LONGITUDE]
        for state in MOVING:
            if (LONGITUDE, state) in self.jacobian:
                rate = rate + self.jacobian[LONGITUDE, state][cases] * change[:, :, state]
        change[:, :, LONGITUDE] = _integrated(integration, rate)
        return change

    def multipliers(self, gradient: Array, cases: Cases) -> Array:
        """μ (7, k, n − 1) of `cases`: one backward sweep.

        `gradient` (k, n − 1, 7) is that of cost, target and limits over the states after the first node.
        """
        integration, mesh = self.transcription.integration, self.transcription.mesh
        mu = np.empty((N_STATES, *gradient.shape[:2]))
        mu[LONGITUDE] = -_integrated(integration.T, gradient[:, :, LONGITUDE])
        right = -gradient[:, :, MOVING]
        for i, state in enumerate(MOVING):
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
        on_bank = right[:, :, N_CORE]
        for i, state in enumerate(CORE):
            if (state, BANK) in self.jacobian:
                on_bank = on_bank + self.jacobian[state, BANK][cases] * core[:, :, i]
        mu[BANK] = _integrated(integration.T, on_bank)
        return mu

    def change_of_transpose(
        self, derivatives: NodeDerivatives, half: Array, mu: Array, cases: Cases
    ) -> Array:
        """(M_new − M)ᵀ μ of `cases`, (k, n − 1, 7); M_new is Eq. (1)'s matrix at `derivatives`."""
        grown = half * derivatives.jacobian[:, :, 1:] - self._cases_of(cases, self.scaled)
        rows, columns = np.array(self.derivatives.places).T
        grown *= -mu[rows]
        found = np.zeros((N_STATES, *half.shape))
        present, first = np.unique(columns, return_index=True)
        found[present] = np.add.reduceat(grown, first, axis=0)
        return found.transpose(1, 2, 0)

    def projected(self, gradient: Array, cases: Cases) -> Array:
        """Zᵀ of a gradient over the states after the first node (k, n − 1, 7): (k, n_z)."""
        count, n_z = len(cases), self.n_variables
        rows = self._of(cases, self.moving).reshape(count, -1, n_z)[:, len(MOVING) :]
        found = gradient[:, :, MOVING].reshape(count, 1, -1) @ rows
        on_rate = _integrated(self.transcription.integration.T, gradient[:, :, LONGITUDE])
        found += on_rate[:, None] @ self._of(cases, self.longitude_rate)
        return np.asarray(found[:, 0])

    def rows(self, case: int, node: NDArray[np.intp], gradient: Array) -> Array:
        """Rows over z (r, n_z) of one case: each a `gradient` (r, 8) over (x, t) at a `node` (r,)."""
        found = np.einsum("ri,riz->rz", gradient[:, MOVING], self.moving[case, node])
        on_longitude = gradient[:, LONGITUDE]
        if on_longitude.any():
            integration = self.transcription.integration
            reaching = np.vstack([np.zeros((1, integration.shape[1])), integration])[node]
            found += on_longitude[:, None] * (reaching @ self.longitude_rate[case])
        free = self.transcription.node_free[node] * self.final_time_scale
        found[:, -2] += gradient[:, N_STATES] * free
        return np.asarray(found)


def condense(
    t: RadauTranscription,
    derivatives: NodeDerivatives,
    final_time: Array,
    *,
    rate_scale: Array,
    final_time_scale: float,
    entry_bank_is_free: bool,
) -> CondensedDynamics:
    """Factor Eq. (2) on every segment and build Z, of cases with `final_time` (c,).

    What is not finite, or singular, gives a Z that is not finite. An entry bank angle that is not free
    has no column in Z.
    """
    cases, n = len(final_time), t.mesh.n_nodes
    n_z = n + 1
    half = t.half_lengths(final_time)
    scaled = half * derivatives.jacobian[:, :, 1:]
    jacobian = entries(derivatives.places, scaled)
    time_derivative, by_time = with_final_time(t, derivatives, half)
    by_time *= final_time_scale

    moving = np.zeros((cases, n, len(MOVING), n_z))
    bank = moving[:, :, N_CORE]
    bank[:, :, -1] = float(entry_bank_is_free)
    # h B: ∂f/∂û is the rate of û = 1, in the bank row alone
    bank[:, 1:, :-2] = t.integration * (half * rate_scale)[:, None]
    bank[:, 1:, -2] = _integrated(t.integration, by_time[BANK])
    inverses = []
    for s, derivative in zip(t.mesh.segments, t.core_derivative, strict=True):
        rows = s.collocation
        after = slice(rows.start + 1, rows.stop + 1)
        inverse = _inverse(derivative, jacobian, rows, cases)
        right = _right_sides(s, jacobian, bank, by_time)
        solved = right.reshape(cases, right.shape[1], -1) @ inverse.transpose(0, 2, 1)
        # of the controls before this segment, its own, t_f and σ₀; no later one has any part in it
        start, block = moving[:, rows.start], moving[:, after, :N_CORE]
        carried = solved[:, : N_CORE + 1].transpose(0, 2, 1)
        shape = (cases, rows.stop - rows.start, N_CORE, -1)
        if rows.start:
            block[..., : rows.start] = (carried @ start[:, :, : rows.start]).reshape(shape)
        block[..., rows] = solved[:, N_CORE + 1 : -1].transpose(0, 2, 1).reshape(shape)
        block[..., -2:] = (carried @ start[:, :, -2:]).reshape(shape)
        block[..., -2] += solved[:, -1].reshape(shape[:3])
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


def _longitude_rate(jacobian: Entries, moving: Array, by_time: Array) -> Array:
    """Rows over z whose running integral is Z of the longitude, (c, n − 1, n_z)."""
    turning = np.zeros((*by_time.shape[1:], 1, len(MOVING)))
    for i, state in enumerate(MOVING):
        if (LONGITUDE, state) in jacobian:
            turning[:, :, 0, i] = jacobian[LONGITUDE, state]
    rows = (turning @ moving[:, 1:])[:, :, 0]
    rows[:, :, -2] += by_time[LONGITUDE]
    return np.asarray(rows)


def with_final_time(
    t: RadauTranscription, derivatives: NodeDerivatives, half: Array
) -> tuple[Array, Array]:
    """∂f/∂t and ∂(h f)/∂t_f at the collocation points, (7, c, n − 1)."""
    time_derivative = np.zeros((N_STATES, *half.shape))
    for (state, _), rows in derivatives.by_time.items():
        time_derivative[state] = rows[:, 1:]
    by_time = t.half_free * derivatives.rates[:, :, 1:]
    by_time += half * t.node_free[1:] * time_derivative
    return time_derivative, by_time


def _right_sides(s: Segment, jacobian: Entries, bank: Array, by_time: Array) -> Array:
    """Right sides of Eq. (2) on a segment, by columns: (c, columns, degree, 5).

    The columns: start of the core, start of the bank angle, δu of this segment, δt_f.
    """
    cases, count, rows = len(bank), s.rule.degree, s.collocation
    after = slice(rows.start + 1, rows.stop + 1)
    by_bank = np.zeros((cases, count, N_CORE))
    for i, state in enumerate(CORE):
        if (state, BANK) in jacobian:
            by_bank[:, :, i] = jacobian[state, BANK][:, rows]
    right = np.zeros((cases, N_CORE + 1 + count + 1, count, N_CORE))
    for i in range(N_CORE):
        right[:, i, :, i] = -s.rule.derivative[:, 0]
    right[:, N_CORE] = by_bank
    inside = bank[:, after] - bank[:, rows.start, None]
    right[:, N_CORE + 1 : -1] = inside[:, :, rows].transpose(0, 2, 1)[..., None] * by_bank[:, None]
    right[:, -1] = by_time[list(CORE)][:, :, rows].transpose(1, 2, 0)
    right[:, -1] += inside[:, :, -2, None] * by_bank
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
