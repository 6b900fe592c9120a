"""When a campaign has flown enough: the exact interval of a share is as narrow as was asked.

The rule looks after whole batches alone, so that it stops at the same flight for any number of workers.

Whoever looks more than once stops where the count happened to be extreme, and the interval at the stop
no longer holds what it claims. Summed over all paths of counts, in batches of 100 and with widths of 3,
5 and 10 %, the Clopper–Pearson interval at the stop holds the share in 93.9 % of campaigns or more, for
each of 78 shares: what it loses is about what it was wider than need be. Report a stopped campaign as
stopped, or plan its flights with `flights_needed` and look once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.simulation.estimates.proportions import Fraction


@dataclass(frozen=True)
class StopRule:
    """Stop once the 95 % interval of the share of flights within `radius` is no wider than `width`."""

    radius: float  # m, around the target
    width: float  # of the whole interval, 0 … 1
    batch: int = 100  # flights between two looks

    def __post_init__(self) -> None:
        if not self.radius > 0.0:
            raise ValueError(f"radius: expected a positive length (m), got {self.radius!r}")
        if not 0.0 < self.width < 1.0:
            raise ValueError(f"width: expected a share between 0 and 1, got {self.width!r}")
        if not isinstance(self.batch, int) or self.batch < 1:
            raise ValueError(
                f"batch: expected a number of flights of at least 1, got {self.batch!r}"
            )


def stop_at(hits: NDArray[np.bool_], rule: StopRule) -> int | None:
    """Flights at which the campaign stops, a multiple of the batch; None: it flies on.

    `hits` (n,), in the order of the draws; flights beyond the last whole batch are not looked at.
    """
    counts = np.cumsum(hits)
    looks = range(rule.batch, len(hits) + 1, rule.batch)
    narrow = (n for n in looks if Fraction.counted(int(counts[n - 1]), n).width <= rule.width)
    return next(narrow, None)


def is_enough(hits: NDArray[np.bool_], rule: StopRule) -> bool:
    """Whether the campaign may stop, or might have before."""
    return stop_at(hits, rule) is not None


def flights_needed(share: float, rule: StopRule) -> int:
    """Flights to plan for a share that is expected (0 … 1): whole batches, without a look between."""
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"share: expected a number from 0 to 1, got {share!r}")

    def wide(batches: int) -> bool:
        n = batches * rule.batch
        return Fraction.counted(round(share * n), n).width > rule.width

    enough = 1
    while wide(enough):
        enough *= 2
    fewer = enough // 2
    while enough - fewer > 1:
        between = (enough + fewer) // 2
        fewer, enough = (between, enough) if wide(between) else (fewer, between)
    return enough * rule.batch
