"""Corrections: what they lessen, where they end, what they say of it, and their budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ampi.correction.corrector import REJECTIONS, Corrected, CorrectionOutcome, Corrector
from ampi.correction.onboard_correction import Correction
from ampi.correction.plan import CHANGES, Plans
from ampi.correction.prediction import Predictor, Situation
from ampi.correction.settings import N_BANKS, N_PLAN
from tests.correction.conftest import Flights, with_settings

Array = NDArray[np.float64]
Ends = Callable[[Predictor, Plans, Situation], Array]
N = 6


def moved(where: Situation, east: Any, north: Any) -> Situation:
    """The same with its targets `east` and `north` (km) of where they are."""
    target = where.target.copy()
    target[1] += np.asarray(east) / 6371.0 / np.cos(target[2])
    target[2] += np.asarray(north) / 6371.0
    return replace(where, target=target)


def all_are(found: Corrected, outcome: CorrectionOutcome) -> bool:
    return set(found.outcome.tolist()) == {int(outcome)}


def merit(corrector: Corrector, plans: Plans, where: Situation, ends: Ends) -> Array:
    predictor = Predictor(corrector.model, corrector.settings)
    return corrector.cost(ends(predictor, plans, where), plans.values)


@pytest.fixture(scope="module")
def case(flights: Flights) -> tuple[Plans, Situation]:
    """Plans whose targets lie a few kilometres beside their ends, in reach."""
    plans, where = flights(N)
    rng = np.random.default_rng(1)
    return plans, moved(where, rng.uniform(-3.0, 3.0, N), rng.uniform(-3.0, 3.0, N))


@pytest.fixture(scope="module")
def corrected(corrector: Corrector, case: tuple[Plans, Situation]) -> Corrected:
    return corrector.correct(*case)


def test_targets_in_reach_are_met_and_the_predictor_says_so(
    corrector: Corrector, case: tuple[Plans, Situation], corrected: Corrected, ends: Ends
) -> None:
    assert all_are(corrected, CorrectionOutcome.PLAN_REPLACED)
    missed = ends(Predictor(corrector.model, corrector.settings), corrected.plans, case[1])
    np.testing.assert_array_equal(missed, corrected.missed)
    assert (np.linalg.norm(missed[:3], axis=0) <= corrector.settings.tolerance).all()
    assert not missed[3:].any()


def test_a_plan_that_ends_on_the_target_is_kept_to_the_bit(
    corrector: Corrector, case: tuple[Plans, Situation], corrected: Corrected
) -> None:
    again = corrector.correct(corrected.plans, case[1])
    assert all_are(again, CorrectionOutcome.PLAN_KEPT)
    np.testing.assert_allclose(again.plans.values, corrected.plans.values, atol=1e-15)
    assert set(again.propagations.tolist()) == {1}
    assert not again.iterations.any()


def test_the_jacobian_is_that_of_central_differences(
    corrector: Corrector, case: tuple[Plans, Situation]
) -> None:
    plans, where = case
    predictor = Predictor(corrector.model, corrector.settings)
    own = corrector.outlook(plans, where).jacobian[:3]
    step = 1e-4 * np.concatenate([np.eye(N_PLAN), -np.eye(N_PLAN)], axis=1)[:, :, None]
    found = predictor.predict(plans.with_values(plans.values[:, None] + step), where)
    central = (found.missed[:3, :N_PLAN] - found.missed[:3, N_PLAN:]) / 2e-4
    size = np.abs(central).max(axis=1, keepdims=True)
    assert np.max(np.abs(own - central) / size) < 0.03  # one-sided, of steps that are flown


def test_wherever_the_target_is_the_merit_never_worsens_and_the_plan_keeps_its_bounds(
    corrector: Corrector, flights: Flights, ends: Ends
) -> None:
    plans, where = flights(2 * N, seed=7)
    rng = np.random.default_rng(8)
    where = moved(where, *rng.uniform(-60.0, 60.0, (2, 2 * N)))
    wild = plans.values + rng.uniform(-0.5, 0.5, plans.values.shape)
    bound = corrector.bound(where)
    plans = plans.with_values(np.clip(wild, -bound, bound))
    found = corrector.correct(plans, where)
    before = merit(corrector, plans, where, ends)
    after = merit(corrector, found.plans, where, ends)
    assert (after <= before).all()
    assert (np.abs(found.plans.values) <= bound).all()
    kept = found.outcome == CorrectionOutcome.NO_BETTER
    assert (after[~kept] < before[~kept]).all()
    assert len(set(found.outcome.tolist())) > 1  # not all alike


def test_a_plan_beyond_its_bounds_is_brought_back(
    corrector: Corrector, case: tuple[Plans, Situation]
) -> None:
    plans, where = case
    values = plans.values.copy()
    values[3], values[CHANGES] = 1.5, 0.2
    found = corrector.correct(plans.with_values(values), where)
    assert (found.iterations > 0).all()
    assert (np.abs(found.plans.values) <= corrector.bound(where) + 1e-15).all()


def test_bank_alone_leaves_the_angle_of_attack_to_its_schedule(
    by_bank_alone: Correction, case: tuple[Plans, Situation]
) -> None:
    plans, where = case
    values = plans.values.copy()
    values[CHANGES] = 0.0
    found = with_settings(by_bank_alone, step=8.0).correct(plans.with_values(values), where)
    assert not found.plans.values[N_BANKS:].any()
    assert (found.propagations - 1 - N_BANKS * found.iterations >= 0).all()


def test_out_of_reach_is_told_and_is_the_nearest_point_that_scipy_finds(
    corrector: Corrector, flights: Flights, ends: Ends
) -> None:
    plans, where = flights(1, seed=3)
    heading = where.state[5, 0]
    far = moved(where, 150.0 * np.sin(heading), 150.0 * np.cos(heading))
    found = plans
    for _ in range(4):  # as in flight, one correction after the other
        last = corrector.correct(found, far)
        found = last.plans
    assert all_are(last, CorrectionOutcome.OUT_OF_REACH)
    predictor, bound = Predictor(corrector.model, corrector.settings), corrector.bound(far)[:, 0]
    weight = np.sqrt(corrector.weight[:, 0])

    def residual(values: Array) -> Array:
        return np.asarray(weight * ends(predictor, plans.with_values(values[:, None]), far)[:, 0])

    def slopes(values: Array) -> Array:
        seen = corrector.outlook(plans.with_values(values[:, None]), far)
        return np.asarray(weight[:, None] * seen.jacobian[..., 0])

    best = least_squares(
        residual, plans.values[:, 0], slopes, (-bound, bound), x_scale=bound, max_nfev=12
    )
    own = np.linalg.norm(weight * last.missed[:, 0])
    assert own <= 1.1 * np.sqrt(2.0 * best.cost)
    assert np.hypot(*last.missed[:2, 0]) > 30e3


def test_no_arrival_leaves_the_plan_and_tells_no_miss(
    correction: Correction, case: tuple[Plans, Situation]
) -> None:
    plans, where = case
    found = with_settings(correction, longest=10.0).correct(plans, where)
    assert all_are(found, CorrectionOutcome.NO_ARRIVAL)
    np.testing.assert_allclose(found.plans.values, plans.values, atol=1e-14)
    assert set(found.propagations.tolist()) == {2}  # the plan, and wings level


def test_a_plan_that_does_not_arrive_gives_way_to_wings_level(
    correction: Correction, flights: Flights
) -> None:
    plans, where = flights(1)
    heavy = replace(correction, model=replace(correction.model, mass=4.0 * correction.model.mass))
    where.state[0], where.state[4], where.state[6] = 20e3, -0.05, 3.1
    where = replace(where, bank_angle=np.array([3.1]), rates=np.ones((2, 1)))
    dive = plans.with_values(np.where(np.arange(N_PLAN)[:, None] < N_BANKS, 3.1, 0.0))
    own = with_settings(heavy)
    found = own.correct(dive, where)
    assert not own.outlook(dive, where).arrives.any()
    assert found.outcome[0] in (CorrectionOutcome.PLAN_REPLACED, CorrectionOutcome.OUT_OF_REACH)


@pytest.mark.parametrize("budget", [1, 20, 40])
def test_the_budget_of_predictions_ends_a_correction(
    correction: Correction, case: tuple[Plans, Situation], budget: int
) -> None:
    plans, where = case
    found = with_settings(correction, propagations=budget, tolerance=1e-6).correct(plans, where)
    assert (found.propagations <= budget + 1 + N_PLAN).all()
    there = CorrectionOutcome.PLAN_REPLACED, CorrectionOutcome.PLAN_KEPT
    assert not np.isin(found.outcome, [int(outcome) for outcome in there]).any()
    assert (found.iterations >= 1).all()


def test_one_iteration_betters_and_many_tries_are_bounded(
    correction: Correction, case: tuple[Plans, Situation]
) -> None:
    plans, where = case
    found = with_settings(correction, iterations=1, tolerance=1e-9).correct(plans, where)
    assert set(found.iterations.tolist()) == {1}
    assert (found.propagations <= 1 + N_PLAN + REJECTIONS).all()


def test_flights_in_company_are_corrected_as_they_are_alone(
    corrector: Corrector, case: tuple[Plans, Situation], corrected: Corrected
) -> None:
    plans, where = case
    for i in range(2):
        one = np.array([i])
        alone = corrector.correct(plans.of(one), where.of(one))
        np.testing.assert_allclose(
            alone.plans.values[:, 0], corrected.plans.values[:, i], atol=1e-9
        )
        assert alone.propagations[0] == corrected.propagations[i]


def test_every_outcome_has_a_sentence() -> None:
    assert all(outcome.sentence.endswith(".") for outcome in CorrectionOutcome)
    assert [int(outcome) for outcome in CorrectionOutcome] == list(range(8))
