"""An extended Kalman filter of what is wrong with the model, fed with sensed accelerations.

θ = (a, c, r, w_E, w_N, d) of `ESTIMATED`, mean m and covariance P, of n flights. Over a time Δt in which
the altitude changes by Δh = |V sin γ| Δt, what is local to an altitude is a first-order Markov process,

    c, w:     m ← f m,  P ← F P F,  P_ii += s_i² (1 − f²),    f = exp(−Δh/L)                       (1)
    a, r, d:  P_ii += q_i Δt

and a measurement z with F, H and R of measurement.py is

    ν = z − F,   S = H P Hᵀ + R = L Lᵀ,   W = L⁻¹ H P,   m += Wᵀ L⁻¹ ν,   P −= Wᵀ W:               (2)

P stays symmetric to the bit. A measurement is not used where the air is too thin, where anything is no
number, where all three components are those of before to the bit (a stuck accelerometer), and where
νᵀ S⁻¹ ν is beyond a gate. If nothing but that comes for a time, the model has changed: P returns to its
first value, and m stays.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.estimation.estimate import ESTIMATED, Estimate
from ampi.estimation.measurement import Expected, Measurement
from ampi.estimation.settings import EstimatorSettings
from ampi.onboard.flight_model import ALTITUDE, PATH_ANGLE, SPEED, FlightModelData
from ampi.onboard.plausibility import SANE

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST = np.array([1.0, 1.0, 1.0, 200.0, 200.0, 0.1])[:, None]  # what θ is kept within: m/s, rad
COUNTED = ("used", "weak", "unusable", "stuck", "gated", "reset")


class Estimator:
    """The filter of n flights."""

    def __init__(self, model: FlightModelData, settings: EstimatorSettings, n: int) -> None:
        self.settings = settings
        self._measurement = Measurement(model, settings)
        self._variance = np.square(settings.prior)[:, None]
        self._walk = np.array(settings.walk)[:, None]
        self._lengths = np.array([settings.length] + 2 * [settings.wind_length])[:, None]
        self._mean = np.empty((len(ESTIMATED), n))
        self._covariance = np.empty((len(ESTIMATED), len(ESTIMATED), n))
        self._keep = np.ones((len(ESTIMATED), n))
        self._last = np.empty((3, n))
        self._time, self._altitude, self._gated_since, self.nis = np.empty((4, n))
        self.counts = {name: np.zeros(n, dtype=np.int64) for name in COUNTED}
        self.reset()

    def reset(self) -> None:
        """Nothing has been sensed."""
        self._mean[:] = 0.0
        self._forget(np.ones(len(self.nis), dtype=bool))
        self._altitude[:] = 0.0
        for unknown in (self._last, self._time, self._gated_since, self.nis):
            unknown[:] = np.nan
        for count in self.counts.values():
            count[:] = 0

    @property
    def estimate(self) -> Estimate:
        """What has been found; the arrays are its own."""
        mean, covariance = self._mean.copy(), self._covariance.copy()
        return Estimate(mean, covariance, self._altitude.copy(), self.settings)

    def update(
        self, time: Any, navigated: Array, sensed: Array, change: Any = 0.0, unsure: Any = 0.0
    ) -> None:
        """One cycle.

        Parameters
        ----------
        time
            Since the entry interface (s), a number or (n,).
        navigated
            States (7, n) as navigation tells them, the first seven of its rows.
        sensed
            Acceleration (3, n) along the velocity over the ground, upwards and to its right (m/s²).
        change
            Of the angle of attack that is flown (rad), a number or (n,).
        unsure
            Its standard deviation (rad): a command is not what is flown.
        """
        state = navigated[:7]
        with np.errstate(all="ignore"):
            told = np.all(np.abs(state) < SANE, axis=0) & (np.abs(time) < SANE)
            self._pass(time, state, told)
            usable = self._usable(sensed, told)
            self.nis[:] = np.nan
            if usable.any():
                expected = self._measurement.expected(
                    self._mean, time, state, np.asarray(change), np.asarray(unsure)
                )
                self._learn(expected, sensed, usable)

    def _pass(self, time: Any, state: Array, told: Mask) -> None:
        """Eq. (1) up to `time`, of those whose state is told."""
        passed = np.where(told & (time > self._time), time - self._time, 0.0)
        climbed = np.abs(state[SPEED] * np.sin(state[PATH_ANGLE])) * passed
        fade = np.exp(-np.where(told, climbed, 0.0) / self._lengths)
        keep = self._keep
        keep[1], keep[3:5] = fade[0], fade[1:]
        self._mean *= keep
        self._covariance *= keep[:, None] * keep
        growth = self._variance * (1.0 - keep * keep) + self._walk * passed
        np.einsum("iin->in", self._covariance)[:] += growth
        np.copyto(self._time, time, where=told)
        np.copyto(self._altitude, state[ALTITUDE], where=told)

    def _usable(self, sensed: Array, told: Mask) -> Mask:
        """Of which flights the measurement says something; the others are counted."""
        known = told & np.all(np.abs(sensed) < SANE, axis=0)
        stuck = known & np.all(sensed == self._last, axis=0)
        weak = ~np.greater_equal(np.square(sensed).sum(axis=0), self.settings.weakest**2)
        np.copyto(self._last, sensed, where=told)
        self.counts["unusable"] += ~known
        self.counts["stuck"] += stuck
        self.counts["weak"] += known & ~stuck & weak
        return known & ~stuck & ~weak

    def _learn(self, expected: Expected, sensed: Array, usable: Mask) -> None:
        """Eq. (2), of those that pass the gate."""
        part = np.einsum("ikn,kjn->ijn", expected.slopes, self._covariance)
        innovation = sensed - expected.sensed
        factor = _cholesky(np.einsum("ikn,jkn->ijn", part, expected.slopes) + expected.noise)
        innovation = _forward(factor, innovation)
        np.copyto(self.nis, np.square(innovation).sum(axis=0), where=usable)
        passes = self.nis <= self.settings.gate  # what is no number does not
        gain = _forward(factor, part)
        change = np.einsum("ikn,in->kn", gain, innovation)
        learnt = np.einsum("ikn,ijn->kjn", gain, gain)
        np.add(self._mean, change, out=self._mean, where=passes)
        np.subtract(self._covariance, learnt, out=self._covariance, where=passes)
        np.minimum(np.maximum(self._mean, -MOST), MOST, out=self._mean)
        self.counts["used"] += passes
        self._gate(usable & ~passes, passes)

    def _gate(self, gated: Mask, passes: Mask) -> None:
        """Those beyond the gate are counted, and forget after a while what they knew."""
        since = np.where(np.isnan(self._gated_since), self._time, self._gated_since)
        np.copyto(self._gated_since, since, where=gated)
        late = gated & (self._time - self._gated_since >= self.settings.patience)
        self._forget(late)
        self._gated_since[passes | late] = np.nan
        self.counts["gated"] += gated
        self.counts["reset"] += late

    def _forget(self, flights: Mask) -> None:
        self._covariance[:, :, flights] = (np.eye(len(ESTIMATED)) * self._variance)[:, :, None]


def _cholesky(s: Array) -> list[list[Array]]:
    """The lower triangle L of n matrices (3, 3, n); not-a-number where one is not positive."""
    a = np.sqrt(s[0, 0])
    b, c = s[1, 0] / a, s[2, 0] / a
    d = np.sqrt(s[1, 1] - b * b)
    e = (s[2, 1] - c * b) / d
    return [[a], [b, d], [c, e, np.sqrt(s[2, 2] - c * c - e * e)]]


def _forward(factor: list[list[Array]], right: Array) -> Array:
    """L⁻¹ of right sides (3, …, n)."""
    (a,), (b, d), (c, e, f) = factor
    x = right[0] / a
    y = (right[1] - b * x) / d
    return np.stack([x, y, (right[2] - c * x - e * y) / f])
