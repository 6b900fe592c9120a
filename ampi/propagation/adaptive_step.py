"""DOP853 (Hairer, Nørsett, Wanner 1993; scipy) with an error per step, and what ends a flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]


class IntegrationError(RuntimeError):
    """The integrator gave up: nobody flies like this."""


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Error allowed per step: this share of each state, and of what counts as small of it."""

    relative: float
    small: tuple[float, ...] = (
        1e4,
        0.1,
        0.1,
        1e3,
        0.01,
        0.1,
        0.1,
        0.1,
    )  # m, rad, m/s: h, θ, φ, V, γ, ψ, σ, α

    def absolute(self, states: int, cases: int) -> Array:
        """For the first `states` of `cases`, state by state: (states · cases,)."""
        return np.repeat(self.relative * np.array(self.small[:states]), cases)


@dataclass(frozen=True)
class Stop:
    """A function of time and state whose zero ends the flight: crossed upwards (1), downwards (−1)."""

    value: Callable[[float, Array], float]
    direction: float = 0.0  # 0: either way


@dataclass(frozen=True, eq=False)
class Integration:
    """A flight from its start to its end; n components, k points."""

    end: float
    state: Array  # (n,), there
    stop: Stop | None  # that ended it
    points: Array  # (n, k), states at the points that were asked for, or at its own
    at: (
        Callable[[Any], Array] | None
    )  # state (n,) or (n, j) at any time, where no points were asked for


def integrate(
    rates: Callable[[float, Array], Array],
    span: tuple[float, float],
    state: Array,
    accuracy: Accuracy,
    *,
    points: Array | None = None,
    stops: Sequence[Stop] = (),
    cases: int = 1,
) -> Integration:
    """Integrate `rates` over `span` from `state` (n · cases,), until one of `stops` if there are any.

    Raises
    ------
    IntegrationError
        If no step is small enough.
    """
    found = solve_ivp(
        rates,
        span,
        state,
        method="DOP853",
        t_eval=points,
        dense_output=points is None,
        events=[_event(stop) for stop in stops] or None,
        rtol=accuracy.relative,
        atol=accuracy.absolute(len(state) // cases, cases),
    )
    if not found.success:
        raise IntegrationError(found.message)
    for stop, t, y in zip(stops, found.t_events or (), found.y_events or (), strict=True):
        if len(t):
            return Integration(float(t[0]), y[0], stop, found.y, found.sol)
    return Integration(span[1], found.y[:, -1], None, found.y, found.sol)


def _event(stop: Stop) -> Callable[[float, Array], float]:
    def event(time: float, state: Array) -> float:
        return stop.value(time, state)

    event.terminal, event.direction = True, stop.direction  # type: ignore[attr-defined]
    return event
