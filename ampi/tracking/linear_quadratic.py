"""Time-varying linear-quadratic tracking of a reference.

    u = u_ref(t) − K(t) (x − x_ref(t)),   δα = −K_α(t) (x − x_ref(t))             (1)

u is the bank rate; δα, the change of the angle of attack, is asked for by a law that modulates. K and
K_α come with the reference: interpolated rows of the table, like any state, so nothing that flies
differentiates a model. The functions work on one flight or on a batch.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.row_layout import LINEAR_TRACKING, STEERED_TRACKING, RowLayout
from ampi.tracking.law import Told

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
    return bank_rate - (gain * deviation(state, reference_state)).sum(axis=0)


def deviation(state: Array, reference_state: Array) -> Array:
    """x − x_ref of Eq. (1), shapes and units as of `bank_rate_command`."""
    error = state - reference_state
    error[LONGITUDE] = wrapped(error[LONGITUDE])
    error[AZIMUTH] = wrapped(error[AZIMUTH])
    return error


@dataclass(frozen=True)
class LinearQuadratic:
    """Eq. (1) with the reference looked up over time."""

    name: ClassVar[str] = "linear_quadratic"
    senses: ClassVar[bool] = False

    modulates: bool = field(default=False, repr=False)

    @property
    def layout(self) -> RowLayout:
        """With gains of both controls, if it modulates."""
        return STEERED_TRACKING if self.modulates else LINEAR_TRACKING

    def memory(self, n: int) -> Array:
        """None is needed."""
        return np.zeros((0, n))

    def along(self, times: Array, rows: Array) -> Array | None:
        """The time."""
        return None

    def now(self, clock: Any, told: Told) -> Any:
        """The time."""
        return clock

    def command(self, at: Array, told: Told, memory: Array) -> tuple[Array, Array]:
        """Eq. (1)."""
        layout = self.layout
        error = deviation(told.state, at[layout.states])
        rate = at[layout.bank_rate] - (at[layout.gains] * error).sum(axis=0)
        if not self.modulates:
            return rate, np.zeros_like(rate)
        return rate, -(at[layout.angle_gains] * error).sum(axis=0)
