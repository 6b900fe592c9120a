"""Trajectory: one optimum on its mesh. The word that all rooms share."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.missions.path_limits import KEPT
from ampi.outcome import Outcome
from ampi.physics.state import ANGLE_OF_ATTACK, BANK, N_STATES
from ampi.pseudospectral.mesh import Mesh
from ampi.shown import Tabulated

Array = NDArray[np.float64]

POSITION_TOLERANCE = 50.0  # m: a flight farther from the nodes is not the one that was optimised


class Status(Outcome):
    """How a solve ended. The numbers are stored in the database and never change their meaning."""

    SOLVED = (
        0,
        "Converged: optimal, the target met within its tolerances, every limit kept.",
    )
    TARGET_MISSED = 1, "Converged, but the flight ends outside the tolerances of the target."
    LIMITS_EXCEEDED = 2, "Converged, but a path limit cannot be kept; the excess is reported."
    ITERATION_LIMIT = 3, "Stopped at the iteration limit before the step became small."
    STALLED = (
        4,
        "Stopped: the trust region collapsed without a step that improves the merit.",
    )
    SUBPROBLEM_FAILED = 5, "Stopped: the convex subproblem returned no usable step."
    GUESS_FAILED = 6, "Not started: the initial guess could not be flown on this mesh."
    ERROR = 7, "Not solved: the case raised an error; see its log."
    REFINEMENT_LIMIT = 8, "Converged, but mesh refinement reached a cap before its tolerance."
    INACCURATE = (
        9,
        "Converged at the nodes, but between them the flight is another, or exceeds a limit: "
        "refine the mesh, or ask for a margin.",
    )
    TIME_LIMIT = 10, "Stopped at the time limit before the step became small."

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
            Status.INACCURATE,
        )


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
class GuessTried:
    """One of several first guesses, and how the solve from it ended."""

    bank_angle: float  # rad
    status: Status
    iterations: int
    cost: float
    chosen: bool


@dataclass(frozen=True)
class FlightCheck:
    """What flying a trajectory again under its own bank angle found (ampi.propagation)."""

    position_error: float  # m, greatest over the nodes, as the others; infinite: it cannot be flown
    altitude_error: float  # m
    speed_error: float  # m/s
    use: dict[str, float]  # of each limit, greatest between the nodes

    @property
    def exceeded(self) -> dict[str, float]:
        """The limits that are not kept, with their use."""
        return {name: use for name, use in self.use.items() if not use <= 1.0 + KEPT}

    @property
    def accurate(self) -> bool:
        """Whether the flight is the one that was optimised, and keeps every limit."""
        return self.position_error <= POSITION_TOLERANCE and not self.exceeded


@dataclass(frozen=True)
class Statistics:
    """What a solve cost."""

    iterations: int = 0
    solve_seconds: float = 0.0
    subproblem_seconds: float = 0.0
    limit_excess: tuple[float, ...] = (0.0, 0.0, 0.0)  # relative, per path limit
    log: tuple[IterationRecord, ...] = field(default=(), repr=False)
    rounds: tuple[RefinementRound, ...] = ()  # of mesh refinement, the first mesh included
    flight: FlightCheck | None = None  # None: not flown again
    guesses: tuple[
        GuessTried, ...
    ] = ()  # where the first one failed; the rest is of the chosen one


@dataclass(frozen=True)
class Trajectory(Tabulated):
    """States, control and final time at the mesh nodes (SI, rad), with how they were found."""

    mesh: Mesh
    states: Array  # (7, n_nodes): h, θ, φ, V, γ, ψ, σ; (8, n_nodes) with α where it is a control
    bank_rate: Array  # (n_nodes,), rad/s
    final_time: float  # s
    cost: float
    status: Status
    statistics: Statistics = Statistics()
    target_multipliers: Array | None = None  # (rows of the target,), cost per SI unit of e
    angle_of_attack_rate: Array | None = None  # (n_nodes,), rad/s; None where α is scheduled

    @classmethod
    def none(cls, mesh: Mesh, status: Status, n_states: int = N_STATES) -> Trajectory:
        """What stands for a flight that there is not: no number in it."""
        states = np.full((n_states, mesh.n_nodes), np.nan)
        angle_rate = states[0] if n_states > N_STATES else None
        return cls(mesh, states, states[0], np.nan, np.nan, status, angle_of_attack_rate=angle_rate)

    @property
    def controls(self) -> Array:
        """Rates (m, n_nodes; rad/s) of the bank angle and, if it is a control, the angle of attack."""
        angle_rate = self.angle_of_attack_rate
        rows = [self.bank_rate] if angle_rate is None else [self.bank_rate, angle_rate]
        return np.stack(rows[: len(self.states) - BANK])

    @property
    def times(self) -> Array:
        """Times of the nodes (s)."""
        return self.mesh.times(self.final_time)

    def at(self, times: ArrayLike) -> tuple[Array, Array]:
        """States (7 or 8, n) and bank rate (n,) at `times` (s), by the mesh's own polynomials."""
        matrix = self.mesh.conversion(np.atleast_1d(np.asarray(times, float)), self.final_time)
        return self.states @ matrix.T, matrix @ self.bank_rate

    def controls_at(self, times: ArrayLike) -> Array:
        """`controls` (m, n) at `times` (s), by the same."""
        matrix = self.mesh.conversion(np.atleast_1d(np.asarray(times, float)), self.final_time)
        return self.controls @ matrix.T

    def judged_by(self, flight: FlightCheck) -> Trajectory:
        """With what its flight found: solved only if that is the flight of the nodes."""
        false = self.status is Status.SOLVED and not flight.accurate
        return replace(
            self,
            status=Status.INACCURATE if false else self.status,
            statistics=replace(self.statistics, flight=flight),
        )

    def summary(self) -> dict[str, Any]:
        """Plain numbers for printing (degrees, kilometres)."""
        h, lon, lat, v = self.states[:4, -1]
        angles = np.degrees(self.states[ANGLE_OF_ATTACK:])
        steered = {}
        if len(angles):
            steered = {
                "least_angle_of_attack_deg": float(angles.min()),
                "greatest_angle_of_attack_deg": float(angles.max()),
            }
        flight = self.statistics.flight
        flown = {}
        if flight is not None:
            flown = {
                "reintegrated_position_error_m": flight.position_error,
                "reintegrated_altitude_error_m": flight.altitude_error,
                "reintegrated_speed_error_m_per_s": flight.speed_error,
                "greatest_limit_use": max(flight.use.values()),
            }
        return {
            "status": self.status.name,
            "iterations": self.statistics.iterations,
            "cost": self.cost,
            "final_time_s": self.final_time,
            "final_altitude_km": h / 1e3,
            "final_longitude_deg": float(np.degrees(lon)),
            "final_latitude_deg": float(np.degrees(lat)),
            "final_speed_m_per_s": v,
            **steered,
            "greatest_limit_excess": max(self.statistics.limit_excess),
            "solve_seconds": self.statistics.solve_seconds,
            **flown,
        }
