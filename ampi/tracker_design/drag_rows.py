"""Rows of a drag-tracking law along every optimum: the air loads and how they change, by physics.

In the order of the loads of `ampi.onboard.row_layout.DRAG_TRACKING`:

    ln D,   L/D,   −1/(∂ ln D/∂h),   ∂ ln D/∂α,   range to go

The drag is taken by its logarithm: over an entry it grows a thousandfold, and its logarithm is as smooth
as the altitude, so that it may be interpolated like a state. Derivatives are complex steps through the
same lines of physics that fly, exact to the last bits.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.family import MissionFamily
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import ALTITUDE, LATITUDE, LONGITUDE

Array = NDArray[np.float64]

STEP = 1e-30  # of complex steps: no difference is taken, so it may be that small


def drag_rows(family: MissionFamily, states: Array, times: Array) -> Array:
    """Rows (c, 5, n) of the optima `states` (c, 7 or 8, n; SI, rad) of a family at `times` (c, n; s).

    What is no number comes back as not-a-number.
    """
    model, x = family.flight_model(trailing=1), np.moveaxis(states, 1, 0)
    with np.errstate(all="ignore"):
        air = model.air_loads(x, times)
        over_altitude = _slope(model, [x[ALTITUDE] + STEP * 1j, *x[1:]], times)
        steered = replace(model, angle_of_attack_offset=STEP * 1j)
        radius = model.planet.equatorial_radius
        to_go = great_circle_distance(
            x[LONGITUDE], x[LATITUDE], x[LONGITUDE, :, -1:], x[LATITUDE, :, -1:], radius
        )
        rows = (
            np.log(air.drag),
            air.lift / air.drag,
            -1.0 / over_altitude,
            _slope(steered, x, times),
            to_go,
        )
    return np.stack(rows, axis=1)


def _slope(model: FlightModel, x: Any, times: Array) -> Array:
    """∂ ln D over what carries the complex step."""
    drag = model.air_loads(x, times).drag
    slope: Array = drag.imag / (STEP * drag.real)
    return slope
