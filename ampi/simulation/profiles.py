"""Density and wind over altitude: noise that is correlated over altitude, tables, and drawn rows.

Noise z is a stationary first-order Gauss–Markov process on the altitudes h_k, a step Δ apart,

    z_0 = ε_0,   z_k = φ z_{k−1} + √(1 − φ²) ε_k,   φ = exp(−Δ/L),   ε_k ~ N(0, 1),             (1)

so each z_k is N(0, 1), and z_j, z_k have the correlation exp(−|h_j − h_k|/L). Wind is σ z for each
component. Density is the factor

    exp(s z − s²/2),   s² = ln(1 + σ²):                                                          (2)

positive whatever is drawn, of mean 1 and of relative standard deviation σ exactly. 1 + σ z was rejected:
it is negative for some draw at any σ.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.simulation.uniform_numbers import seeds_of

Array = NDArray[np.float64]

STEP = 1e3  # m
ALTITUDES: Array = STEP * np.arange(
    131, dtype=float
)  # m: up to 130 km, the highest entry of a mission
ALTITUDES.setflags(write=False)


def correlated_noise(uniforms: Array, lengths: Array, components: int = 1) -> Array:
    """z of Eq. (1), (components, n, k), each flight seeded by its uniform number.

    `uniforms` and the correlation `lengths` (m) have shape (n,).
    """
    z = np.empty((components, len(uniforms), len(ALTITUDES)))
    for i, seed in enumerate(seeds_of(uniforms).tolist()):
        z[:, i] = np.random.default_rng(seed).standard_normal((components, len(ALTITUDES)))
    kept, fresh = np.exp(-STEP / lengths), np.sqrt(-np.expm1(-2.0 * STEP / lengths))
    for k in range(1, len(ALTITUDES)):
        z[..., k] = kept * z[..., k - 1] + fresh * z[..., k]
    return z


def density_noise(uniforms: Array, deviation: Array, lengths: Array) -> Array:
    """Factor on the density (n, k), Eq. (2), of relative standard `deviation` (n,)."""
    variance = np.log1p(deviation * deviation)[:, None]
    (z,) = correlated_noise(uniforms, lengths)
    return np.asarray(np.exp(np.sqrt(variance) * z - 0.5 * variance))


def wind_noise(uniforms: Array, deviation: Array, lengths: Array) -> Array:
    """East and north components (2, n, k), m/s, of standard `deviation` (n,), independent."""
    return np.asarray(deviation[:, None] * correlated_noise(uniforms, lengths, components=2))


def on_altitudes(knots: Array, values: Array) -> Array:
    """`values` (…, knots) linearly between their altitudes, constant beyond them: (…, k)."""
    left = np.clip(np.searchsorted(knots, ALTITUDES, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((ALTITUDES - knots[left]) / (knots[left + 1] - knots[left]), 0.0, 1.0)
    return np.asarray(values[..., left] + share * (values[..., left + 1] - values[..., left]))
