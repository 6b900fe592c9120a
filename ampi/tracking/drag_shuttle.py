"""The Space Shuttle's drag tracking, with constant gains.

    (L/D)_vertical = (L/D)_ref cos σ_ref + f₁ (D − D_ref) + f₂ (ḣ − ḣ_ref)                     (1)

at equal energy: too much drag asks for lift upwards, and a descent that is too slow for less of it. The
bank angle's cosine is that over the L/D that is sensed. No observer. Where the angle of attack is
changed as well, D in (1) is the drag that the vehicle would have without: as on the Shuttle, whose bank
angle brings the angle of attack back to its schedule.

References
----------
Harpold & Graves (1979), "Shuttle Entry Guidance", J. Astronautical Sciences 27(3), whose gains follow
the phases of a shuttle entry; here they are numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ampi.tracking.drag_reference import (
    BANK,
    FLIGHT_PATH_ANGLE,
    LIFT_TO_DRAG,
    LOG_DRAG,
    SPEED,
    DragReference,
    Sensed,
)
from ampi.tracking.law import Told

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DragShuttle(DragReference):
    """Eq. (1). Gains were found on tuning draws of SHEFEX-3, in the worlds entry and everything."""

    name: ClassVar[str] = "drag_shuttle"
    senses: ClassVar[bool] = True

    drag_gain: float = 0.05  # s²/m, f₁
    descent_gain: float = -0.007  # s/m, f₂

    def memory(self, n: int) -> Array:
        """The side that turns back."""
        return np.zeros((1, n))

    def command(self, at: Array, told: Told, memory: Array) -> tuple[Array, Array]:
        """Bank rate of Eq. (1) with the lateral logic, and δα of `DragReference`."""
        sensed = Sensed.of(at, told)
        reference, drag, error = np.exp(at[LOG_DRAG]), sensed.drag, told.change
        if self.modulates:
            error = self.error(at, sensed, told.change)
            drag = reference * np.exp(error)
        climb = told.state[SPEED] * np.sin(told.state[FLIGHT_PATH_ANGLE])
        climb = climb - at[SPEED] * np.sin(at[FLIGHT_PATH_ANGLE])
        vertical = at[LIFT_TO_DRAG] * np.cos(at[BANK])
        vertical = vertical + self.drag_gain * (drag - reference) + self.descent_gain * climb
        cosine = vertical * sensed.drag / sensed.lift
        rate = self.steered(at, told, self.size(at, sensed, cosine), memory[0])
        return rate, self.modulation(at, sensed, error, cosine)
