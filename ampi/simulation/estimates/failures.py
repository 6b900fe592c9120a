"""Why flights failed: exactly one class per flight, so that the counts add up to all that were flown.

Classes are tried in the order in which they are written, and the first that holds is the flight's:
what makes a flight meaningless comes before what no guidance can help, that before how and where it
ended, and that before a limit. A flight that passed has no failure, whatever else is said of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.outcome import Outcome
from ampi.simulation.estimates.proportions import Fraction
from ampi.simulation.plant import FlightStatus

Array = NDArray[np.float64]


class FailureClass(Outcome):
    """Why a flight failed."""

    NONE = 0, "The flight passed."
    NOT_A_NUMBER = 1, "Its state or its parameters were no numbers."
    STARTED_SLOW = 2, "It entered no faster than the target speed."
    OUT_OF_REACH = 3, "Its target lay nearer than its least range, or beyond its greatest."
    SKIP = (
        4,
        "It rose again after its pull-up, and left the atmosphere or flew until its time was up.",
    )
    GROUND = 5, "It met the ground before it reached the target speed."
    TIME_LIMIT = 6, "It flew until its time was up."
    MISSED = 7, "It reached the target speed outside a tolerance."
    LIMIT = 8, "It ended where it should, and exceeded a limit on the way."


@dataclass(frozen=True, eq=False)
class Reach:
    """What n flights could have flown to, by propagation from their entry; m over ground."""

    distance: Array  # (n,), to the target at entry
    least: Array  # (n,), range; NaN: unknown
    greatest: Array  # (n,)

    def __post_init__(self) -> None:
        if np.any(self.least > self.greatest):
            raise ValueError(
                "reach: expected a least range below the greatest, got the opposite of flights "
                f"{np.flatnonzero(self.least > self.greatest)[:5].tolist()}"
            )

    @property
    def missing(self) -> NDArray[np.bool_]:
        """(n,): the target is known to lie outside."""
        return (self.distance < self.least) | (self.distance > self.greatest)


def skipped(
    rebound: Array, status: NDArray[np.int64], above: float, entry: float
) -> NDArray[np.bool_]:
    """Flights, (n,), that rose above `above` (m) after their first descent and did not come back.

    They rose above their `entry` (m), or their time was up. `rebound` (n,), m, is the highest altitude
    after the first descent, NaN of a flight that never rose.
    """
    late = status == int(FlightStatus.TIME_LIMIT)
    return (rebound > above) & (late | (rebound > entry))


def classify(
    status: NDArray[np.int64],
    passed: NDArray[np.bool_],
    arrived: NDArray[np.bool_],
    *,
    skipped: NDArray[np.bool_] | None = None,
    reach: Reach | None = None,
) -> NDArray[np.int64]:
    """Class of every flight (n,), `FailureClass`.

    `status` (n,), `FlightStatus`; `passed` (n,), the whole requirement; `arrived` (n,), within every
    tolerance at the end; `skipped` (n,), by the function of that name. None: nothing is known.
    """
    n = len(status)
    nothing = np.zeros(n, dtype=bool)
    conditions = {
        FailureClass.NONE: passed,
        FailureClass.NOT_A_NUMBER: status == int(FlightStatus.NOT_FINITE),
        FailureClass.STARTED_SLOW: status == int(FlightStatus.STARTED_SLOW),
        # who arrived refutes the estimate of his range
        FailureClass.OUT_OF_REACH: nothing if reach is None else reach.missing & ~arrived,
        FailureClass.SKIP: nothing if skipped is None else skipped,
        FailureClass.GROUND: status == int(FlightStatus.GROUND),
        FailureClass.TIME_LIMIT: status == int(FlightStatus.TIME_LIMIT),
        FailureClass.MISSED: ~arrived,
    }
    wrong = [k.name for k, condition in conditions.items() if condition.shape != (n,)]
    if wrong:
        raise ValueError(
            f"classify: expected one value for each of {n} flights, not so for {wrong}"
        )
    found = np.select(list(conditions.values()), list(conditions), FailureClass.LIMIT)
    return found.astype(np.int64)


def counts(classes: NDArray[np.int64]) -> dict[FailureClass, Fraction]:
    """Flights of every class, those of none included; they add up to all."""
    if not np.all(np.isin(classes, list(FailureClass))):
        raise ValueError("classes: expected members of FailureClass")
    return {kind: Fraction.of(classes == int(kind)) for kind in FailureClass}
