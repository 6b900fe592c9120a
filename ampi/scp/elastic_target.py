"""The terminal cost as an elastic target.

φ = Σ w_i e_i², e = x_f − x_target, is stiff: w is chosen to leave metres at the end of a flight of
1,500 km. Minimised as it stands, it makes every merit function a narrow valley, and its multiplier
2 w e, far from the target, swamps the curvature of the Lagrangian. So e becomes a variable of the
subproblem, tied to the linearised flight and freed at a price ν:

    C z + (x_f − x_target) = e + v⁺ − v⁻,   cost Σ w e² + ν (v⁺ + v⁻),   v ≥ 0    (1)

which is φ again wherever |2 w e| < ν, and linear beyond (Huber):

    φ_ν(e) = w e² for |e| ≤ ν/2w,  ν|e| − ν²/4w otherwise.                      (2)

The multiplier λ of Eq. (1) never exceeds ν, and the minimiser is that of φ once every v is zero.
ν needs no tuning: moving the target by e costs an effort of about ½ eᵀG⁻¹e, G = C Q⁻¹ Cᵀ with Q the
effort's curvature, so a bank profile of effort E_ref (one sweep from limit to limit) has multipliers
of the size

    λ_i ≈ √(E_ref (G⁻¹)_ii),                                                     (3)

and ν is a few times that. Where v stays open at convergence ν grows; where it stays open to the end,
the target is out of reach.

References
----------
Nocedal & Wright (2006), Section 18.5 (elastic mode). Huber (1964), Ann. Math. Stat. 35.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BOUND = 0.99  # a multiplier above this fraction of ν counts as elastic


@dataclass(frozen=True, kw_only=True)
class ElasticSettings:
    """Dimensionless; `price` multiplies Eq. (3)."""

    price: float = 6.0
    growth: float = 100.0
    growths: int = 1  # at convergence: then the target is met, or out of reach
    settled: int = 8  # accepted steps with the same elastic targets: then Newton's model is tried


def reference_price(terminal_map: Array, effort_curvature: Array, reference_effort: float) -> Array:
    """Eq. (3): `terminal_map` C over δu (m, n_u), `effort_curvature` the diagonal of Q (n_u,)."""
    gram = (terminal_map / effort_curvature) @ terminal_map.T
    scale = np.sqrt(np.diag(gram))
    inverse = np.linalg.inv(gram / np.outer(scale, scale) + 1e-12 * np.eye(len(scale)))
    return np.asarray(np.sqrt(reference_effort * np.diag(inverse)) / scale)


def huber(error: Array, weight: Array, price: Array) -> float:
    """Σ φ_ν(e_i), Eq. (2)."""
    size = np.abs(error)
    quadratic = weight * size**2
    linear = price * size - price**2 / (4.0 * weight)
    return float(np.where(2.0 * weight * size <= price, quadratic, linear).sum())


def is_elastic(multiplier: Array, price: Array) -> NDArray[np.bool_]:
    """Where the target is being bought off instead of met."""
    return np.asarray(np.abs(multiplier) > BOUND * price)
