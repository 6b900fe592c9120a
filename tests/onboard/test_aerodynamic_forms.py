"""Coefficients on board: those of any point do not depend on the company that it is asked in."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.onboard.aerodynamic_forms import SplineForm

RNG = np.random.default_rng(7)
TABLE = SplineForm(
    angle_of_attack=np.radians([5.0, 12.0, 20.0, 33.0, 45.0]),
    mach=np.array([1.0, 4.0, 9.0, 20.0]),
    lift=RNG.normal(size=(5, 4)),
    drag=RNG.normal(size=(5, 4)),
)


@pytest.mark.parametrize(
    ("angles", "machs"), [((3,), (2, 3)), ((2, 3), (3,)), ((), (4,)), ((2, 1, 3), (5, 1))]
)
def test_points_of_a_table_are_broadcast(angles: tuple[int, ...], machs: tuple[int, ...]) -> None:
    """A schedule over time is the same for all flights, whose Mach numbers differ."""
    alpha = np.radians(RNG.uniform(0.0, 50.0, angles))
    mach = RNG.uniform(0.5, 25.0, machs)
    lift, drag = TABLE.coefficients(alpha, mach)
    pairs = np.stack([x.ravel() for x in np.broadcast_arrays(alpha, mach)], axis=-1)
    one_by_one = [TABLE.coefficients(*pair) for pair in pairs]
    assert lift.shape == drag.shape == np.broadcast_shapes(angles, machs)
    np.testing.assert_array_equal(np.stack([lift.ravel(), drag.ravel()], axis=-1), one_by_one)
