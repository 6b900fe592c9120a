"""Meshes: phases of fixed or free duration, cut into segments, each with its own degree.

Phase boundaries belong where the model has kinks (the ends of the angle-of-attack manoeuvre). All
but the last phase end at a fixed time; the last one ends at the free final time t_f, so that every
time on the mesh is affine in t_f:

    t = a + b t_f,     h = α + β t_f  (half-length of a segment).                (1)

A flight that is under way starts at a later time: the mesh `after` it has no phase that is over.
One phase with one segment is the global interval of Sagliano et al. 2016.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ampi.pseudospectral.lagrange import interpolation_matrix
from ampi.pseudospectral.radau import FlippedRadau, flipped_radau

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Segment:
    """One polynomial: first node, degree, and its times as affine functions of t_f, Eq. (1)."""

    first_node: int
    rule: FlippedRadau
    start: tuple[float, float]  # (a, b)
    half_length: tuple[float, float]  # (α, β)

    @cached_property
    def nodes(self) -> slice:
        """All nodes of the segment, its first (not collocated) included."""
        return slice(self.first_node, self.first_node + self.rule.degree + 1)

    @cached_property
    def collocation(self) -> slice:
        """The segment's columns among all collocation points of the mesh."""
        return slice(self.first_node, self.first_node + self.rule.degree)


@dataclass(frozen=True)
class Phase:
    """Duration up to `end` (s; None for the free final time), cut at `fractions` of it."""

    degrees: tuple[int, ...]
    end: float | None = None
    fractions: tuple[float, ...] | None = None  # inner and outer cuts, 0 … 1; uniform if None

    def __post_init__(self) -> None:
        if not self.degrees or min(self.degrees) < 1:
            raise ValueError(
                "mesh.phase.degrees: expected at least one segment of degree 1 or more, "
                f"got {list(self.degrees)}"
            )
        cuts = self.cuts
        fits = len(cuts) == len(self.degrees) + 1 and cuts[0] == 0.0 and cuts[-1] == 1.0
        if not fits or not np.all(np.diff(cuts) > 0):
            raise ValueError(
                f"mesh.phase.fractions: expected {len(self.degrees) + 1} increasing numbers "
                f"from 0 to 1, got {self.fractions}"
            )

    @property
    def cuts(self) -> Array:
        """Segment boundaries as fractions of the phase."""
        if self.fractions is None:
            return np.linspace(0.0, 1.0, len(self.degrees) + 1)
        return np.asarray(self.fractions, dtype=float)


@dataclass(frozen=True)
class Mesh:
    """Phases in order of time from `start` (s) on; only the last one is free."""

    phases: tuple[Phase, ...]
    start: float = 0.0

    def __post_init__(self) -> None:
        ends = [phase.end for phase in self.phases]
        fixed = [end for end in ends[:-1] if end is not None]
        if not ends or ends[-1] is not None or len(fixed) != len(ends) - 1:
            raise ValueError(
                f"mesh: every phase but the last needs an end time, the last must be free; got {ends}"
            )
        if any(late <= early for early, late in pairwise([self.start, *fixed])):
            begin = f"{self.start:g} s" if self.start else "zero"
            raise ValueError(f"mesh: phase ends must increase from {begin}, got {fixed} s")

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """All segments in order of time."""
        found: list[Segment] = []
        node, begin = 0, self.start
        for phase in self.phases:
            length = (-begin, 1.0) if phase.end is None else (phase.end - begin, 0.0)
            for degree, (left, right) in zip(phase.degrees, pairwise(phase.cuts), strict=True):
                found.append(
                    Segment(
                        first_node=node,
                        rule=flipped_radau(degree),
                        start=(begin + left * length[0], left * length[1]),
                        half_length=(
                            0.5 * (right - left) * length[0],
                            0.5 * (right - left) * length[1],
                        ),
                    )
                )
                node += degree
            begin = phase.end if phase.end is not None else begin
        return tuple(found)

    def after(self, time: float) -> Mesh:
        """The rest of it from `time` (s) on: phases that are over are dropped, the others keep all."""
        left = tuple(phase for phase in self.phases if phase.end is None or phase.end > time)
        return self if time == self.start else Mesh(left, time)

    @property
    def n_nodes(self) -> int:
        """Number of nodes, the first (not collocated) included."""
        last = self.segments[-1]
        return last.first_node + last.rule.degree + 1

    @cached_property
    def node_time(self) -> tuple[Array, Array]:
        """(a, b) of Eq. (1) at every node: t = a + b t_f."""
        fixed, free = np.zeros(self.n_nodes), np.zeros(self.n_nodes)
        for s in self.segments:
            fixed[s.nodes] = s.start[0] + s.half_length[0] * (1.0 + s.rule.nodes)
            free[s.nodes] = s.start[1] + s.half_length[1] * (1.0 + s.rule.nodes)
        return fixed, free

    def times(self, final_time: float) -> Array:
        """Times of all nodes (s)."""
        fixed, free = self.node_time
        return fixed + free * final_time

    def derivative(self, final_time: float) -> Array:
        """From nodal values to their rates (1/s) at the nodes (nodes × nodes).

        At a node between two segments it is that of the one which ends there.
        """
        matrix = np.zeros((self.n_nodes, self.n_nodes))
        for s in reversed(self.segments):
            half = s.half_length[0] + s.half_length[1] * final_time
            matrix[s.nodes] = 0.0
            matrix[s.nodes, s.nodes] = s.rule.derivative_at(s.rule.nodes) / half
        return matrix

    def conversion(self, times: Array, final_time: float) -> Array:
        """Interpolation matrix (times × nodes): each time is read from the segment it lies in."""
        boundaries = [s.start[0] + s.start[1] * final_time for s in self.segments]
        index = np.searchsorted(boundaries[1:], times, side="right")  # a boundary is a first node
        matrix = np.zeros((len(times), self.n_nodes))
        for k in np.unique(index):
            s, rows = self.segments[k], np.flatnonzero(index == k)
            half = s.half_length[0] + s.half_length[1] * final_time
            tau = (times[rows] - boundaries[k]) / half - 1.0
            matrix[rows, s.nodes] = interpolation_matrix(s.rule.nodes, s.rule.barycentric, tau)
        return matrix
