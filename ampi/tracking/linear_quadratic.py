"""Time-varying linear-quadratic tracking of a reference.

    u = u_ref(t) − K(t) (x − x_ref(t))                                           (1)

u is the bank rate. K comes with the reference: interpolated rows of the table, like any state, so
nothing that flies differentiates a model. The function works on one flight or on a batch.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LONGITUDE, AZIMUTH = 1, 5


def wrapped(angle: Any) -> Any:
    """`angle` (rad) in [−π, π): a difference of longitudes or azimuths may cross the date line."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def bank_rate_command(state: Array, reference_state: Array, bank_rate: Any, gain: Array) -> Any:
    """Eq. (1), rad/s.

    Parameters
    ----------
    state, reference_state, gain
        (7,) or (7, flights); SI, rad.
    bank_rate
        u_ref (rad/s), scalar or (flights,).
    """
    error = state - reference_state
    error[LONGITUDE] = wrapped(error[LONGITUDE])
    error[AZIMUTH] = wrapped(error[AZIMUTH])
    return bank_rate - (gain * error).sum(axis=0)
