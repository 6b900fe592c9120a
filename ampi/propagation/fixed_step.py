"""The classical Runge–Kutta method of order four, for any number of flights at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rates = Callable[[Array, Any, Any], Array]  # of state, control, time


def rk4_step(
    rates: Rates,
    state: Array,
    begin: Any,
    end: Any,
    time: Any,
    step: Any,
    first: Array | None = None,
) -> Array:
    """The state one `step` (s) after `time` (s), under a control linear from `begin` to `end`.

    State, control, time and step are numbers or arrays that broadcast against each other; `first` are
    the rates at the begin, if they are known.
    """
    middle, half = 0.5 * (begin + end), 0.5 * step
    k1 = rates(state, begin, time) if first is None else first
    k2 = rates(state + half * k1, middle, time + half)
    k3 = rates(state + half * k2, middle, time + half)
    k4 = rates(state + step * k3, end, time + step)
    return np.asarray(state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
