"""The terminal cost as an elastic target.

φ = Σ w_i e_i², e = x_f − x_target, is stiff: w is chosen to leave metres at the end of a flight of
1,500 km. Minimised as it stands, it makes every merit function a narrow valley, and its multiplier
2 w e, far from the target, swamps the curvature of the Lagrangian. So e becomes a variable of the
subproblem, tied to the linearised flight and freed at a price ν:

    C z + (x_f − x_target) = e + v⁺ − v⁻,   cost Σ w e² + ν (v⁺ + v⁻),   v ≥ 0    (1)

which is φ again wherever |2 w e| < ν, and linear beyond (Huber):

    φ_ν(e) = w e² for |e| ≤ ν/2w,  ν|e| − ν²/4w otherwise.                      (2)

The multiplier λ of Eq. (1) never exceeds ν, and the minimiser is that of φ once every v is zero. A
final state that is to be met exactly, or to be kept in a range, has e_lo ≤ e ≤ e_hi in the place of w,
and φ_ν(e) = ν · max(0, e − e_hi, e_lo − e): the same exact penalty.

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

from ampi.scp.problem.scaled_problem import Target

Array = NDArray[np.float64]

SLACK = 1e-7  # a range row with a multiplier below this fraction of ν is inactive
BOUND = 0.99  # a multiplier above this fraction of ν counts as elastic


@dataclass(frozen=True, kw_only=True)
class ElasticSettings:
    """Dimensionless; the prices multiply Eq. (3)."""

    price: float = 6.0  # of weighted rows
    bounded_price: float = 0.6  # of rows with bounds: Eq. (3) is for all rows at once, and too dear
    growth: float = 100.0
    growths: int = 1  # at convergence: then the target is met, or out of reach
    settled: int = (
        8  # accepted steps with the same elastic rows, some weighted: then Newton's model
    )


def reference_price(terminal_map: Array, effort_curvature: Array, reference_effort: float) -> Array:
    """Eq. (3): `terminal_map` C over δu (m, n_u), `effort_curvature` the diagonal of Q (n_u,)."""
    gram = (terminal_map / effort_curvature) @ terminal_map.T
    scale = np.sqrt(np.diag(gram))
    inverse = np.linalg.inv(gram / np.outer(scale, scale) + 1e-12 * np.eye(len(scale)))
    return np.asarray(np.sqrt(reference_effort * np.diag(inverse)) / scale)


def elastic_cost(error: Array, target: Target, price: Array) -> float:
    """Σ φ_ν(e_i), Eq. (2), of the rows of `target`."""
    size = np.abs(error)
    weight = np.where(target.weight > 0.0, target.weight, 1.0)
    quadratic = weight * size**2
    linear = price * size - price**2 / (4.0 * weight)
    huber = np.where(2.0 * weight * size <= price, quadratic, linear)
    outside = np.maximum(np.maximum(error - target.upper, target.lower - error), 0.0)
    return float(np.where(target.weight > 0.0, huber, price * outside).sum())


def is_elastic(multiplier: Array, price: Array) -> NDArray[np.bool_]:
    """Where the target is being bought off instead of met."""
    return np.asarray(np.abs(multiplier) > BOUND * price)


def held_targets(target: Target, multiplier: Array, price: Array) -> NDArray[np.bool_]:
    """Rows that hold the step: not bought off, and not inside their range."""
    inside = (target.weight == 0.0) & (target.lower < target.upper)
    return ~is_elastic(multiplier, price) & ~(inside & (np.abs(multiplier) < SLACK * price))
