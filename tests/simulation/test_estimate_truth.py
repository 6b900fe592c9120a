"""Estimates judged against the truth: what is called true explains what is sensed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ampi.estimation.estimate import Estimate
from ampi.estimation.settings import EstimatorSettings
from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard_model import flight_model_of
from ampi.physics.equations_of_motion import aerodynamic_acceleration
from ampi.physics.state import ALTITUDE
from ampi.report.figures.estimates import PANELS, estimates_figure
from ampi.simulation.closed_loop import fly_batch
from ampi.simulation.estimate_truth import (
    TOTALS,
    CheckedEstimates,
    check_estimates,
    instants,
    true_estimate,
)
from ampi.simulation.true_model import true_model
from ampi.simulation.truth import Truth
from ampi.simulation.world_loading import load_world

N = 6


@pytest.fixture(scope="module")
def truth(short: Mission) -> Truth:
    return load_world("everything").draw(short, N, 5, "tuning")


@pytest.fixture(scope="module")
def checked(short: Mission, short_guidance: Guidance, truth: Truth) -> CheckedEstimates:
    return check_estimates(short, short_guidance.at_cycle(0.2), truth, EstimatorSettings(), 2.0)


def test_the_true_estimate_explains_what_is_sensed_at_the_told_altitude(
    short: Mission, truth: Truth
) -> None:
    true, rng = true_model(short.family(truth.parameters), truth), np.random.default_rng(0)
    low = (20e3, -1.0, 1.0, 600.0, -0.2, -2.0, -1.0)
    states = rng.uniform(low, (95e3, 0.0, 1.3, 4700.0, 0.1, 2.0, 1.0), (N, 7)).T
    theta = true_estimate(short.flight_model, true, truth, states)
    told = states.copy()
    told[ALTITUDE] += truth.numbers["navigation_altitude_bias"]
    exact = Estimate(theta, np.zeros((6, 6, N)), told[ALTITUDE], EstimatorSettings())
    found = flight_model_of(short).sensed(told, 100.0, exact.at(told[ALTITUDE]))
    expected = aerodynamic_acceleration(true, states, 100.0)
    np.testing.assert_allclose(np.stack(found), np.stack(expected), rtol=1e-8, atol=1e-10)


def test_flights_are_those_of_the_closed_loop(
    short: Mission, short_guidance: Guidance, truth: Truth
) -> None:
    guidance = short_guidance.at_cycle(0.5)
    flown = fly_batch(short.family(truth.parameters), guidance, truth, 0.5)
    for step, now in enumerate(instants(short, guidance, truth)):
        seen = flown.states[:, :, step].T
        np.testing.assert_array_equal(now.flying, np.isfinite(seen[0]))
        np.testing.assert_array_equal(now.states[:, now.flying], seen[:, now.flying])


def test_errors_are_judged_by_their_covariance(checked: CheckedEstimates) -> None:
    flying = checked.flying
    assert np.all(np.isfinite(checked.nees[flying]))
    assert np.all(np.isnan(checked.nees[~flying]))
    k, i = np.argwhere(flying)[-1]
    error, covariance = checked.error[k, :, i], checked.covariance[k, :, :, i]
    expected = error @ np.linalg.inv(covariance) @ error
    assert checked.nees[k, i] == pytest.approx(expected, rel=1e-6)
    drag = checked.error[k, 0, i] + checked.error[k, 1, i]
    assert checked.total_error[k, TOTALS.index("log_drag"), i] == pytest.approx(drag)
    low, high = checked.bounds(6)[0]
    assert low < 6.0 < high
    assert np.all(checked.within(1e9)[flying.any(axis=1)] == 1.0)
    assert np.all(checked.within(0.0) == 0.0)


def test_a_flight_learns_and_few_errors_are_beyond_three_deviations(
    checked: CheckedEstimates,
) -> None:
    assert np.all(checked.counts["used"] > 200)
    assert np.all(checked.counts["gated"] == 0)
    first, last = checked.deviation[0], checked.deviation[len(checked.times) // 2]
    assert np.nanmean(last[1]) < np.nanmean(first[1])
    assert checked.within()[: len(checked.times) // 2].mean() > 0.95


def test_batches_change_nothing(
    short: Mission,
    short_guidance: Guidance,
    truth: Truth,
    checked: CheckedEstimates,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ampi.simulation.estimate_truth.BATCH", 4)
    guidance = short_guidance.at_cycle(0.2)
    parts = check_estimates(short, guidance, truth, EstimatorSettings(), 2.0)
    np.testing.assert_allclose(parts.mean, checked.mean, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(parts.counts["used"], checked.counts["used"])


def test_the_figure_shows_what_is_estimated(checked: CheckedEstimates) -> None:
    figure = estimates_figure(checked.along(1))
    assert len(figure.axes) == len(PANELS) + 1
    drag, angle = figure.axes[0], figure.axes[2]
    flown = checked.flying[:, 1]
    true = 100.0 * np.expm1(checked.truth[flown, :2, 1].sum(axis=1))
    np.testing.assert_allclose(drag.lines[1].get_ydata(), true)
    np.testing.assert_allclose(angle.lines[0].get_ydata(), np.degrees(checked.mean[flown, 5, 1]))
    other = replace(checked, mean=checked.mean + 0.1)
    assert not np.allclose(estimates_figure(other.along(1)).axes[0].lines[0].get_ydata(), true)
