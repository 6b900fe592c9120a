"""Rows that follow from an optimum, differentiated along with it: gains, loads of a drag-tracking law.

Such a row is a function r(x, t_f, p) of nodal states, final time and the mission's numbers. With the
sensitivities of the optimum (`ampi.scp.sensitivities`) its derivative over p is the one along the
tangent of the family of optima,

    dr/dp = [ r(x + ε ∂x/∂p, t_f + ε ∂t_f/∂p, p + ε) − r(x, t_f, p) ] / ε                 (1)

for any such row by the same line, and without an optimum solved again. One side is enough: ε is small.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission

Array = NDArray[np.float64]
Rows = Callable[[MissionFamily[Mission], Array, Array], Array]

STEP = (
    1e-6  # ε, of the extent of the parameter's axis: off by about as much of what the row changes
)


@dataclass(frozen=True, eq=False)
class Tangent:
    """c optima of a mission and how they move with its d parameters."""

    mission: Mission
    points: Array  # p, (c, d; SI, rad)
    states: Array  # (c, 7 or 8, n)
    final_time: Array  # (c,)
    states_by_p: Array  # (c, d, 7 or 8, n)
    final_time_by_p: Array  # (c, d)

    def derivative(self, rows: Rows, here: Array) -> Array:
        """Eq. (1) of `rows(family, states, final_time)`, which are `here` (c, r, n) at the optima.

        (c, d, r, n), SI per SI unit of p; NaN where the optimum has no sensitivities.
        """
        found = []
        for i, parameter in enumerate(self.mission.parameters):
            step = STEP * float(np.ptp(parameter.axis))
            moved = self.points.copy()
            moved[:, i] += step
            step_taken = moved[:, i] - self.points[:, i]  # ε as the floating point has it
            states = self.states + step_taken[:, None, None] * self.states_by_p[:, i]
            final_time = self.final_time + step_taken * self.final_time_by_p[:, i]
            with np.errstate(all="ignore"):  # what is no number comes back as none
                there = rows(self.mission.family(moved), states, final_time)
            found.append((there - here) / step_taken[:, None, None])
        return np.stack(found, axis=1)
