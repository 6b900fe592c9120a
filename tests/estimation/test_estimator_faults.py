"""What the estimator does with sensors that fail and air that changes: it goes on, and counts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ampi.estimation.estimate import ATTACK, LIFT, LOCAL, LOG_DRAG
from ampi.estimation.estimator import Estimator
from ampi.estimation.settings import EstimatorSettings
from ampi.onboard.flight_model import ALTITUDE, LONGITUDE, Factors, FlightModelData
from tests.support.descents import descent

Array = NDArray[np.float64]

SETTINGS = EstimatorSettings()
CYCLE, SECONDS, N = 0.2, 100.0, 3
Fault = Callable[[float, Array, Array], None]


def thickness(estimator: Estimator) -> Array:
    """ln k_D of what is estimated, where it is (n,)."""
    mean = estimator.estimate.mean
    return np.asarray(mean[LOG_DRAG] + mean[LOCAL])


def flown(
    model: FlightModelData,
    fault: Fault = lambda time, told, sensed: None,
    factor: Callable[[Array], Array] = lambda altitude: np.full_like(altitude, 1.1),
    watch: Callable[[float, Estimator], None] = lambda time, estimator: None,
) -> Estimator:
    """N descents in air as thick as `factor` of the altitude; `fault` may alter what is told."""
    estimator, rng = Estimator(model, SETTINGS, N), np.random.default_rng(4)
    for time in np.arange(0.0, SECONDS, CYCLE):
        state = descent(N, time, SECONDS)
        told = state.copy()
        told[ALTITUDE] += SETTINGS.altitude * rng.standard_normal(N)
        sensed = np.stack(model.sensed(state, time, Factors(density=factor(state[ALTITUDE]))))
        fault(time, told, sensed)
        estimator.update(time, told, sensed)
        watch(time, estimator)
        assert np.isfinite(estimator.estimate.mean).all()
        assert np.isfinite(estimator.estimate.covariance).all()
    return estimator


def test_without_a_fault_all_is_used_and_the_air_is_known(model: FlightModelData) -> None:
    estimator = flown(model)
    assert np.all(estimator.counts["used"] == round(SECONDS / CYCLE))
    np.testing.assert_allclose(thickness(estimator), np.log(1.1), atol=0.01)


def test_what_is_no_number_is_counted_and_harms_no_one(model: FlightModelData) -> None:
    def fault(time: float, told: Array, sensed: Array) -> None:
        if 30.0 <= time < 50.0:
            sensed[:, 0] = (np.nan, np.inf, 1e300)
            told[LONGITUDE, 1] = np.nan

    whole, estimator = flown(model), flown(model, fault)
    np.testing.assert_array_equal(estimator.counts["unusable"], [100, 100, 0])
    np.testing.assert_array_equal(estimator.estimate.mean[:, 2], whole.estimate.mean[:, 2])
    np.testing.assert_allclose(thickness(estimator), np.log(1.1), atol=0.01)


def test_it_may_be_fed_nothing_but_that(model: FlightModelData) -> None:
    estimator = Estimator(model, SETTINGS, 2)
    for told, sensed, time in (
        (np.full((7, 2), np.nan), np.full((3, 2), np.nan), np.nan),
        (descent(2, 1.0, SECONDS), np.full((3, 2), np.nan), 1.0),
        (np.full((7, 2), np.inf), np.ones((3, 2)), 2.0),
        (np.zeros((7, 2)), np.ones((3, 2)), 3.0),  # at a standstill: no direction, no air
    ):
        estimator.update(time, told, sensed)
    np.testing.assert_array_equal(estimator.estimate.mean, 0.0)
    assert np.all(estimator.counts["used"] == 0)
    assert np.all(estimator.counts["unusable"] == 3)


def test_a_stuck_accelerometer_is_not_believed(model: FlightModelData) -> None:
    held = np.empty((3, N))

    def fault(time: float, told: Array, sensed: Array) -> None:
        if 40.0 <= time < 60.0:
            sensed[:] = held
        held[:] = sensed

    estimator = flown(model, fault)
    np.testing.assert_array_equal(estimator.counts["stuck"], round(20.0 / CYCLE))
    np.testing.assert_allclose(thickness(estimator), np.log(1.1), atol=0.01)


def test_an_accelerometer_that_tells_too_much_is_thicker_air(model: FlightModelData) -> None:
    """5 % in all components cannot be told from 5 % of density: nothing else is blamed for it."""

    def fault(time: float, told: Array, sensed: Array) -> None:
        sensed *= 1.05

    estimator = flown(model, fault)
    mean = estimator.estimate.mean
    np.testing.assert_allclose(thickness(estimator), np.log(1.1 * 1.05), atol=0.01)
    np.testing.assert_allclose(mean[LIFT], 0.0, atol=0.005)
    np.testing.assert_allclose(mean[ATTACK], 0.0, atol=0.002)
    assert np.all(estimator.counts["gated"] == 0)


def test_navigation_lost_for_20_seconds_widens_the_covariance(model: FlightModelData) -> None:
    widths: dict[float, Array] = {}

    def fault(time: float, told: Array, sensed: Array) -> None:
        if 40.0 <= time < 60.0:
            told[:] = np.nan

    def watch(time: float, estimator: Estimator) -> None:
        covariance = estimator.estimate.covariance[[LOG_DRAG, LOCAL]][:, [LOG_DRAG, LOCAL]]
        widths[round(time, 1)] = covariance.sum(axis=(0, 1))

    estimator = flown(model, fault, watch=watch)
    assert np.all(estimator.counts["unusable"] == round(20.0 / CYCLE))
    np.testing.assert_array_equal(widths[50.0], widths[39.8])  # nobody knows how far it has come
    assert np.all(widths[60.0] > widths[39.8])
    np.testing.assert_allclose(thickness(estimator), np.log(1.1), atol=0.01)


def test_navigation_that_comes_back_elsewhere_is_followed(model: FlightModelData) -> None:
    """500 m too low after 60 s: the same air 7 % thinner where it is told."""

    def fault(time: float, told: Array, sensed: Array) -> None:
        if 40.0 <= time < 60.0:
            told[:] = np.nan
        elif time >= 60.0:
            told[ALTITUDE] -= 500.0

    estimator = flown(model, fault)
    altitude = descent(N, SECONDS - CYCLE, SECONDS)[ALTITUDE]
    thinner = model.air.log_density(altitude) - model.air.log_density(altitude - 500.0)
    np.testing.assert_allclose(thickness(estimator), np.log(1.1) + thinner, atol=0.01)


def test_air_that_jumps_by_30_percent_is_followed_within_seconds(model: FlightModelData) -> None:
    """At 45 km, as if a layer began there: gated for a while, forgotten, then learnt anew."""
    errors: dict[float, float] = {}

    def factor(altitude: Array) -> Array:
        return np.where(altitude > 45e3, 1.1, 1.1 * 1.3)

    def watch(time: float, estimator: Estimator) -> None:
        true = np.log(factor(descent(N, time, SECONDS)[ALTITUDE]))
        errors[round(time, 1)] = float(np.abs(thickness(estimator) - true).max())

    estimator = flown(model, factor=factor, watch=watch)
    jump = SECONDS * 15.0 / 35.0
    late = [error for time, error in errors.items() if time > jump + SETTINGS.patience + 2.0]
    assert max(late) < 0.03  # of 0.26; a part is taken for head wind until the flight slows down
    assert list(errors.values())[-1] < 0.015
    assert np.all(estimator.counts["gated"] > 0)
    assert np.all(estimator.counts["reset"] == 1)


def test_what_never_fits_resets_the_covariance_time_and_again(model: FlightModelData) -> None:
    def fault(time: float, told: Array, sensed: Array) -> None:
        sensed *= -10.0

    estimator = flown(model, fault)
    np.testing.assert_array_equal(estimator.counts["used"], 0)
    np.testing.assert_allclose(estimator.counts["reset"], SECONDS / SETTINGS.patience, rtol=0.1)
    np.testing.assert_array_equal(estimator.estimate.mean, 0.0)
    assert np.all(estimator.estimate.deviation <= np.array(SETTINGS.prior)[:, None] * 1.001)
