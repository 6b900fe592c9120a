"""The convex subproblem with states and controls as variables, and its solution by Clarabel.

The form in which the literature writes it. With changes δx (n, n_x), δu (n, n_u), δs of the final
value of the independent variable, trust-region relaxation η and slacks v (target), p (limits), a:

    minimise   qᵀ(δx, δu, δs) + ½ δxᵀ diag(Q) δx + c_η η + Σ c_v v + c_p Σ p + Σ w a
    subject to D_x δx + D_u δu + D_s δs = −R                dynamics
               δx prescribed at the entry, and at a hard target
               lo − v ≤ δx_f ≤ hi + v                       target, elastic
               lo ≤ δx ≤ hi,  lo ≤ δu ≤ hi                  bounds
               |δx| ≤ η Δ   or   |δx| ≤ Δ                   trust region
               ‖u + δu‖ ≤ 1 at every node                   control cone, where asked for
               G_x δx + G_s δs − p ≤ 1 − g                  limits, one slack a kind
               |a₀ + A_x δx + A_u δu + A_s δs| ≤ a          absolute terms of the cost
               v, p, η ≥ 0                                                            (1)

Zhou 2021, Eqs. (34), (38): η and its price. Liu 2015, Eqs. (64)–(69): the cone. Wang 2020,
Eqs. (33)–(35): absolute terms. A fixed trust region is η = 1.
`ampi/scp/sparse_subproblem_cvxpy.py` states the same problem in cvxpy; tests hold the two together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ampi.scp.subproblem import USABLE, solve_cone_program

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TargetRow:
    """One final state, elastic at a price per unit of the scaled state."""

    state: int
    lower: float  # on δx_f
    upper: float
    price: float


@dataclass(frozen=True, eq=False)
class AbsoluteTerm:
    """Σ |offset + rows · (δx, δu, δs)|, weights already in the rows."""

    offset: Array  # (r,)
    rows: sparse.csr_array  # (r, n n_x + n n_u + 1)


@dataclass(frozen=True, eq=False)
class SparseSubproblem:
    """Data of Eq. (1). Vectors of states and controls are node-major."""

    n_nodes: int
    n_states: int
    n_controls: int
    dynamics: sparse.csr_array  # (D_x, D_u, D_s): (m n_x, N)
    residual: Array  # R (m n_x,)
    fixed: NDArray[np.intp]  # entries of δx that are prescribed: entry, hard target
    fixed_change: Array
    target: tuple[TargetRow, ...]
    lower: Array  # (N,) on (δx, δu, δs); −inf where free
    upper: Array
    trust_radius: Array  # Δ (n_x,); inf where free
    trust_price: float | None  # c_η; None: a fixed region
    limit_rows: sparse.csr_array  # (G_x, ·, G_s): (g, N)
    limit_room: Array  # 1 − g (g,)
    limit_kind: NDArray[np.intp]  # (g,)
    n_limits: int
    limit_price: float
    gradient: Array  # q (N,)
    curvature: Array  # Q (N,), ≥ 0
    absolute: tuple[AbsoluteTerm, ...]
    control: Array | None = None  # u (n, 2) where the control cone holds

    @property
    def width(self) -> int:
        """N: entries of (δx, δu, δs)."""
        return self.n_nodes * (self.n_states + self.n_controls) + 1

    @property
    def trust_rows(self) -> NDArray[np.intp]:
        """Entries of δx under the trust region."""
        held = np.tile(np.isfinite(self.trust_radius), self.n_nodes)
        return np.flatnonzero(held)


@dataclass(frozen=True, eq=False)
class SparseStep:
    """Solution of Eq. (1)."""

    states: Array  # δx (n, n_x)
    controls: Array  # δu (n, n_u)
    final: float  # δs
    relaxation: float  # η
    target_slack: Array  # v
    limit_slack: Array  # p (n_limits,)
    objective: float
    status: str

    @property
    def usable(self) -> bool:
        """Whether the step may be taken."""
        return self.status in USABLE and bool(np.all(np.isfinite(self.states)))


def solve_sparse_subproblem(problem: SparseSubproblem) -> SparseStep:
    """Solve Eq. (1) with Clarabel.

    Columns are (δx, δu, δs | η | v | p | a); rows the equalities, the inequalities, the cones.
    """
    p = problem
    relaxed = 0 if p.trust_price is None else 1
    counts = [p.width, relaxed, len(p.target), p.n_limits, *(len(t.offset) for t in p.absolute)]
    first = np.concatenate([[0], np.cumsum(counts)])
    columns = int(first[-1])

    def widen(rows: sparse.sparray, *more: tuple[int, sparse.sparray]) -> sparse.coo_array:
        out = sparse.coo_array((rows.shape[0], columns))
        for at, block in ((0, rows), *more):
            block = block.tocoo()
            part = sparse.coo_array(
                (block.data, (block.row, block.col + at)), shape=(rows.shape[0], columns)
            )
            out = out + part
        return out.tocoo()

    entry = _pick(p.fixed, p.width)
    equal = [widen(p.dynamics), widen(entry)]
    equal_right = [-p.residual, p.fixed_change]
    rows: list[sparse.sparray] = []
    right: list[Array] = []
    last = (p.n_nodes - 1) * p.n_states
    final = _pick(np.array([last + t.state for t in p.target], dtype=int), p.width)
    slack = -sparse.eye_array(len(p.target))
    rows += [widen(final, (first[2], slack)), widen(-final, (first[2], slack))]
    right += [np.array([t.upper for t in p.target]), -np.array([t.lower for t in p.target])]
    for sign, bound in ((1.0, p.upper), (-1.0, -p.lower)):
        held = np.flatnonzero(np.isfinite(bound))
        rows.append(widen(sign * _pick(held, p.width)))
        right.append(bound[held])
    trust = p.trust_rows
    radius = np.tile(p.trust_radius, p.n_nodes)[trust]
    inside = _pick(trust, p.width)
    for signed in (inside, -inside):
        if relaxed:
            rows.append(widen(signed, (first[1], sparse.csr_array(-radius[:, None]))))
            right.append(np.zeros(len(trust)))
        else:
            rows.append(widen(signed))
            right.append(radius)
    kinds = sparse.csr_array(
        (-np.ones(len(p.limit_room)), (np.arange(len(p.limit_room)), p.limit_kind)),
        shape=(len(p.limit_room), p.n_limits),
    )
    rows.append(widen(p.limit_rows, (first[3], kinds)))
    right.append(p.limit_room)
    for k, term in enumerate(p.absolute):
        above = -sparse.eye_array(len(term.offset))
        rows += [widen(sign * term.rows, (first[4 + k], above)) for sign in (1.0, -1.0)]
        right += [-term.offset, term.offset]
    signed_from, signed_to = int(first[1]), int(first[4])
    signs = _pick(np.arange(signed_from, signed_to), columns)
    rows.append(-signs)
    right.append(np.zeros(signed_to - signed_from))
    inequalities = sum(r.shape[0] for r in rows)
    cones = 0
    if p.control is not None:
        cones = p.n_nodes
        cone_rows, cone_right = _control_cones(p, columns)
        rows.append(cone_rows)
        right.append(cone_right)

    linear = np.concatenate(
        [
            p.gradient,
            [] if p.trust_price is None else [p.trust_price],
            [t.price for t in p.target],
            np.full(p.n_limits, p.limit_price),
            np.ones(columns - signed_to),
        ]
    )
    diagonal = np.concatenate([p.curvature, np.zeros(columns - p.width)])
    left = sparse.vstack([*equal, *rows]).tocsc()
    left.eliminate_zeros()
    solution = solve_cone_program(
        sparse.diags_array(diagonal).tocsc(),
        linear,
        left,
        np.concatenate([*equal_right, *right]),
        equalities=sum(len(r) for r in equal_right),
        inequalities=inequalities,
        second_order=(3,) * cones,
    )
    y, n_x = np.array(solution.x), p.n_nodes * p.n_states
    return SparseStep(
        states=y[:n_x].reshape(p.n_nodes, p.n_states),
        controls=y[n_x : p.width - 1].reshape(p.n_nodes, p.n_controls),
        final=float(y[p.width - 1]),
        relaxation=float(y[first[1]]) if relaxed else 1.0,
        target_slack=np.maximum(y[first[2] : first[3]], 0.0),
        limit_slack=np.maximum(y[first[3] : first[4]], 0.0),
        objective=float(solution.obj_val),
        status=str(solution.status),
    )


def _pick(index: NDArray[np.intp], columns: int) -> sparse.csr_array:
    """Rows of the identity."""
    count = len(index)
    return sparse.csr_array((np.ones(count), (np.arange(count), index)), shape=(count, columns))


def _control_cones(p: SparseSubproblem, columns: int) -> tuple[sparse.csr_array, Array]:
    """(1, u + δu) in the second-order cone, node after node: three rows each."""
    assert p.control is not None
    node = np.arange(p.n_nodes)
    start = p.n_nodes * p.n_states
    row = np.concatenate([3 * node + 1, 3 * node + 2])
    column = np.concatenate([start + 2 * node, start + 2 * node + 1])
    shape = (3 * p.n_nodes, columns)
    rows = sparse.csr_array((-np.ones(2 * p.n_nodes), (row, column)), shape=shape)
    right = np.column_stack([np.ones(p.n_nodes), p.control]).ravel()
    return rows, right
