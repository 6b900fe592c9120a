"""The flight that a relaxed control is the limit of.

Over energy the rates are affine in u = (cos σ, sin σ), so every point of the disc u₁² + u₂² ≤ 1 is
reached by bank angles on the circle, as the mean of quick reversals between σ and −σ (the chattering
of relaxed controls: Young 1969; Filippov 1962):

    u = share · (u₁, √(1 − u₁²)) + (1 − share) · (u₁, −√(1 − u₁²)),
    share = ½ (1 + u₂ / √(1 − u₁²)).                                          (1)

A trapezoid takes the mean of two nodes, so it, too, sees a reversal within one interval as a jump at
its middle. Here the cell about each node, middle to middle, spends `share` of its length at +arccos u₁
and the rest at −arccos u₁, with no more reversals than that needs. At a tight node share is 0 or 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TIGHT = 1e-3  # u₁² + u₂² above 1 − TIGHT counts as on the circle


def positive_share(u: Array) -> Array:
    """Share of Eq. (1) (n,) of controls (n, 2)."""
    reach = np.sqrt(np.maximum(1.0 - u[:, 0] ** 2, 1e-12))
    side = np.clip(u[:, 1] / reach, -1.0, 1.0)
    tight = np.sum(u**2, axis=1) >= 1.0 - TIGHT
    return np.asarray(0.5 * (1.0 + np.where(tight, np.sign(u[:, 1]), side)))


def reversals(s: Array, u: Array) -> tuple[float, Array]:
    """Sign of the bank angle at s_0, and where it turns over (k,); nodes s (n,), controls u (n, 2)."""
    share = positive_share(u)
    edges = np.concatenate([s[:1], 0.5 * (s[1:] + s[:-1]), s[-1:]])
    sign = first = 1.0 if share[0] >= 0.5 else -1.0
    turns: list[float] = []
    for start, end, positive in zip(edges[:-1], edges[1:], share, strict=True):
        staying = positive if sign > 0.0 else 1.0 - positive
        if staying >= 1.0 - TIGHT:
            continue
        turns.append(float(start + staying * (end - start)))
        sign = -sign
    return first, np.array(turns)
