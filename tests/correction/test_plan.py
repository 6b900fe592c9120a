"""A plan: one function of the equivalent speed, however often it is laid anew."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ampi.correction.plan import Plans, equivalent_speed, plans_through
from ampi.correction.settings import N_ANGLES, N_BANKS, N_PLAN

FAST, SLOW = np.array([5000.0, 4100.0, 900.0]), np.array([700.0, 700.0, 850.0])


@pytest.fixture
def plans() -> Plans:
    return Plans(FAST, SLOW, np.random.default_rng(3).uniform(-1.0, 1.0, (N_PLAN, 3)))


@given(st.integers(0, 1000))
def test_both_angles_are_numpys_interpolation_between_equally_spaced_values(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, share = rng.standard_normal((N_PLAN, 3)), rng.uniform(-0.3, 1.3, 3)
    share[0] = rng.integers(0, 13) / 12.0  # a kink
    found = Plans(FAST, SLOW, values).at(FAST - share * (FAST - SLOW))
    for row, own in zip(found, (values[:N_BANKS], values[N_BANKS:]), strict=True):
        places = np.linspace(0.0, 1.0, len(own))
        expected = [np.interp(share[i], places, own[:, i]) for i in range(3)]
        np.testing.assert_allclose(row, expected, atol=1e-12)


def test_a_plan_laid_anew_where_it_began_is_the_same_function(plans: Plans) -> None:
    again = plans.laid(FAST, SLOW)
    for share in np.linspace(-0.2, 1.2, 57):
        speed = SLOW + share * (FAST - SLOW)
        for old, new in zip(plans.at(speed), again.at(speed), strict=True):
            np.testing.assert_allclose(new, old, atol=1e-13)


def test_a_plan_laid_on_the_rest_is_the_old_one_at_its_new_values_and_within_its_range(
    plans: Plans,
) -> None:
    fast = FAST - 0.37 * (FAST - SLOW)
    rest = plans.laid(fast, SLOW)
    for angle, count in enumerate((N_BANKS, N_ANGLES)):
        for i in range(count):
            speed = fast - i / (count - 1.0) * (fast - SLOW)
            np.testing.assert_allclose(rest.at(speed)[angle], plans.at(speed)[angle], atol=1e-13)
    assert (np.abs(rest.values).max(axis=0) <= np.abs(plans.values).max(axis=0)).all()


def test_a_plan_never_shrinks_to_nothing(plans: Plans) -> None:
    late = plans.laid(SLOW - 50.0, SLOW)
    np.testing.assert_allclose(late.at(SLOW)[0], plans.values[N_BANKS - 1], atol=1e-13)
    assert np.isfinite(late.values).all()


def test_each_of_many_plans_of_a_flight_is_read_by_itself(plans: Plans) -> None:
    beside = plans.with_values(np.stack([plans.values, 2.0 * plans.values], axis=1))
    speed = np.array([[3000.0, 2000.0, 870.0], [1000.0, 900.0, 860.0]])
    expected = np.stack([plans.at(speed[0]), 2.0 * plans.at(speed[1])], axis=1)
    np.testing.assert_array_equal(beside.at(speed), expected)


def test_a_plan_through_samples_flies_them_within_the_limit() -> None:
    fast, slow = np.array([4000.0, 3000.0]), np.array([700.0, 700.0])
    speed = np.linspace(4200.0, 500.0, 200)[:, None] + np.zeros(2)
    bank = np.sin(speed / 700.0)
    plans = plans_through(speed, bank, fast, slow, np.array([2.0, 0.5]))
    for i in range(N_BANKS):
        v = fast - i / (N_BANKS - 1.0) * (fast - slow)
        expected = np.clip(np.sin(v / 700.0), [-2.0, -0.5], [2.0, 0.5])
        np.testing.assert_allclose(plans.at(v)[0], expected, atol=1e-3)
    assert not plans.values[N_BANKS:].any()


def test_the_equivalent_speed_is_the_speed_at_the_targets_altitude_and_kept_by_a_fall() -> None:
    assert equivalent_speed(9.81, 20e3, 20e3, 700.0) == 700.0
    fallen = np.sqrt(700.0**2 + 2.0 * 9.81 * 3e3)
    assert equivalent_speed(9.81, 20e3, 17e3, fallen) == pytest.approx(700.0, abs=1e-9)
    assert equivalent_speed(9.81, 20e3, 0.0, 100.0) == 0.0  # below all that can be
