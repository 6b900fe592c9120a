"""All numbers that steer the condensed method; none depends on the mission."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from ampi.scp.condensed.curvature import CurvatureSettings
from ampi.scp.condensed.elastic_target import ElasticSettings
from ampi.scp.condensed.iterate import RestorationSettings
from ampi.scp.condensed.merit_weights import ReliefSettings
from ampi.scp.condensed.trust_region import TrustRegionSettings
from ampi.scp.problem.convergence import ConvergenceSettings
from ampi.scp.problem.penalty import PenaltySettings
from ampi.scp.problem.sensible import require_sensible


@dataclass(frozen=True, kw_only=True)
class NewtonSettings:
    """Of Newton's iteration beside a solved neighbour (newton)."""

    iterations: int = 6  # with matrices of their own
    simplified_steps: int = 5  # with the same matrices, at most, and only while they contract so:
    fast: float = 0.1
    contraction: float = 0.5  # of the step from one iteration to the next, at least
    largest_step: float = 0.3  # rad: what is farther away is no neighbour
    exchanges: int = 5  # of all limits that should be held or not, with the same matrices; then
    dual_steps: int = 40  # at most, which let them come and go one by one
    limit_error: float = 1e-6  # of a limit at a solution, relative


@dataclass(frozen=True, kw_only=True)
class SolverSettings:
    """Iteration budget and time limit of one solve, and the settings of its parts."""

    max_iterations: int = 300
    time_limit: float | None = None  # s, of one solve, looked at between iterations; None: none
    corrections: int = 3  # second-order, per step; one where the whole target is soft
    patience: int = 40  # iterations given to a raised price or penalty before it counts as vain
    trust_region: TrustRegionSettings = field(default_factory=TrustRegionSettings)
    elastic: ElasticSettings = field(default_factory=ElasticSettings)
    penalty: PenaltySettings = field(default_factory=PenaltySettings)
    relief: ReliefSettings = field(default_factory=ReliefSettings)
    curvature: CurvatureSettings = field(default_factory=CurvatureSettings)
    restoration: RestorationSettings = field(default_factory=RestorationSettings)
    convergence: ConvergenceSettings = field(default_factory=ConvergenceSettings)
    newton: NewtonSettings = field(default_factory=NewtonSettings)

    def __post_init__(self) -> None:
        require_sensible("settings", self)

    def is_over(self, began: float) -> bool:
        """Whether a solve that `began` then (s, of the performance counter) has had its time."""
        return self.time_limit is not None and time.perf_counter() - began > self.time_limit
