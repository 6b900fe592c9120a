"""DOP853 behind our own words: accuracy asked for, stops, and integrations that have no end."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.propagation.adaptive_step import Accuracy, IntegrationError, Stop, integrate

Array = NDArray[np.float64]

FINE = Accuracy(relative=1e-10, small=(1.0, 1.0))


def circle(t: float, x: Array) -> Array:
    return np.array([x[1], -x[0]])


def test_it_is_as_accurate_as_asked() -> None:
    start = np.array([0.0, 1.0])
    fine = integrate(circle, (0.0, 10.0), start, FINE)
    coarse = integrate(circle, (0.0, 10.0), start, Accuracy(relative=1e-4, small=(1.0, 1.0)))
    assert fine.stop is coarse.stop is None
    assert fine.end == 10.0
    assert fine.state == pytest.approx([np.sin(10.0), np.cos(10.0)], abs=1e-8)
    assert fine.points.shape[1] > coarse.points.shape[1]
    assert fine.at is not None
    assert fine.at(3.0) == pytest.approx([np.sin(3.0), np.cos(3.0)], abs=1e-8)


def test_points_are_where_they_are_asked_for() -> None:
    times = np.linspace(0.0, 2.0, 5)
    found = integrate(circle, (0.0, 2.0), np.array([0.0, 1.0]), FINE, points=times)
    assert found.at is None
    assert found.points[0] == pytest.approx(np.sin(times), abs=1e-9)
    assert np.array_equal(found.state, found.points[:, -1])


@pytest.mark.parametrize(
    ("direction", "end"), [(0.0, np.pi / 6), (1.0, np.pi / 6), (-1.0, 5.0 * np.pi / 6)]
)
def test_a_stop_ends_it_where_it_crosses_zero_in_its_direction(
    direction: float, end: float
) -> None:
    half = Stop(lambda t, x: float(x[0]) - 0.5, direction)
    late = Stop(lambda t, x: t - 9.0)
    found = integrate(circle, (0.0, 10.0), np.array([0.0, 1.0]), FINE, stops=[late, half])
    assert found.stop is half
    assert found.end == pytest.approx(end, abs=1e-8)
    assert found.state == pytest.approx([0.5, np.cos(end)], abs=1e-8)


def test_cases_side_by_side_share_their_accuracy() -> None:
    """State by state: two cases of two states each."""
    accuracy = Accuracy(relative=1e-3, small=(10.0, 0.1))
    assert accuracy.absolute(2, 2) == pytest.approx([1e-2, 1e-2, 1e-4, 1e-4])


def test_what_has_no_end_is_an_error_of_its_own() -> None:
    with pytest.raises(IntegrationError, match="step size"):
        integrate(lambda t, x: x * x, (0.0, 2.0), np.ones(1), Accuracy(relative=1e-6))
