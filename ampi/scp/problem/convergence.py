"""When the iteration has converged, and what the result is called.

The step decides, not the subproblem's own status: asked for steps far below its tolerance a conic
solver reports insufficient progress. A small step alone would not do either: the excess of the limits
and the distance to the target are looked at before the word "solved" is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.final_states import HORIZONTAL_TOLERANCE
from ampi.missions.path_limits import KEPT
from ampi.physics.planet import great_circle_distance
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.trajectory import Status

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ConvergenceSettings:
    """`step`: ‖(δσ, δt_f)‖_∞ (rad, scaled) of the step that ends the iteration.

    The iteration is Newton's there, so the error left behind is about the square of it.
    """

    step: float = 3e-4
    limit_excess: float = KEPT  # relative excess of a path limit at the nodes
    horizontal_miss: float = HORIZONTAL_TOLERANCE  # m: beyond, the target counts as missed


def converged_status(
    settings: ConvergenceSettings,
    problem: OptimalControlProblem,
    final: Array,
    excess: Array,
    *,
    bought_off: bool,
) -> Status:
    """Status of a converged iterate; `final` is the scaled final state (7,).

    `bought_off` says that the elastic target still is: then the iterate does not minimise the cost.
    """
    if not np.all(excess <= settings.limit_excess):  # NaN too
        return Status.LIMITS_EXCEEDED
    error = np.zeros(len(final))
    error[problem.target.state] = problem.target.miss(problem.target.error(final))
    there = final - error
    miss = great_circle_distance(final[1], final[2], there[1], there[2], problem.planet_radius)
    near = np.all(np.abs(error[[0, 3]]) <= problem.target_tolerance)
    if bought_off or not (near and miss <= settings.horizontal_miss):
        return Status.TARGET_MISSED
    return Status.SOLVED
