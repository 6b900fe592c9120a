"""The convex subproblem with states and controls as variables, and its solution by Clarabel.

The form in which the literature writes it. With changes δx (n, n_x), δu (n, n_u), δs of the final
value of the independent variable, trust-region relaxation η and slacks v (target), p (limits), a:

    minimise   qᵀ(δx, δu, δs) + ½ (δx, δu, δs)ᵀ diag(Q) (δx, δu, δs) + c_η η + Σ c_v v + c_p Σ p + Σ w a
    subject to D_x δx + D_u δu + D_s δs = −R                dynamics
               E_x δx + E_u δu = e                          entry, and a hard target
               lo − v ≤ δx_f ≤ hi + v                       target, elastic
               lo ≤ δx ≤ hi,  lo ≤ δu ≤ hi                  bounds
               |δx| ≤ η Δ   or   |δx| ≤ Δ                   trust region
               ‖u + δu‖ ≤ 1 at every node                   control cone, where asked for
               G_x δx + G_s δs − p ≤ 1 − g                  limits, one slack a kind
               |a₀ + A_x δx + A_u δu + A_s δs| ≤ a          absolute terms of the cost
               v, p, η ≥ 0                                                            (1)

Zhou 2021, Eqs. (34), (38): η and its price. Liu 2015, Eqs. (64)–(69): the cone. Wang 2020,
Eqs. (33)–(35): absolute terms. A fixed trust region is η = 1.
`sparse_subproblem_cvxpy.py` states the same problem in cvxpy; tests hold the two together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ampi.scp.cone_program import ConeStatus, solve_cone_program

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
    prescribed: sparse.csr_array  # (E_x, E_u, ·): (e, N)
    prescribed_change: Array  # e
    target: tuple[TargetRow, ...]
    lower: Array  # (N,) on (δx, δu, δs); −inf where free
    upper: Array
    trust_radius: Array  # Δ (n_x,); inf where free
    trust_price: float | None  # c_η; None: a fixed region
    limit_rows: sparse.csr_array  # (G_x, ·, G_s): (g, N)
    limit_room: Array  # 1 − g (g,)
    limit_index: NDArray[np.intp]  # (g,)
    n_limits: int
    limit_price: float
    gradient: Array  # q (N,)
    curvature: Array  # Q (N,), ≥ 0
    absolute: tuple[AbsoluteTerm, ...]
    states: Array  # x (n, n_x), scaled: where the linearisation was made
    controls: Array  # u (n, n_u)
    control_cone: bool  # ‖u + δu‖ ≤ 1 at every node; n_u = 2

    @property
    def width(self) -> int:
        """N: entries of (δx, δu, δs)."""
        return self.n_nodes * (self.n_states + self.n_controls) + 1

    @property
    def n_absolute(self) -> int:
        """Epigraph variables a."""
        return sum(len(term.offset) for term in self.absolute)

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
    dynamics_multipliers: Array  # of the rows of D (m, n_x)
    objective: float
    status: ConeStatus

    @property
    def usable(self) -> bool:
        """Whether the step may be taken."""
        return self.status.is_usable and bool(np.all(np.isfinite(self.states)))


def solve_sparse_subproblem(problem: SparseSubproblem) -> SparseStep:
    """Solve Eq. (1) with Clarabel.

    Columns are (δ = (δx, δu, δs) | η | v | p | a), rows from top to bottom

        [ D     ·   ·   ·   · ]  dynamics        [ ±I    −Δ   ·   ·   · ]  trust region
        [ E     ·   ·   ·   · ]  prescribed      [ G     ·    ·  −K   · ]  limits
        [ ·     1   ·   ·   · ]  η, if fixed     [ ±A    ·    ·   ·  −I ]  absolute terms
        [ ±I_t  ·  −I   ·   · ]  target          [ ·    −I   −I  −I   · ]  signs
        [ ±I_b  ·   ·   ·   · ]  bounds          [ −I_u   ·    ·   ·   · ]  cones (1, u + δu)
    """
    p = problem
    equalities, equal_to = _equalities(p)
    inequalities, at_most = _inequalities(p)
    left, right = [equalities, inequalities], [equal_to, at_most]
    if p.control_cone:
        cones, apexes = _control_cones(p, equalities.shape[1])
        left.append(cones)
        right.append(apexes)
    linear = np.concatenate(
        [
            p.gradient,
            [0.0 if p.trust_price is None else p.trust_price],
            [t.price for t in p.target],
            np.full(p.n_limits, p.limit_price),
            np.ones(p.n_absolute),
        ]
    )
    diagonal = np.concatenate([p.curvature, np.zeros(len(linear) - p.width)])
    matrix = sparse.csc_array(sparse.vstack(left, format="csc"))
    matrix.eliminate_zeros()
    for equilibrated in (True, False):
        solution = solve_cone_program(
            sparse.csc_array(sparse.diags_array(diagonal)),
            linear,
            matrix,
            np.concatenate(right),
            equalities=len(equal_to),
            inequalities=len(at_most),
            second_order=(3,) * (p.n_nodes if p.control_cone else 0),
            equilibrated=equilibrated,
        )
        # on some problems with two controls the arithmetic stops just before the tolerance, scaled
        if solution.status is not ConeStatus.NUMERICAL_ERROR:
            break
    price = solution.dual[: len(p.residual)].reshape(-1, p.n_states)
    return _step(p, solution.primal, price, solution.objective, solution.status)


def _step(
    p: SparseSubproblem, y: Array, price: Array, objective: float, status: ConeStatus
) -> SparseStep:
    n_x, first_slack = p.n_nodes * p.n_states, p.width + 1
    first_limit = first_slack + len(p.target)
    return SparseStep(
        states=y[:n_x].reshape(p.n_nodes, p.n_states),
        controls=y[n_x : p.width - 1].reshape(p.n_nodes, p.n_controls),
        final=float(y[p.width - 1]),
        relaxation=float(y[p.width]),
        target_slack=np.maximum(y[first_slack:first_limit], 0.0),
        limit_slack=np.maximum(y[first_limit : first_limit + p.n_limits], 0.0),
        dynamics_multipliers=price,
        objective=objective,
        status=status,
    )


def pick(index: NDArray[np.intp], columns: int) -> sparse.csr_array:
    """Rows of the identity."""
    count = len(index)
    return sparse.csr_array((np.ones(count), (np.arange(count), index)), shape=(count, columns))


def _equalities(p: SparseSubproblem) -> tuple[sparse.csr_array, Array]:
    rows = [p.dynamics, p.prescribed]
    right = [-p.residual, p.prescribed_change]
    others = 1 + len(p.target) + p.n_limits + p.n_absolute
    matrix = sparse.hstack([sparse.vstack(rows), sparse.csr_array((sum(map(len, right)), others))])
    if p.trust_price is None:
        matrix = sparse.vstack([matrix, pick(np.array([p.width]), p.width + others)])
        right.append(np.ones(1))
    return sparse.csr_array(matrix), np.concatenate(right)


def _inequalities(p: SparseSubproblem) -> tuple[sparse.csr_array, Array]:
    last = (p.n_nodes - 1) * p.n_states
    final = pick(np.array([last + t.state for t in p.target], dtype=np.intp), p.width)
    above = np.flatnonzero(np.isfinite(p.upper))
    below = np.flatnonzero(np.isfinite(p.lower))
    trusted = pick(p.trust_rows, p.width)
    radius = np.tile(p.trust_radius, p.n_nodes)[p.trust_rows]
    column = sparse.csr_array(-radius[:, None])
    m, slacks = len(p.limit_room), len(p.target)
    kinds = sparse.csr_array((-np.ones(m), (np.arange(m), p.limit_index)), shape=(m, p.n_limits))
    terms = sparse.vstack([sparse.csr_array((0, p.width)), *(t.rows for t in p.absolute)])
    offset = np.concatenate([[], *(t.offset for t in p.absolute)])
    no = -sparse.eye_array(p.n_absolute)
    elastic, one, every = (
        -sparse.eye_array(slacks),
        -sparse.eye_array(1),
        -sparse.eye_array(p.n_limits),
    )
    blocks: list[list[sparse.sparray | None]] = [
        [final, None, elastic, None, None],
        [-final, None, elastic, None, None],
        [pick(above, p.width), None, None, None, None],
        [-pick(below, p.width), None, None, None, None],
        [trusted, column, None, None, None],
        [-trusted, column, None, None, None],
        [p.limit_rows, None, None, kinds, None],
        [terms, None, None, None, no],
        [-terms, None, None, None, no],
        [None, one, None, None, None],
        [None, None, elastic, None, None],
        [None, None, None, every, None],
    ]
    right = np.concatenate(
        [
            [t.upper for t in p.target],
            [-t.lower for t in p.target],
            p.upper[above],
            -p.lower[below],
            np.zeros(2 * len(radius)),
            p.limit_room,
            -offset,
            offset,
            np.zeros(1 + slacks + p.n_limits),
        ]
    )
    return sparse.csr_array(sparse.block_array(blocks)), right


def _control_cones(p: SparseSubproblem, columns: int) -> tuple[sparse.csr_array, Array]:
    """(1, u + δu) in the second-order cone, node after node: three rows each."""
    node = np.arange(p.n_nodes)
    start = p.n_nodes * p.n_states
    row = np.concatenate([3 * node + 1, 3 * node + 2])
    column = np.concatenate([start + 2 * node, start + 2 * node + 1])
    shape = (3 * p.n_nodes, columns)
    rows = sparse.csr_array((-np.ones(2 * p.n_nodes), (row, column)), shape=shape)
    return rows, np.column_stack([np.ones(p.n_nodes), p.controls]).ravel()
