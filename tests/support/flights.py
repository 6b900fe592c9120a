"""Campaigns compared to the last bit."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ampi.simulation.flights import Flights


def assert_identical(one: Flights, two: Flights) -> None:
    """Types, shapes and bits; what lies in a file is read."""
    for field in fields(Flights):
        a, b = getattr(one, field.name), getattr(two, field.name)
        if hasattr(b, "dtype"):
            assert a.dtype == b.dtype, field.name
            nan = np.issubdtype(a.dtype, np.floating)
            assert np.array_equal(a[()], b[()], equal_nan=nan), field.name
        else:
            assert (type(a), a) == (type(b), b), field.name
