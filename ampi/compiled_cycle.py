"""One cycle of the flight software by the flight code in C: what `GuidanceCycle` is in numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi._native.engine import WHY_NOT, core, is_available
from ampi.correction.plan import Plans
from ampi.correction.state import CorrectionState
from ampi.estimation.estimate import Estimate
from ampi.estimation.estimator import COUNTED
from ampi.estimation.settings import EstimatorSettings
from ampi.export.blob import LAWS, ORDERS
from ampi.guidance_cycle import not_begun
from ampi.onboard.command import Command
from ampi.onboard.flown_references import FlownReferences
from ampi.onboard.subspace import Order
from ampi.onboard.table import GuidanceTable
from ampi.tracking.bank_limiter import BankLimits
from ampi.tracking.law import TrackingLaw

Array = NDArray[np.float64]

WHOLE = ("outcome", "count", "iterations", "propagations", "learnt")  # rows that are whole numbers
SIZES = ("axes", "rows", "nodes", "segments", "nodes of a segment", "high-density points")


def why_not_compiled(
    table: GuidanceTable, law: TrackingLaw, orders: tuple[Order, ...]
) -> str | None:
    """Why the flight code cannot fly this, in a sentence; None if it can."""
    if not is_available():
        return WHY_NOT
    if type(law) not in LAWS:
        return f"flight code has no law {law.name}"
    if not set(orders) <= set(ORDERS):
        missing = next(order for order in orders if order not in ORDERS)
        return f"flight code does not interpolate by {missing.value}"
    nodes, points = table.conversion.shape
    segments = table.segments
    sizes = (len(table.axes), len(table.layout), nodes, *segments.nodes.shape, points)
    for name, size, most in zip(SIZES, sizes, core().MOST, strict=True):
        if size > most:
            return f"flight code was compiled for {most} {name} at the most, the table has {size}"
    return None


class CompiledCycle:
    """The memory of n flights in C."""

    def __init__(self, flown: FlownReferences, opened: Any, model: Any = None) -> None:
        """`opened` is the table in C, a `core().Table`; `model` what corrects, a `core().Model`."""
        self._flown, n = flown, len(flown)
        self.code = core().Guidance(opened, n, model)
        self._is_begun = False
        self.tracked = np.full((len(flown.table.layout), n), np.nan)

    def begin(self, parameters: Array) -> None:
        """Begin n flights of p (n, d), on references of C's own; `flown` is told of them."""
        flown, told = self._flown, np.empty((4, len(self._flown)))
        self.code.begin(np.ascontiguousarray(parameters))
        self.code.flown(told, flown.nodal)
        flown.final_time[:] = told[0]
        flown.clipped[:], flown.hole[:], flown.health[:] = told[1:]
        self._is_begun = True

    def follow(self, parameters: Array, limits: BankLimits) -> None:
        """The references that are flown have changed; C makes the limits of the parameters itself."""
        flown = self._flown
        told = np.stack([flown.final_time, flown.health.astype(float)], axis=1)
        self.code.follow(np.ascontiguousarray(parameters), flown.nodal, told)
        self._is_begun = True

    def aim(self, targets: Array) -> None:
        """The targets (4, n) of the correctors from now on."""
        self.code.aim(np.ascontiguousarray(targets))

    def correction_state(self, settings: EstimatorSettings) -> CorrectionState:
        """What estimators, of these settings, and correctors know."""
        n, table = len(self._flown), core().CORRECTED
        rows = np.empty((sum(count for _, count in table.values()), n))
        self.code.corrected(rows)
        own = {name: rows[first : first + count] for name, (first, count) in table.items()}
        whole = {name: own[name].astype(np.int64) for name in WHOLE}
        covariance = own["covariance"].reshape(len(own["mean"]), -1, n)
        return CorrectionState(
            outcome=whole["outcome"][0],
            counts=whole["count"],
            missed=own["missed"],
            to_go=own["to_go"][0],
            iterations=whole["iterations"][0],
            propagations=whole["propagations"][0],
            plans=Plans(own["fast"][0], own["slow"][0], own["plan"]),
            estimate=Estimate(own["mean"], covariance, own["altitude"][0], settings),
            learnt=dict(zip(COUNTED, whole["learnt"], strict=True)),
        )

    def expect_begin(self) -> None:
        """The next time begins a flight if it does not go on."""
        self.code.expect_begin()

    def reset(self) -> None:
        """Begin a new flight: the next command is the first, whatever its time."""
        self.code.reset()

    def step(self, time: float, navigated: Array, felt: Array) -> Command:
        """Commands at a time (s), of navigation (8, n) and accelerations (3, n)."""
        n = len(self._flown)
        if not self._is_begun:
            return not_begun(n)
        commands, self.tracked = np.empty((5, n)), np.empty_like(self.tracked)
        told, sensed = np.ascontiguousarray(navigated), np.ascontiguousarray(felt)
        self.code.step(time, told, sensed, commands, self.tracked)
        rate, bank, angle, steering, health = commands
        return Command(rate, bank, angle, steering.astype(np.int64), health.astype(np.int64))
