"""hp refinement with a look between the nodes and a reduction phase: Liu et al. 2024, Section 3.

Only the outline of the paper survives (its Algorithm 2 without equations); what follows is our reading.
After each solve on a mesh:

1. *Path constraints* (Section 3.2). The limits are read at many points of every interval. Where one is
   exceeded between the nodes, the interval's degree grows by `boost`; at `greatest_degree` it is
   halved.
2. *Refinement phase* (Section 3.4). With e the interval's Birkhoff error over the tolerance, an
   interval of degree N and e > 1 gets N + max(2, ⌈log_N e⌉) (the error falls like N^−N); beyond
   `greatest_degree` it is cut into ⌈(N + …)/least_degree⌉ pieces of `least_degree`.
3. *Reduction phase*, once the mesh no longer grows. A window slides over the intervals. Two neighbours
   are merged if the solution, resampled at Chebyshev–Gauss–Lobatto points of their union, is a
   polynomial of degree N ≤ `greatest_degree`, N less than the sum of both, to within the tolerance:
   its Birkhoff error and its distance from the old solution keep a share of it. The window then tries to
   take in the next interval; otherwise it moves on. A lone interval may lose degrees by the same test.
   Intervals that come near a limit are left alone: their nodes hold the limit between them.

The solve after a reduction decides: if its error is back above the tolerance, the mesh before it is
kept and the reduction ends.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ampi.missions.path_limits import KEPT
from ampi.pseudospectral.lagrange import barycentric_weights, interpolation_matrix
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.literature.birkhoff import birkhoff_error, chebyshev_gauss_lobatto
from ampi.scp.literature.formulation import Formulation
from ampi.scp.literature.subproblem_builder import MeshIterate
from ampi.scp.literature.successive import Ending, Run

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ModifiedHpSettings:
    """Tolerances, degrees and caps; the paper's ε_e, H₁, H₂ and r_max, whose values are unpublished."""

    tolerance: tuple[float, ...]  # ε_e per state that there may be, SI or rad
    limit_tolerance: float = KEPT  # relative excess between the nodes
    least_degree: int = 4  # H₁
    greatest_degree: int = 14  # H₂
    boost: int = 3  # degrees added where a limit peaks between the nodes
    reduction_margin: float = 0.25  # merged intervals keep this share of the tolerance
    clearance: float = 0.02  # intervals that come nearer to a limit keep their nodes
    extra_points: int = 4  # of the Birkhoff interpolant beyond the degree
    reduce: bool = True  # False: the usual hp method, for comparison
    max_rounds: int = 10  # r_max
    max_nodes: int = 600
    max_segments: int = 80
    max_seconds: float = 300.0  # no round starts after that


@dataclass(frozen=True)
class Piece:
    """One interval of the mesh: its cuts as fractions of the flight, and its degree."""

    left: float
    right: float
    degree: int


@dataclass(frozen=True)
class Round:
    """What one mesh gave."""

    nodes: int
    segments: int
    iterations: int
    error: float  # greatest Birkhoff error over the tolerance
    excess: float  # greatest relative excess of a limit, between the nodes
    is_reduction: bool  # of the mesh; otherwise a refinement


@dataclass(frozen=True, eq=False)
class Refined:
    """Last accepted run, all rounds, and how it ended."""

    run: Run
    rounds: tuple[Round, ...]
    ending: Ending


def refine_and_reduce(
    formulation: Formulation,
    solve_on: Callable[[MeshIterate], Run],
    start: MeshIterate,
    settings: ModifiedHpSettings,
) -> Refined:
    """Algorithm 2: solve, refine until the error is met, then reduce while it stays so."""
    began, rounds = time.perf_counter(), list[Round]()
    run, reducing = solve_on(start), False
    kept: Run | None = None
    while True:
        seen = BetweenNodes(formulation, run.iterate, settings)
        error, excess = seen.errors(), seen.excesses()
        good = bool(error.max() <= 1.0 and excess.max() <= settings.limit_tolerance)
        rounds.append(
            Round(
                nodes=run.iterate.mesh.n_nodes,
                segments=len(error),
                iterations=len(run.log),
                error=float(error.max()),
                excess=float(excess.max()),
                is_reduction=reducing,
            )
        )
        if reducing or run.ending is not Ending.CONVERGED:
            better = run.ending is Ending.CONVERGED and good
            last = run if better or kept is None else kept
            return Refined(last, tuple(rounds), Ending.CONVERGED if kept else run.ending)
        if good:
            kept, reducing = run, settings.reduce
        pieces = seen.reduced(excess) if reducing else seen.refined(error, excess)
        if pieces == seen.pieces:
            return Refined(run, tuple(rounds), Ending.CONVERGED if good else Ending.MESH_LIMIT)
        mesh = _mesh(pieces)
        late = time.perf_counter() - began > settings.max_seconds
        large = mesh.n_nodes > settings.max_nodes or len(pieces) > settings.max_segments
        if late or large or len(rounds) >= settings.max_rounds:
            return Refined(
                kept or run, tuple(rounds), Ending.CONVERGED if kept else Ending.MESH_LIMIT
            )
        run = solve_on(_on_mesh(run.iterate, mesh))


