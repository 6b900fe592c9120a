"""In a world that is the filter's own assumptions, its errors are those that it claims."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ampi.estimation.estimate import ATTACK, EAST, LIFT, LOCAL, LOG_DRAG, NORTH
from ampi.estimation.estimator import Estimator
from ampi.estimation.settings import EstimatorSettings
from ampi.onboard.flight_model import (
    ALTITUDE,
    AZIMUTH,
    BANK,
    PATH_ANGLE,
    SPEED,
    Factors,
    FlightModelData,
)
from tests.support.descents import axes, descent

Array = NDArray[np.float64]

SETTINGS = EstimatorSettings()
CYCLE, SECONDS, N = 0.2, 100.0, 400


class Instant(NamedTuple):
    time: float
    told: Array  # (7, n)
    sensed: Array  # (3, n)
    theta: Array  # (6, n), true


def drawn(model: FlightModelData, own: EstimatorSettings) -> Iterator[Instant]:
    """N descents with θ, noise and biases drawn as the settings say."""
    rng = np.random.default_rng(11)
    prior = np.array(own.prior)
    everything = prior[:, None] * rng.standard_normal((len(prior), N))
    theta, biases = everything[:6], everything[6:]
    lengths = {LOCAL: own.length, EAST: own.wind_length, NORTH: own.wind_length}
    for time in np.arange(0.0, SECONDS, CYCLE):
        state = descent(N, time, SECONDS)
        state[BANK] = 0.6 * np.sin(0.05 * time)  # alike in all
        climbed = np.abs(state[SPEED] * np.sin(state[PATH_ANGLE])) * CYCLE
        for row, length in lengths.items():
            kept = np.exp(-climbed / length)
            fresh = np.sqrt(1.0 - kept * kept) * prior[row] * rng.standard_normal(N)
            theta[row] = kept * theta[row] + fresh
        told = state.copy()
        told[ALTITUDE] += own.altitude * rng.standard_normal(N)
        told[SPEED] += own.speed * rng.standard_normal(N)
        for row in (PATH_ANGLE, AZIMUTH, BANK):
            told[row] += own.angle * rng.standard_normal(N)
        for row, bias in zip((SPEED, PATH_ANGLE, AZIMUTH, BANK), biases, strict=False):
            told[row] -= bias
        factors = Factors(
            density=np.exp(theta[LOG_DRAG] + theta[LOCAL]),
            lift=np.exp(theta[LIFT]),
            wind_east=theta[EAST],
            wind_north=theta[NORTH],
            angle_of_attack=theta[ATTACK],
        )
        felt = np.stack(model.sensed(state, time, factors))
        # the accelerometer's axes are turned into those that navigation tells
        sensed = np.einsum("cin,cjn,jn->in", axes(told), axes(state), felt)
        size = np.sqrt(np.square(felt).sum(axis=0))
        sensed += np.hypot(own.relative * size, own.floor) * rng.standard_normal((3, N))
        yield Instant(float(time), told, sensed, theta.copy())


def test_errors_and_innovations_are_of_the_size_that_is_claimed(model: FlightModelData) -> None:
    """NEES has six degrees of freedom and NIS three: within four standard deviations of the mean."""
    estimator, nis, step = Estimator(model, SETTINGS, N), [], 0
    for step, now in enumerate(drawn(model, SETTINGS)):
        estimator.update(now.time, now.told, now.sensed)
        nis.append(np.mean(estimator.nis))
        if step % 50 == 49:
            estimate = estimator.estimate
            error = (now.theta - estimate.mean).T[..., None]
            solved = np.linalg.solve(np.moveaxis(estimate.covariance, 2, 0), error)
            nees = np.einsum("nij,nij->n", error, solved)
            assert abs(nees.mean() - 6.0) < 4.0 * np.sqrt(12.0 / N), now.time
    assert step == round(SECONDS / CYCLE) - 1
    # a first measurement in dense air is linearised far from the truth; a flight begins in thin air. The
    # model's scale height is 6.5 to 8 km where the settings say 7
    assert abs(np.mean(nis[50:]) - 3.0) < 0.15


def test_a_filter_that_believes_too_much_is_seen(model: FlightModelData) -> None:
    """The same flights, with winds half as strong in the settings: NEES tells."""
    believing = EstimatorSettings(wind=10.0, local_log_drag=0.02)
    estimator = Estimator(model, believing, N)
    for now in drawn(model, SETTINGS):
        estimator.update(now.time, now.told, now.sensed)
        if now.time > 50.0:
            break
    estimate = estimator.estimate
    error = (now.theta - estimate.mean).T[..., None]
    solved = np.linalg.solve(np.moveaxis(estimate.covariance, 2, 0), error)
    assert np.einsum("nij,nij->n", error, solved).mean() > 9.0
