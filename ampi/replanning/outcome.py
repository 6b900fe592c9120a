"""What has become of a re-planning, and what it cost."""

from __future__ import annotations

from dataclasses import dataclass

from ampi.outcome import Outcome
from ampi.trajectory import Trajectory


class ReplanOutcome(Outcome):
    """How a re-planning ended. Numbers are recorded and never change their meaning."""

    REPLANNED = 0, "A plan from the present state ends on the target and keeps every limit."
    OUT_OF_REACH = 1, "The plan ends as near to the target as its objective lets it, not on it."
    LIMITS_EXCEEDED = 2, "The plan exceeds a path limit, which no better one keeps."
    BUDGET_SPENT = 3, "The iterations ended before the plan settled; it is a flight all the same."
    NO_STEP = 4, "No plan: the iteration found no step, or none that can be flown."
    NO_STATE = 5, "Not tried: the state or the time is no plausible one."
    NO_ESTIMATE = 6, "Not tried: an estimated number is not finite, or far from its nominal one."
    NO_PLAN = 7, "Not tried: the plan that is flown has numbers that are not finite."
    ANOTHER_PLAN = 8, "Not tried: the plan that is flown is of another table, or another flight."
    TARGET_BEHIND = 9, "Not tried: the target is behind the vehicle."
    AT_THE_END = 10, "Not tried: the vehicle is as slow as the target already."

    @property
    def has_plan(self) -> bool:
        """Whether there is a plan that flies from the present state."""
        return self <= ReplanOutcome.BUDGET_SPENT


@dataclass(frozen=True)
class ReplanStatistics:
    """What a re-planning cost, and how far it came."""

    iterations: int = 0  # with matrices of their own
    simplified_steps: int = 0  # with those of the iteration before
    seconds: float = 0.0  # all of it
    step: float = float("nan")  # rad: greatest change of the bank angle in the last step


@dataclass(frozen=True)
class Replan:
    """A plan for the rest of a flight, or why there is none."""

    status: ReplanOutcome
    trajectory: Trajectory | None = None
    statistics: ReplanStatistics = ReplanStatistics()
    horizontal_miss: float = float("nan")  # m, of the plan's end from the target
    altitude_miss: float = float("nan")  # m, up
