"""The blob of a guidance, and flights recorded on it, nonsense among them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.onboard.row_layout import DRAG_TRACKING

Array = NDArray[np.float64]

NONSENSE = (np.nan, np.inf, -np.inf, 1e300, -1e300, 57.3, 5e-324, 0.0, -0.0)
OFF = np.array([1e3, 0.01, 0.01, 50.0, 5e-3, 0.01, 0.3, 0.02])


def blob_of(guidance: Guidance, **settings: Any) -> bytes:
    """Of all that it flies by."""
    return guidance.blob(**settings)


def some_parameters(guidance: Guidance, rng: np.random.Generator, n: int) -> Array:
    """p (n, d): inside, on faces, corners and grid points, outside, far outside, and nonsense."""
    axes = guidance.table.axes
    low, high = np.array([a[0] for a in axes]), np.array([a[-1] for a in axes])
    p: Array = low + (high - low) * rng.uniform(-0.02, 1.02, (n, len(axes)))
    for i in range(1, n, 2):
        axis = int(rng.integers(len(axes)))
        p[i, axis] = rng.choice([low[axis], high[axis], *axes[axis], *NONSENSE, 2.0 * np.pi])
    corners = rng.integers(0, 2, (n // 5, len(axes))).astype(bool)
    p[::5][: len(corners)] = np.where(corners, low, high)
    p[3::7] += (high - low) * rng.uniform(-3.0, 3.0, p[3::7].shape)
    turned = [*guidance.table.circular]
    p[2::11, turned] += 2.0 * np.pi * rng.integers(-4, 5, p[2::11, turned].shape)
    return p


def recorded(
    guidance: Guidance, p: Array, rng: np.random.Generator, n: int
) -> tuple[Array, Array, Array]:
    """Times (n,), navigation (n, 8) and sensed accelerations (n, 3) of a flight off its reference."""
    reference = guidance.reference(p).copy()
    layout, cycle = reference.layout, float(rng.choice([0.1, 0.5, 1.0, 2.0]))
    off = rng.standard_normal(8) * OFF * 10.0 ** rng.uniform(-3.0, 0.3)
    begin = rng.choice([0.0, rng.uniform(0.0, 300.0)])
    times = begin + np.cumsum(cycle * rng.choice([1, 1, 1, 1, 1 + 1e-9, 0.5, 2.0], n))
    navigation = np.stack([np.interp(times, reference.times, row) for row in reference.rows[:8]], 1)
    navigation += off + rng.standard_normal((n, 8)) * 1e-2 * OFF
    navigation[:, [1, 5, 6]] += (
        2.0 * np.pi * rng.integers(-4, 5, (n, 3)) * (rng.random((n, 3)) < 0.1)
    )
    drag = np.ones(n)
    if layout in (DRAG_TRACKING, DRAG_TRACKING.with_angle_of_attack):
        log_drag = reference.rows[layout.index("log_drag")]
        drag = np.exp(np.interp(times, reference.times, log_drag)) * rng.uniform(0.8, 1.2, n)
    bank = navigation[:, 6]
    sensed = drag[:, None] * np.stack([-np.ones(n), 0.5 * np.cos(bank), 0.5 * np.sin(bank)], 1)
    for array, share in ((navigation, 0.005), (sensed, 0.02)):
        hit = rng.random(array.shape) < share
        array[hit] = rng.choice(NONSENSE, np.count_nonzero(hit))
    wrong = rng.random(n) < 0.03
    times[wrong] += rng.choice([np.nan, np.inf, -5.0, 1e3, -1e300, 5e-4], np.count_nonzero(wrong))
    return times, navigation, sensed


def numpy_commands(
    guidance: Guidance, times: Array, navigation: Array, sensed: Array | None
) -> Any:
    """(numbers (n, 3), steering and health (n, 2)) of `Guidance.step`, one cycle after the other."""
    felt = [None] * len(times) if sensed is None else list(sensed)
    commands = [guidance.step(t, x, a) for t, x, a in zip(times, navigation, felt, strict=True)]
    numbers = np.array([[c.bank_rate, c.bank_angle, c.angle_of_attack] for c in commands])
    return numbers, np.array([[int(c.steering), int(c.health)] for c in commands])
