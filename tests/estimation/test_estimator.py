"""The estimator's laws: covariance, gates, order of the flights, and what it finds in simple flights."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.estimation.estimate import ATTACK, EAST, ESTIMATED, LIFT, LOCAL, LOG_DRAG, NORTH
from ampi.estimation.estimator import COUNTED, MOST, Estimator
from ampi.estimation.measurement import Measurement
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
CYCLE = 0.2
EXACT = {
    **dict.fromkeys(("altitude", "speed", "angle", "walk_factors", "walk_angle"), 0.0),
    **dict.fromkeys(("relative", "floor"), 1e-4),
    **dict.fromkeys(("length", "wind_length"), 1e9),  # all is constant
}


def flown(
    model: FlightModelData, truth: Factors, n: int = 1, seconds: float = 100.0, **changes: float
) -> Estimator:
    """An estimator after a descent in which all is told exactly."""
    estimator = Estimator(model, EstimatorSettings(**changes), n)
    for time in np.arange(0.0, seconds, CYCLE):
        state = descent(n, time, seconds)
        estimator.update(time, state, np.stack(model.sensed(state, time, truth)))
    return estimator


def test_constant_errors_are_found(model: FlightModelData) -> None:
    truth = Factors(
        density=np.exp(0.12),
        lift=np.exp(-0.06),
        wind_east=15.0,
        wind_north=-10.0,
        angle_of_attack=0.004,
    )
    estimate = flown(model, truth, **EXACT).estimate
    found = estimate.at(estimate.altitude)
    assert found.density == pytest.approx(truth.density, rel=2e-4)
    assert found.lift == pytest.approx(truth.lift, rel=2e-4)
    assert found.wind_east == pytest.approx(15.0, abs=0.5)
    assert found.wind_north == pytest.approx(-10.0, abs=0.5)
    assert found.angle_of_attack == pytest.approx(0.004, abs=1e-4)


def test_the_nominal_model_is_left_alone(model: FlightModelData) -> None:
    estimator = flown(model, Factors(wind_east=np.zeros(1)), seconds=60.0)
    np.testing.assert_allclose(estimator.estimate.mean, 0.0, atol=1e-9)
    assert estimator.counts["used"] == 300
    assert np.all(estimator.nis < 1e-9)


def test_slopes_are_those_of_finite_differences(model: FlightModelData) -> None:
    """Central differences of the model itself, against what the filter linearises by."""
    n, time = 5, 70.0
    state = descent(n, 20.0, 100.0)
    mean = np.tile([[0.1], [-0.03], [0.05], [12.0], [-8.0], [0.003]], n)
    change = np.full(n, 0.01)

    def sensed(theta: Array) -> Array:
        factors = Factors(
            density=np.exp(theta[LOG_DRAG] + theta[LOCAL]),
            lift=np.exp(theta[LIFT]),
            wind_east=theta[EAST],
            wind_north=theta[NORTH],
            angle_of_attack=theta[ATTACK] + change,
        )
        return np.stack(model.sensed(state, time, factors))

    found = Measurement(model, SETTINGS).expected(mean, time, state, change, np.zeros(n))
    np.testing.assert_array_equal(found.sensed, sensed(mean))
    for row, step in enumerate((1e-5, 1e-5, 1e-5, 0.1, 0.1, 1e-5)):
        moved = np.zeros_like(mean)
        moved[row] = step
        expected = (sensed(mean + moved) - sensed(mean - moved)) / (2.0 * step)
        size = np.abs(expected).max()
        np.testing.assert_allclose(found.slopes[:, row], expected, atol=3e-3 * size)


def test_the_noise_is_that_of_what_navigation_tells(model: FlightModelData) -> None:
    """R against the spread of F as it would be sensed, seen from a state told with errors."""
    rng, n, time = np.random.default_rng(3), 40_000, 30.0
    own = EstimatorSettings(altitude=30.0, speed=1.0, angle=1e-3, relative=0.0, floor=0.0)
    true = descent(1, 50.0, 100.0)
    true[BANK], true[PATH_ANGLE] = 0.7, -0.2
    told = np.repeat(true, n, axis=1)
    for row, size in (
        (ALTITUDE, 30.0),
        (SPEED, 1.0),
        (PATH_ANGLE, 1e-3),
        (AZIMUTH, 1e-3),
        (BANK, 1e-3),
    ):
        told[row] += size * rng.standard_normal(n)

    # the accelerometer's own axes are turned with what is told: F is seen in the told axes
    felt = np.stack(model.sensed(true, time))
    in_told_axes = np.einsum("cin,cj->ijn", axes(told), axes(true)[..., 0])
    seen = np.einsum("ijn,jk->in", in_told_axes, felt)
    spread = np.cov(seen - np.stack(model.sensed(told, time)))
    (noise,) = (
        Measurement(model, own)
        .expected(np.zeros((6, 1)), time, true, np.zeros(1), np.zeros(1))
        .noise.transpose(2, 0, 1)
    )
    # the density's own scale height at 42 km is not the 7 km of the setting
    scale = 30.0 * -np.diff(model.air.log_density(true[ALTITUDE] + np.array([-5.0, 5.0])))[0] / 10.0
    altitude = np.outer(felt[:, 0], felt[:, 0]) * (scale**2 - (30.0 / own.scale_height) ** 2)
    np.testing.assert_allclose(spread, noise + altitude, atol=0.03 * noise.max())


def test_covariance_stays_symmetric_and_positive(model: FlightModelData) -> None:
    covariance = flown(model, Factors(density=1.1), n=3).estimate.covariance
    np.testing.assert_array_equal(covariance, covariance.swapaxes(0, 1))
    assert np.all(np.linalg.eigvalsh(np.moveaxis(covariance, 2, 0)) > 0.0)
    assert np.all(np.einsum("iin->in", covariance) <= 1.1 * np.square(SETTINGS.prior)[:, None])


def test_one_update_is_that_of_the_textbook(model: FlightModelData) -> None:
    """(P⁻¹ + Hᵀ R⁻¹ H)⁻¹ and its mean, by the information form."""
    state, time = descent(1, 30.0, 100.0), 30.0
    sensed = np.stack(model.sensed(state, time, Factors(density=1.05, wind_east=np.array([5.0]))))
    estimator = Estimator(model, SETTINGS, 1)
    estimator.update(time, state, sensed)
    zero = np.zeros(1)
    at = Measurement(model, SETTINGS).expected(np.zeros((6, 1)), time, state, zero, zero)
    slopes, noise = at.slopes[..., 0], at.noise[..., 0]
    information = np.diag(1.0 / np.square(SETTINGS.prior)) + slopes.T @ np.linalg.solve(
        noise, slopes
    )
    mean = np.linalg.solve(
        information, slopes.T @ np.linalg.solve(noise, (sensed - at.sensed)[:, 0])
    )
    np.testing.assert_allclose(estimator.estimate.mean[:, 0], mean, rtol=1e-6, atol=1e-12)
    scale = np.outer(SETTINGS.prior, SETTINGS.prior)
    np.testing.assert_allclose(
        estimator.estimate.covariance[..., 0] / scale, np.linalg.inv(information) / scale, atol=1e-9
    )


def test_what_is_local_is_forgotten_over_the_altitude(model: FlightModelData) -> None:
    """Without measurements mean and covariance approach the prior, exponentially in the altitude."""
    estimator = flown(model, Factors(density=1.1, wind_east=np.array([30.0])))
    before = estimator.estimate
    state = descent(1, 100.0, 100.0)
    for time in (200.0, 300.0):
        estimator.update(time, state, np.full((3, 1), np.nan))
    fallen = state[SPEED] * np.sin(-state[PATH_ANGLE]) * 200.2
    after, local = estimator.estimate, np.exp(-fallen / SETTINGS.length)
    np.testing.assert_allclose(after.mean[LOCAL], before.mean[LOCAL] * local)
    np.testing.assert_array_equal(after.mean[[LOG_DRAG, LIFT]], before.mean[[LOG_DRAG, LIFT]])
    np.testing.assert_allclose(
        after.covariance[LOCAL, LOCAL],
        SETTINGS.local_log_drag**2 * (1.0 - local**2) + before.covariance[LOCAL, LOCAL] * local**2,
    )
    away = before.at(before.altitude - fallen)
    np.testing.assert_allclose(away.wind_east, after.mean[EAST])
    np.testing.assert_allclose(away.density, np.exp(after.mean[LOG_DRAG] + after.mean[LOCAL]))


def test_no_flight_depends_on_another(model: FlightModelData) -> None:
    density = np.array([0.9, 1.0, 1.1, 1.3])
    together = flown(model, Factors(density=density), n=4, seconds=20.0).estimate
    one = Estimator(model, SETTINGS, 1)
    for time in np.arange(0.0, 20.0, CYCLE):
        state = descent(4, time, 20.0)[:, 2:3]
        one.update(time, state, np.stack(model.sensed(state, time, Factors(density=1.1))))
    np.testing.assert_allclose(one.estimate.mean[:, 0], together.mean[:, 2], rtol=1e-9, atol=1e-12)


def test_bounds_hold_whatever_is_sensed(model: FlightModelData) -> None:
    rng, estimator = np.random.default_rng(1), Estimator(model, EstimatorSettings(gate=1e300), 50)
    for time in np.arange(0.0, 30.0, CYCLE):
        state = descent(50, time, 30.0)
        estimator.update(time, state, 1e3 * rng.standard_normal((3, 50)))
    assert np.all(np.abs(estimator.estimate.mean) <= MOST)
    assert np.all(estimator.counts["used"] > 0)


def test_reset_forgets_all(model: FlightModelData) -> None:
    estimator, fresh = flown(model, Factors(density=1.2)), Estimator(model, SETTINGS, 1)
    estimator.reset()
    for found, first in zip(
        (estimator.estimate.mean, estimator.estimate.covariance, *estimator.counts.values()),
        (fresh.estimate.mean, fresh.estimate.covariance, *fresh.counts.values()),
        strict=True,
    ):
        np.testing.assert_array_equal(found, first)
    assert set(estimator.counts) == set(COUNTED)
    assert len(ESTIMATED) == len(SETTINGS.prior) == len(SETTINGS.walk)
