"""What is known of vehicle and air in flight: the factors that a table has axes for, and the wind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ampi.estimation.estimate import ATTACK, EAST, LIFT, LOCAL, LOG_DRAG, NORTH
from ampi.estimation.estimator import Estimator
from ampi.estimation.settings import EstimatorSettings
from ampi.onboard.flight_model import FlightModelData
from ampi.reselection.settings import ReselectionSettings

Array = NDArray[np.float64]

MACH = 5.0  # [X] at which coefficients that depend on it are compared


@dataclass(frozen=True, eq=False)
class Found:
    """Of n flights, (n,) each."""

    density: Array  # factor on lift and drag alike
    lift: Array  # factor on the lift on top
    east: Array  # m/s, of the wind
    north: Array


class KnownAir(Protocol):
    """Who tells it: an estimator, or in a test one who knows."""

    def begin(self, n: int) -> None:
        """n flights begin."""
        ...

    def update(self, time: float, navigated: Array, sensed: Array) -> None:
        """One cycle: navigation (8, n) and sensed accelerations (3, n)."""
        ...

    def found(self) -> Found:
        """What is known now."""
        ...


class EstimatedAir:
    """The estimator's word; an error of the angle of attack is told as the coefficients it changes."""

    def __init__(
        self,
        model: FlightModelData,
        settings: ReselectionSettings,
        estimator: EstimatorSettings | None = None,
    ) -> None:
        self._model, self._settings = model, settings
        self._own = EstimatorSettings() if estimator is None else estimator
        self.begin(1)

    def begin(self, n: int) -> None:
        """Nothing has been sensed of n flights."""
        self.estimator = Estimator(self._model, self._own, n)

    def update(self, time: float, navigated: Array, sensed: Array) -> None:
        """As `Estimator.update`."""
        self.estimator.update(time, navigated, sensed)

    def found(self) -> Found:
        """The mean, at the angle of attack that the schedule ends with."""
        mean, model, share = self.estimator.estimate.mean, self._model, self._settings
        angle = model.angle_of_attack.end_angle
        lift, drag = model.aerodynamics.coefficients(angle, MACH)
        with np.errstate(all="ignore"):
            off = model.aerodynamics.coefficients(angle + mean[ATTACK], MACH)
            resists, lifts = off[1] / drag, off[0] / lift
            density = np.exp(mean[LOG_DRAG] + share.local * mean[LOCAL]) * resists
            wind = share.wind * mean[[EAST, NORTH]]
            return Found(density, np.exp(mean[LIFT]) * lifts / resists, wind[0], wind[1])
