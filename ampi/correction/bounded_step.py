"""The step of a plan: the least squares of a linear model, with the plan's values in bounds.

    minimise  ½ dᵀ A d − bᵀ d   with   −B ≤ p + d ≤ B                                       (1)

for n flights at once, (18, 18) each. A is positive definite. An active set of a few rounds: what stands
at a bound and is pushed outwards is held; the rest is solved by Cholesky's method; what then leaves its
bounds is held there, and the rest solved anew; where nothing leaves, what is held although A d − b draws
it inwards is let go. When there is neither, d is the optimum of (1). After the last round it is at least
a step in bounds, which the corrector judges by the flight. Flights that are done wait for the others.

Source: own; projected active sets: Bertsekas, "Projected Newton methods", SIAM J. Control 20, 1982.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUNDS = 10
LEAST_PIVOT = 1e-300


def bounded_step(matrix: Array, right: Array, values: Array, bound: Array) -> Array:
    """d of Eq. (1).

    Parameters
    ----------
    matrix
        A (m, m, n).
    right, values
        b and p (m, n).
    bound
        B (m, n), not negative.
    """
    pushed_up, pushed_down = right >= 0.0, right <= 0.0
    held = ((values >= bound) & pushed_up) | ((values <= -bound) & pushed_down)
    step, low, high = np.zeros_like(right), -bound - values, bound - values
    changes = np.ones(right.shape[1], dtype=bool)
    for _ in range(ROUNDS):
        found = np.where(changes, _solved(matrix, right, held, step), step)
        kept = np.minimum(np.maximum(found, low), high)
        leaves = ~held & (kept != found)
        step, held, is_more = kept, held | leaves, leaves.any(axis=0)
        slope = np.einsum("ijn,jn->in", matrix, step) - right
        inwards = ((step >= high) & (slope > 0.0)) | ((step <= low) & (slope < 0.0))
        let_go = held & inwards & ~is_more
        held, changes = held & ~let_go, changes & (is_more | let_go.any(axis=0))
        if not changes.any():
            break
    return step


def _solved(matrix: Array, right: Array, held: Mask, step: Array) -> Array:
    """The minimum over what is not held, the rest standing at `step`.

    A held row becomes one of the unit matrix, so that all flights have systems of one size.
    """
    fixed = np.where(held, step, 0.0)
    free_right = right.copy()
    for column in range(len(right)):
        free_right -= matrix[:, column] * fixed[column]
    free = ~held
    lower = np.where(free[:, None] & free, matrix, 0.0)
    np.einsum("iin->in", lower)[held] = 1.0
    found = np.where(held, step, free_right)
    size = len(found)
    for i in range(size):
        lower[i, i] = np.sqrt(np.maximum(lower[i, i], LEAST_PIVOT))
        below = lower[i + 1 :, i] / lower[i, i]
        lower[i + 1 :, i] = below
        lower[i + 1 :, i + 1 :] -= below[:, None] * below
        found[i] = found[i] / lower[i, i]
        found[i + 1 :] -= below * found[i]
    for i in reversed(range(size)):
        found[i] = found[i] / lower[i, i]
        found[:i] -= lower[i, :i] * found[i]
    return found
