"""Angles modulo a turn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ampi.physics.angles import on_turn_of, wrapped

ANGLES = st.floats(-50.0, 50.0)


@given(ANGLES, st.integers(-5, 5))
def test_a_whole_turn_changes_nothing(angle, turns):
    difference = wrapped(angle + turns * 2.0 * np.pi) - wrapped(angle)
    assert abs(np.sin(0.5 * difference)) < 1e-13


@given(ANGLES)
def test_wrapped_is_the_angle_of_the_point_on_the_circle(angle):
    assert -np.pi <= wrapped(angle) < np.pi + 1e-15
    expected = np.arctan2(np.sin(angle), np.cos(angle))
    assert abs(np.sin(0.5 * (wrapped(angle) - expected))) < 1e-13


@given(ANGLES, ANGLES)
def test_on_turn_of_is_the_nearest_of_the_equal_angles(angle, reference):
    found = on_turn_of(angle, reference)
    assert abs(found - reference) <= np.pi + 1e-12
    assert np.sin(found) == pytest.approx(np.sin(angle), abs=1e-13)
    assert np.cos(found) == pytest.approx(np.cos(angle), abs=1e-13)


def test_an_angle_on_the_same_turn_is_kept_to_the_bit():
    angles = np.linspace(-3.0, 3.0, 101)
    assert np.array_equal(on_turn_of(angles, 0.1), angles)
    assert np.isnan(on_turn_of(np.nan, 0.0)) and np.isnan(wrapped(np.nan))
