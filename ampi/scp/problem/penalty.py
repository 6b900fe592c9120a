"""Exact penalty on the path limits.

    merit = cost + φ_ν(e) + ρ Σ_k max(0, max_i g_ik − 1)                      (1)

ρ must exceed the sum of the limits' multipliers. It starts far above those of an ordinary mission
and, where an excess stays open at convergence, grows tenfold, several times: a limit a hair above
what is feasible has multipliers of any size. It comes down only where the multipliers are known
(merit_weights). Stopping as soon as a growth leaves the excess almost unmoved was tried, and gives up
feasible limits: the excess falls late.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PenaltySettings:
    """In units of the reference cost; the limits are scaled to one."""

    initial: float = 20.0
    growth: float = 10.0
    growths: int = 5  # then the limit counts as one that cannot be kept
    tolerance: float = 1e-6  # excess counted as open


def limit_excess(path: Array) -> Array:
    """Excess of each limit (m,) from g (n, m)."""
    return np.asarray(np.maximum(path.max(axis=0) - 1.0, 0.0))
