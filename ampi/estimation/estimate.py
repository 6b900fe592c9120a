"""What the estimator has found of n flights, and what it says at other altitudes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.estimation.settings import EstimatorSettings
from ampi.onboard.flight_model import Factors

Array = NDArray[np.float64]

# θ: ln k_D, the constant part and the local one; ln (k_L / k_D); wind towards east and north (m/s);
# error of the angle of attack (rad)
ESTIMATED = ("log_drag", "local_log_drag", "log_lift_to_drag", "wind_east", "wind_north", "angle")
LOG_DRAG, LOCAL, LIFT, EAST, NORTH, ATTACK = range(len(ESTIMATED))


@dataclass(frozen=True, eq=False)
class Estimate:
    """Mean and covariance of θ, in the order of `ESTIMATED`, of n flights.

    k_D multiplies lift and drag alike (density, drag coefficient and mass in one), k_L / k_D the lift on
    top. Their reference is the model's air at the altitude that navigation tells: a bias of the altitude
    is part of k_D.
    """

    mean: Array  # (6, n)
    covariance: Array  # (6, 6, n)
    altitude: Array  # (n,) m, where it holds
    settings: EstimatorSettings

    @property
    def deviation(self) -> Array:
        """Standard deviations (6, n)."""
        return np.sqrt(np.einsum("iin->in", self.covariance))

    def at(self, altitude: Array | float) -> Factors:
        """What is expected at `altitude` (m), a number or (n,): what is local fades with distance."""
        away = np.abs(altitude - self.altitude)
        calm = np.exp(-away / self.settings.wind_length)
        local = self.mean[LOCAL] * np.exp(-away / self.settings.length)
        return Factors(
            density=np.exp(self.mean[LOG_DRAG] + local),
            lift=np.exp(self.mean[LIFT]),
            wind_east=self.mean[EAST] * calm,
            wind_north=self.mean[NORTH] * calm,
            angle_of_attack=self.mean[ATTACK],
        )
