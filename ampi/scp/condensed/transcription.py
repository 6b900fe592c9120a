"""Flipped-Radau transcription of the problem on its mesh.

On segment s with collocation rows i and nodal rows j (Garg et al. 2011),

    R_s = Σ_j D̄_ij x_j − h_s f(x_i, u_i, t_i) = 0,   h_s = α_s + β_s t_f,       (1)
    ∫ L dt = Σ_s h_s Σ_i w_i L_i.                                                (2)

Collocation quantities have n − 1 points: node 0 is not collocated, and every other node is collocated in
exactly one segment. Arrays have an axis of cases (condensing).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import N_CORE
from ampi.pseudospectral.lagrange import barycentric_weights, interpolation_matrix
from ampi.pseudospectral.mesh import Mesh
from ampi.pseudospectral.radau import flipped_radau

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RadauTranscription:
    """Mesh arrays that every iteration needs, computed once."""

    mesh: Mesh
    node_fixed: Array  # (n,), a of t = a + b t_f
    node_free: Array  # (n,), b
    half_fixed: Array  # (n−1,), α per collocation point
    half_free: Array  # (n−1,), β
    weights: Array  # (n−1,), quadrature
    core_derivative: tuple[Array, ...]  # per segment, D ⊗ I₅ without its first node
    integration: Array  # (n−1, n−1): ∫ from the entry to every collocation point, over h dτ
    entry_rate: Array  # (N₁,): bank rate at τ = −1 from the first segment's collocation values
    between: Array  # (k, n): from nodal values to those at points between, five to a gap

    def half_lengths(self, final_time: Any) -> Array:
        """h at every collocation point (s), (…, n − 1) of `final_time` (…)."""
        return np.asarray(self.half_fixed + self.half_free * np.asarray(final_time)[..., None])

    def times(self, final_time: Any) -> Array:
        """t at every node (s), (…, n) of `final_time` (…)."""
        return np.asarray(self.node_fixed + self.node_free * np.asarray(final_time)[..., None])

    def residual(self, x: Array, rates: Array, final_time: Array) -> Array:
        """R of Eq. (1), (c, n − 1, s), of states and f (s, c, n) at all nodes."""
        found = -(self.half_lengths(final_time) * rates[:, :, 1:]).transpose(1, 2, 0)
        states = x.transpose(1, 2, 0)
        for s in self.mesh.segments:
            found[:, s.collocation] += s.rule.derivative @ states[:, s.nodes]
        return found

    def nodal_rate(self, u: Array, controls: int = 1) -> Array:
        """Rates at all n nodes (c, n m) of those at the points (c, (n − 1) m), of m controls in turn.

        The first by the first segment's own polynomial.
        """
        points = len(self.entry_rate)
        first = u[:, : controls * points].reshape(len(u), points, controls)
        entry = first.transpose(0, 2, 1) @ self.entry_rate[:, None]
        return np.concatenate([entry[:, :, 0], u], axis=1)


def by_control(rate: Array, controls: int) -> Array:
    """Rates (c, n m) with the axis of the controls first, (m, c, n)."""
    return rate.reshape(len(rate), rate.shape[1] // controls, controls).transpose(2, 0, 1)


@lru_cache(maxsize=16)
def radau_transcription(mesh: Mesh) -> RadauTranscription:
    """Transcription of `mesh`, cached per process."""
    fixed, free = mesh.node_time
    segments = mesh.segments
    count = [s.rule.degree for s in segments]
    return RadauTranscription(
        mesh=mesh,
        node_fixed=fixed,
        node_free=free,
        half_fixed=np.repeat([s.half_length[0] for s in segments], count),
        half_free=np.repeat([s.half_length[1] for s in segments], count),
        weights=np.concatenate([s.rule.weights for s in segments]),
        core_derivative=tuple(_of_rule(d).core_derivative for d in count),
        integration=_integration(mesh),
        entry_rate=_of_rule(count[0]).entry_rate,
        between=_between(mesh),
    )


@dataclass(frozen=True, eq=False)
class _OfRule:
    """What depends on the degree alone: a flight that is planned anew has another mesh each time."""

    core_derivative: Array  # D ⊗ I₅ without its first node
    inside: Array  # D⁻¹ without the first node (Garg et al. 2011, Section 3)
    entry_rate: Array
    between: Array  # (k, N + 1)


@lru_cache(maxsize=256)
def _of_rule(degree: int) -> _OfRule:
    rule = flipped_radau(degree)
    inner, gaps = rule.nodes[1:], np.diff(rule.nodes)[:, None]
    points = (rule.nodes[:-1, None] + gaps * (np.arange(1, 6) / 6.0)).ravel()
    return _OfRule(
        core_derivative=np.asarray(np.kron(rule.derivative[:, 1:], np.eye(N_CORE)), dtype=float),
        inside=np.asarray(np.linalg.inv(rule.derivative[:, 1:]), dtype=float),
        entry_rate=interpolation_matrix(inner, barycentric_weights(inner), [-1.0])[0],
        between=interpolation_matrix(rule.nodes, rule.barycentric, points),
    )


def _between(mesh: Mesh) -> Array:
    found = []
    for s in mesh.segments:
        values = _of_rule(s.rule.degree).between
        rows = np.zeros((len(values), mesh.n_nodes))
        rows[:, s.nodes] = values
        found.append(rows)
    return np.vstack(found)


def _integration(mesh: Mesh) -> Array:
    """Inverse of the derivative matrices of all segments, chained: x_i − x_0 = Σ_j I_ij (h f)_j.

    The last row of a segment's own, its quadrature weights, leads from one segment to the next.
    """
    matrix = np.zeros((mesh.n_nodes - 1, mesh.n_nodes - 1))
    for s in mesh.segments:
        inside = _of_rule(s.rule.degree).inside
        matrix[s.collocation, s.collocation] = inside
        matrix[s.collocation.stop :, s.collocation] = inside[-1]
    return matrix
