"""Which limits hold the step of one case, where exchanging them all at once does not settle.

From the step that no limit holds, the row that is exceeded the most is made to hold: its multiplier ν_p
grows, and with it z and the multipliers of the rows that hold already move along

    [ H   Kᵀ ] [dz]     [ k_p ]
    [ K   −C ] [dλ] = − [  0  ]                                                   (1)

until the row is at its bound, or a multiplier on the way is zero and its row is let go. Each row taken
costs or keeps a convex problem's value, so the set settles after finitely many steps. That is needed
where the bank angle's polynomial touches its limit between two nodes: rows that are all but alike then
come and go in turn.

References
----------
Goldfarb & Idnani (1983), Math. Program. 27, 1–33.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.scp.condensed.kkt_factors import KktFactors
from ampi.scp.condensed.limit_rows import FEASIBLE, Sides

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LimitedStep:
    """The convex problem of one case; its rows that always hold come first in λ."""

    factored: Callable[[Sides], KktFactors | None]  # with those rows held
    row: Callable[[int], Array]  # one row over z
    values: Callable[[Array], Array]  # all rows times z
    lower: Array
    upper: Array
    always: int  # how many rows hold always

    def side(self, value: Array, most: int) -> Sides | None:
        """Which rows (rows,) hold the solution; `value` is theirs where none holds."""
        side = np.zeros(len(value), dtype=np.int8)
        multipliers = np.zeros(len(value))  # along the outward normals: never negative
        value, worst, sign = value.copy(), -1, 0
        for _ in range(most):
            over = np.maximum(value - self.upper, self.lower - value)
            if worst < 0:
                worst = int(np.argmax(np.where(side == 0, over, 0.0)))
                if not over[worst] > FEASIBLE:
                    return side
                sign = 1 if value[worst] > self.upper[worst] else -1
            factors, held = self.factored(side), np.flatnonzero(side)
            if factors is None:
                return None
            normal = sign * self.row(worst)
            dz, change = factors.solution(normal, np.zeros(self.always + len(held)))
            moved, change = self.values(dz), change[self.always :] * side[held]
            falling = change < 0.0
            least = multipliers[held][falling] / -change[falling]
            until_free = least.min() if len(least) else np.inf
            closing = -sign * moved[worst]
            until_bound = over[worst] / closing if closing > 0.0 else np.inf
            length = min(until_free, until_bound)
            if not np.isfinite(length):
                return None  # the rows ask for more than there is
            value += length * moved
            multipliers[held] += length * change
            multipliers[worst] += length
            if until_bound <= until_free:
                side[worst], worst = sign, -1
            else:
                free = held[falling][np.argmin(least)]
                side[free], multipliers[free] = 0, 0.0
        return None
