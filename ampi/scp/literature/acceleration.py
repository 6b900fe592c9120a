"""Aitken relaxation: a longer step where successive steps point the same way and shrink.

Successive convexification is a fixed-point iteration x ← G(x) with steps f_k = G(x_k) − x_k. What a
convex subproblem cannot hold, curvature that is negative along a free direction, leaves a slow part:
steps of one direction that shrink by a constant ratio λ. Their sum is known beforehand,

    x* − x_k = f_k (1 + λ + λ² + …) = ω f_k,    ω = 1 / (1 − λ),                         (1)

and with x_k = x_{k−1} + ω_{k−1} f_{k−1} the ratio is the slope of G along the last move,

    λ = 1 + f_{k−1}·(f_k − f_{k−1}) / (ω_{k−1} f_{k−1}·f_{k−1}).                         (2)

It is Anderson's acceleration (1965) of depth one, of the first type of Fang and Saad (2009), with the
one direction that two steps define. The least squares of the second type, depths two and three, and a
ratio of every state alone were tried: none was quicker. A subproblem's solution is still what is
compared and returned: only the point where the next linearisation is made lies further on.

Irons, Tuck (1969), Int. J. Numer. Methods Eng. 1, 275–277. Anderson (1965), J. ACM 12, 547–560.
Fang, Saad (2009), Numer. Linear Algebra Appl. 16, 197–221. Walker, Ni (2011), SIAM J. Numer. Anal. 49.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WHOLE = 1.0 - 1e-3  # of the trust radius: a step that reaches it was cut, and tells no ratio


@dataclass(frozen=True, kw_only=True)
class AitkenRelaxation:
    """Eqs. (1), (2) with their safeguards; for a mesh that does not change."""

    parallel: float = 0.5  # least cosine between two steps, else the whole step is taken
    longest: float = 2.0  # ω at most

    def length(self, step: Array, last: Array | None, last_length: float) -> float:
        """ω of `step` after a step `last` of length `last_length`, (n, n_x) in trust radii."""
        if last is None or max(np.abs(step).max(), np.abs(last).max()) > WHOLE:
            return 1.0
        along, before = float(np.sum(step * last)), float(np.sum(last * last))
        if along <= self.parallel * np.sqrt(before * np.sum(step * step)):
            return 1.0
        ratio = 1.0 + (along - before) / (last_length * before)
        return float(1.0 / (1.0 - np.clip(ratio, 0.0, 1.0 - 1.0 / self.longest)))
