"""What estimators and correctors of n flights know at an instant: for logs, tests and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.correction.plan import Plans
from ampi.estimation.estimate import Estimate

Array = NDArray[np.float64]
Counts = NDArray[np.int64]


@dataclass(frozen=True, eq=False, kw_only=True)
class CorrectionState:
    """Of n flights, since their begin."""

    outcome: Counts  # (n,): CorrectionOutcome of the last correction
    counts: Counts  # (8, n): how often each outcome has come
    missed: Array  # (6, n): predicted miss east, north, up (m); excess of q, heat flux, load factor
    to_go: Array  # (n,), s, as predicted last
    iterations: Counts  # (n,), of the last correction
    propagations: Counts  # (n,): flights that it predicted
    plans: Plans
    estimate: Estimate
    learnt: Mapping[
        str, Counts
    ]  # (n,) each: measurements used, weak, unusable, stuck, gated; resets
