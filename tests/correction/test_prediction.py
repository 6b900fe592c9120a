"""Predicted flights against SciPy's integration of the same model, and what counts as arriving."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.correction.onboard_correction import Correction
from ampi.correction.plan import Plans
from ampi.correction.prediction import Predictor, Situation, factors_at
from ampi.onboard.flight_model import ALTITUDE, BANK, LATITUDE, LONGITUDE, SPEED
from tests.correction.conftest import Flights

Array = NDArray[np.float64]
Ends = Callable[[Predictor, Plans, Situation], Array]


def stepping(correction: Correction, step: float, **changes: float) -> Predictor:
    return Predictor(correction.model, replace(correction.corrector, step=step, **changes))


def integrated(predictor: Predictor, plans: Plans, where: Situation) -> tuple[Array, Array, Array]:
    """The end (6,) of a flight that follows its plan exactly, the time to go, and (8, k) on the way."""

    def steered(x: Array) -> Array:
        state = np.concatenate([x, np.zeros(2)])[:, None]
        state[BANK:] = plans.at(predictor.speed(where.target, state))
        return state

    def rates(time: float, x: Array) -> Array:
        state = steered(x)
        model = predictor.model
        return model.rates(state[:7], 0.0, time, factors_at(where.estimate, state))[:BANK, 0]

    def slow(time: float, x: Array) -> float:
        return float(x[SPEED] - where.target[3, 0])

    slow.terminal = True  # type: ignore[attr-defined]
    begin = where.state[:BANK, 0]
    way = solve_ivp(
        rates,
        (where.time, where.time + 900.0),
        begin,
        method="DOP853",
        rtol=1e-11,
        atol=1e-9,
        events=slow,
    )
    points = np.concatenate([steered(x) for x in way.y.T], axis=1)
    return way.y[:, -1], np.array(way.t[-1] - where.time), points


@pytest.mark.parametrize("seed", [1, 2])
def test_a_flight_ends_where_its_exact_integration_does(
    correction: Correction, flights: Flights, ends: Ends, seed: int
) -> None:
    plans, where = flights(1, seed=seed)
    where.state[6:] = plans.at(plans.fast)
    quick = replace(where, rates=np.full((2, 1), 9.0))
    end, _, _ = integrated(stepping(correction, 2.0), plans, quick)
    errors = []
    for step in (8.0, 2.0):
        missed = ends(stepping(correction, step), plans, quick)[:3, 0]
        radius = correction.model.equatorial_radius
        target = where.target[:, 0]
        expected = np.array(
            [
                radius * np.cos(target[2]) * (end[LONGITUDE] - target[1]),
                radius * (end[LATITUDE] - target[2]),
                end[ALTITUDE] - target[0],
            ]
        )
        errors.append(np.linalg.norm(missed - expected))
    assert errors[1] < 0.05  # m
    assert errors[1] < errors[0] / 50.0  # the method is of order four


def test_excess_of_the_limits_is_that_of_the_integrated_flight(
    correction: Correction, flights: Flights, ends: Ends
) -> None:
    plans, where = flights(1, seed=4)
    where.state[6:] = plans.at(plans.fast)
    predictor = stepping(correction, 1.0, margin=0.9)
    missed = ends(predictor, plans, replace(where, rates=np.full((2, 1), 9.0)))
    _, _, points = integrated(predictor, plans, where)
    model, limits = correction.model, correction.model.limits
    loads = model.loads(points[:7], where.time, factors_at(where.estimate, points))
    bounds = (limits.dynamic_pressure, limits.heat_flux, limits.load_factor)
    use = np.array([load.max() / limit for load, limit in zip(loads, bounds, strict=True)])
    np.testing.assert_allclose(missed[3:, 0], np.maximum(use - 0.1, 0.0), rtol=2e-3, atol=1e-4)
    assert missed[3:].all()


def test_the_bank_angle_follows_no_faster_than_its_rate(
    correction: Correction, flights: Flights, ends: Ends
) -> None:
    plans, where = flights(1)
    predictor = stepping(correction, 2.0)
    turned = plans.with_values(np.where(np.arange(18)[:, None] < 13, -1.0, 0.0))
    slow, fast = (
        ends(predictor, turned, replace(where, rates=np.full((2, 1), rate))) for rate in (0.02, 9.0)
    )
    held = replace(where, rates=np.zeros((2, 1)))
    own = plans.with_values(np.where(np.arange(18)[:, None] < 13, where.state[6], 0.0))
    np.testing.assert_array_equal(ends(predictor, turned, held), ends(predictor, own, held))
    assert np.linalg.norm(slow[:2] - fast[:2]) > 1e3


def test_flights_in_company_and_plans_beside_others_end_where_they_do_alone(
    predictor: Predictor, flights: Flights
) -> None:
    plans, where = flights(5)
    where.state[3, 0] = 2500.0  # the first ends early
    beside = np.stack([plans.values, plans.values + 0.05, plans.values - 0.05], axis=1)
    together = predictor.predict(plans.with_values(beside), where)
    for i in range(5):
        one = np.array([i])
        for k in range(3):
            own = plans.of(one).with_values(beside[:, [k]][:, :, one])
            alone = predictor.predict(own, where.of(one))
            np.testing.assert_allclose(
                together.missed[:, k, i], alone.missed[:, 0, 0], rtol=1e-9, atol=1e-5
            )
            assert together.to_go[k, i] == pytest.approx(alone.to_go[0, 0], abs=1e-9)


def test_who_does_not_become_slow_enough_in_time_or_above_the_ground_does_not_arrive(
    correction: Correction, flights: Flights
) -> None:
    plans, where = flights(3)
    one = plans.with_values(plans.values[:, None])
    where.state[0, 1], where.state[4, 1] = 200.0, -1.0  # down
    where.state[0, 2], where.state[3, 2] = 90e3, 12e3  # on its way to the moon
    assert stepping(correction, 4.0).predict(one, where).arrives[0, [0, 2]].tolist() == [
        True,
        False,
    ]
    assert not stepping(correction, 0.1).predict(one, where).arrives[0, 1]
    assert not stepping(correction, 4.0, longest=20.0).predict(one, where).arrives[0, 0]


def test_who_is_too_slow_already_does_not_arrive(predictor: Predictor, flights: Flights) -> None:
    plans, where = flights(1)
    where.state[0], where.state[3] = 20e3, where.target[3] - 1.0  # and braking
    assert not predictor.predict(plans.with_values(plans.values[:, None]), where).arrives.any()
