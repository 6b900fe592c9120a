"""Trajectory: one optimum on its mesh. The word that all rooms share."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.pseudospectral.mesh import Mesh

Array = NDArray[np.float64]


class Status(IntEnum):
    """How a solve ended. The numbers are stored in the database and never change their meaning."""

    SOLVED = 0
    TARGET_MISSED = 1
    LIMITS_EXCEEDED = 2
    ITERATION_LIMIT = 3
    STALLED = 4
    SUBPROBLEM_FAILED = 5
    GUESS_FAILED = 6
    ERROR = 7
    REFINEMENT_LIMIT = 8

    @property
    def sentence(self) -> str:
        """One sentence for logs, files and pages."""
        return _SENTENCES[self]

    @property
    def ok(self) -> bool:
        """Whether the trajectory may enter a guidance table."""
        return self is Status.SOLVED

    @property
    def converged(self) -> bool:
        """Whether the last iterate is a flight, and worth flying again; others need not be."""
        return self in (
            Status.SOLVED,
            Status.TARGET_MISSED,
            Status.LIMITS_EXCEEDED,
            Status.REFINEMENT_LIMIT,
        )


_SENTENCES = {
    Status.SOLVED: "Converged: optimal, the target met within its tolerances, every limit kept.",
    Status.TARGET_MISSED: "Converged, but the target is out of reach; this flight ends near it.",
    Status.LIMITS_EXCEEDED: "Converged, but a path limit cannot be kept; the excess is reported.",
    Status.ITERATION_LIMIT: "Stopped at the iteration limit before the step became small.",
    Status.STALLED: "Stopped: the trust region collapsed without a step that improves the merit.",
    Status.SUBPROBLEM_FAILED: "Stopped: the convex subproblem returned no usable step.",
    Status.GUESS_FAILED: "Not started: the initial guess could not be flown on this mesh.",
    Status.REFINEMENT_LIMIT: "Converged, but mesh refinement reached a cap before its tolerance.",
    Status.ERROR: "Not solved: the case raised an error; see its log.",
}


@dataclass(frozen=True)
class IterationRecord:
    """One row of the convergence log."""

    iteration: int
    cost: float
    merit: float
    step: float  # ‖δσ‖_∞ (exact_hessian) or of longitude and latitude (literature), rad
    final_time: float  # s
    trust_radius: float  # rad
    ratio: float  # actual over predicted reduction
    accepted: bool
    subproblem: str


@dataclass(frozen=True)
class RefinementRound:
    """One mesh of a refinement and what an independent look at its solution found."""

    nodes: int
    segments: int
    iterations: int
    solve_seconds: float
    cost: float
    state_error: float  # greatest over the segments, over 10 km, 1 rad, 1 km/s
    limit_excess: float  # greatest g − 1 between the nodes; negative where all limits are kept


@dataclass(frozen=True)
class Statistics:
    """What a solve cost."""

    iterations: int = 0
    solve_seconds: float = 0.0
    subproblem_seconds: float = 0.0
    limit_excess: tuple[float, ...] = (0.0, 0.0, 0.0)  # relative, per path limit
    log: tuple[IterationRecord, ...] = field(default=(), repr=False)
    rounds: tuple[RefinementRound, ...] = ()  # of mesh refinement, the first mesh included


@dataclass(frozen=True)
class Trajectory:
    """States, control and final time at the mesh nodes (SI, rad), with how they were found."""

    mesh: Mesh
    states: Array  # (7, n_nodes): h, θ, φ, V, γ, ψ, σ
    bank_rate: Array  # (n_nodes,), rad/s
    final_time: float  # s
    cost: float
    status: Status
    statistics: Statistics = Statistics()
    target_multipliers: Array | None = None  # (rows of the target,), cost per SI unit of e

    @property
    def times(self) -> Array:
        """Times of the nodes (s)."""
        return self.mesh.times(self.final_time)

    def at(self, times: ArrayLike) -> tuple[Array, Array]:
        """States (7, n) and bank rate (n,) at `times` (s), by the mesh's own polynomials."""
        matrix = self.mesh.conversion(np.atleast_1d(np.asarray(times, float)), self.final_time)
        return self.states @ matrix.T, matrix @ self.bank_rate

    def summary(self) -> dict[str, Any]:
        """Plain numbers for printing (degrees, kilometres)."""
        h, lon, lat, v = self.states[:4, -1]
        return {
            "status": self.status.name,
            "iterations": self.statistics.iterations,
            "cost": self.cost,
            "final_time_s": self.final_time,
            "final_altitude_km": h / 1e3,
            "final_longitude_deg": float(np.degrees(lon)),
            "final_latitude_deg": float(np.degrees(lat)),
            "final_speed_m_per_s": v,
            "greatest_limit_excess": max(self.statistics.limit_excess),
            "solve_seconds": self.statistics.solve_seconds,
        }