@dataclass(frozen=True, eq=False)
class BetweenNodes:
    """A solution seen between its nodes."""

    formulation: Formulation
    at: MeshIterate
    settings: ModifiedHpSettings

    @property
    def scale(self) -> Array:
        """Tolerances in scaled states."""
        states = self.formulation.n_states
        return np.array(self.settings.tolerance[:states]) / self.formulation.state_scale

    @property
    def pieces(self) -> list[Piece]:
        """The mesh's intervals."""
        (phase,) = self.at.mesh.phases
        cuts = phase.cuts
        return [
            Piece(float(a), float(b), n)
            for a, b, n in zip(cuts[:-1], cuts[1:], phase.degrees, strict=True)
        ]

    def sample(self, left: float, right: float, tau: Array) -> tuple[Array, Array, Array]:
        """(s, X, U) at points τ of the interval [left, right]."""
        s = self.at.final * (left + 0.5 * (right - left) * (1.0 + tau))
        matrix = self.at.mesh.conversion(s, self.at.final)
        return s, matrix @ self.at.states, matrix @ self.at.controls

    def error_of(self, piece: Piece) -> float:
        """Birkhoff error over the tolerance."""
        tau = chebyshev_gauss_lobatto(piece.degree + self.settings.extra_points)
        s, x, u = self.sample(piece.left, piece.right, tau)
        half = 0.5 * self.at.final * (piece.right - piece.left)
        return birkhoff_error(x, self.formulation.rates(x, u, s), half, self.scale)

    def errors(self) -> Array:
        """Of all intervals."""
        return np.array([self.error_of(piece) for piece in self.pieces])

    def excesses(self) -> Array:
        """Greatest g − 1 of every interval, at four points a degree."""
        found = []
        for piece in self.pieces:
            s, x, u = self.sample(piece.left, piece.right, np.linspace(-1.0, 1.0, 4 * piece.degree))
            found.append(float(self.formulation.limits(x, u, s).max()) - 1.0)
        return np.array(found)

    def refined(self, error: Array, excess: Array) -> list[Piece]:
        """Steps 1 and 2 of the module's docstring."""
        settings, out = self.settings, list[Piece]()
        for piece, e, over in zip(self.pieces, error, excess, strict=True):
            degree = piece.degree
            if e > 1.0:
                degree += max(2, int(np.ceil(np.log(e) / np.log(max(2, degree)))))
            if over > settings.limit_tolerance:
                degree = max(degree, piece.degree + settings.boost)
            if degree <= settings.greatest_degree:
                out.append(Piece(piece.left, piece.right, degree))
                continue
            parts = max(2, min(4, -(-degree // settings.greatest_degree)))
            each = max(settings.least_degree, -(-degree // (parts + 1)))
            cuts = np.linspace(piece.left, piece.right, parts + 1)
            out += [Piece(float(a), float(b), each) for a, b in pairwise(cuts)]
        return out

    def reduced(self, excess: Array) -> list[Piece]:
        """Step 3: the window slides over the intervals."""
        out, window = list[Piece](), list[Piece]()
        for piece, over in zip(self.pieces, excess, strict=True):
            free = over < -self.settings.clearance
            merged = None
            if window and free:
                (held,) = window
                merged = self._lowest(held.left, piece.right, held.degree + piece.degree)
            if merged is not None:
                window = [merged]
                continue
            out += window
            alone = self._lowest(piece.left, piece.right, piece.degree) if free else None
            window = [alone or piece] if free else []
            out += [] if free else [piece]
        return out + window

    def _lowest(self, left: float, right: float, below: int) -> Piece | None:
        """The least degree under `below` that holds the solution on [left, right], if any."""
        most = min(below - 1, self.settings.greatest_degree)
        for degree in range(self.settings.least_degree, most + 1):
            if self._holds(left, right, degree):
                return Piece(left, right, degree)
        return None

    def _holds(self, left: float, right: float, degree: int) -> bool:
        """Whether a polynomial of `degree` through CGL points keeps the tolerance on [left, right]."""
        base = chebyshev_gauss_lobatto(degree + 1)
        fine = chebyshev_gauss_lobatto(2 * degree + self.settings.extra_points)
        _, x, u = self.sample(left, right, base)
        s, x_old, _ = self.sample(left, right, fine)
        matrix = interpolation_matrix(base, barycentric_weights(base), fine)
        x_new, u_new = matrix @ x, matrix @ u
        if float((np.abs(x_new - x_old) / self.scale).max()) > self.settings.reduction_margin:
            return False
        half = 0.5 * self.at.final * (right - left)
        error = birkhoff_error(x_new, self.formulation.rates(x_new, u_new, s), half, self.scale)
        return error <= self.settings.reduction_margin


def _mesh(pieces: list[Piece]) -> Mesh:
    cuts = (0.0, *(piece.right for piece in pieces[:-1]), 1.0)
    return Mesh((Phase(tuple(piece.degree for piece in pieces), None, cuts),))


def _on_mesh(at: MeshIterate, mesh: Mesh) -> MeshIterate:
    """The same flight on another mesh, by its own polynomials."""
    matrix = at.mesh.conversion(mesh.times(at.final), at.final)
    return MeshIterate(mesh, matrix @ at.states, matrix @ at.controls, at.final)
