"""What the accelerometer should sense, how it depends on the estimate, and how well it is known.

With F(θ) = (along, up, right) sensed at the told state, H = ∂F/∂θ: of both parts of ln k_D it is F
itself, of ln (k_L/k_D) the part of the lift, of winds and angle of attack one-sided differences.

What navigation tells with an error e of standard deviation s moves F by g e. To first order in e

    altitude        g = F / H_s        density falls e-fold over H_s
    speed           g = 2 F / V
    path angle      g = (U, −A, 0)     the axes turn about the right, F = (A, U, S) stays
    azimuth         g = (S cos γ, −S sin γ, U sin γ − A cos γ)        … about the vertical
    bank angle      g = (0, −S, U)     the lift turns about the velocity
    angle of attack g = ∂F/∂d          where it is not known how much of a command has been flown

    R = Σ s² g gᵀ + ((relative |F|)² + floor²) I.                                                  (1)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.estimation.estimate import ATTACK, EAST, ESTIMATED, LIFT, LOCAL, LOG_DRAG, NORTH
from ampi.estimation.settings import EstimatorSettings
from ampi.onboard.flight_model import PATH_ANGLE, SPEED, Factors, FlightModelData

Array = NDArray[np.float64]

WIND_STEP = 1.0  # m/s, of the differences
ATTACK_STEP = 1e-3  # rad


@dataclass(frozen=True, eq=False)
class Expected:
    """F (3, n), H (3, 6, n) and R (3, 3, n)."""

    sensed: Array
    slopes: Array
    noise: Array


@dataclass(frozen=True, eq=False)
class Measurement:
    """The flight model and what is uncertain beside θ."""

    model: FlightModelData
    settings: EstimatorSettings

    def expected(
        self, mean: Array, time: Any, state: Array, change: Array, unsure: Array
    ) -> Expected:
        """At θ `mean` (6, n), as the state (7, n) is told at `time` (s).

        `change` of the angle of attack (rad) is being flown, uncertain by `unsure` (rad), (n,) both.
        """
        base, *moved = self._sensed(mean, time, state, change)
        slopes = np.empty((3, len(ESTIMATED), state.shape[1]))
        slopes[:, LOG_DRAG] = slopes[:, LOCAL] = base
        for row, step, beside in zip(
            (LIFT, EAST, NORTH, ATTACK),
            (1.0, WIND_STEP, WIND_STEP, ATTACK_STEP),
            moved,
            strict=True,
        ):
            slopes[:, row] = (beside - base) / step
        return Expected(base, slopes, self._noise(base, slopes[:, ATTACK], state, unsure))

    def _sensed(self, mean: Array, time: Any, state: Array, change: Array) -> Array:
        """F (5, 3, n): at θ, with twice the lift, and a step away in both winds and the angle."""
        lift, east, north, angle = np.repeat(mean[LIFT:, None], 5, axis=1)
        lift = np.exp(lift)
        lift[1] *= 2.0  # F is linear in the factor: no step is small
        east[2] += WIND_STEP
        north[3] += WIND_STEP
        angle += change
        angle[4] += ATTACK_STEP
        factors = Factors(
            density=np.exp(mean[LOG_DRAG] + mean[LOCAL]),
            lift=lift,
            wind_east=east,
            wind_north=north,
            angle_of_attack=angle,
        )
        return np.stack(self.model.sensed(state[:, None], time, factors), axis=1)

    def _noise(self, sensed: Array, attack: Array, state: Array, unsure: Array) -> Array:
        """R of Eq. (1)."""
        own, (along, up, right) = self.settings, sensed
        sine, cosine, still = (
            np.sin(state[PATH_ANGLE]),
            np.cos(state[PATH_ANGLE]),
            np.zeros_like(up),
        )
        directions = np.stack(
            [
                sensed * (own.altitude / own.scale_height),
                sensed * (2.0 * own.speed / state[SPEED]),
                own.angle * np.stack([up, -along, still]),
                own.angle * np.stack([right * cosine, -right * sine, up * sine - along * cosine]),
                own.angle * np.stack([still, -right, up]),
                unsure * attack,
            ]
        )
        noise = np.einsum("kin,kjn->ijn", directions, directions)
        squares = along * along + up * up + right * right
        for row in range(3):
            noise[row, row] += own.relative * own.relative * squares + own.floor * own.floor
        return noise
