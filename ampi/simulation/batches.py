"""A batch of a campaign as a job for worker processes, and when there have been enough of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.simulation.campaign_records import BatchRecords
from ampi.simulation.estimates.stopping import StopRule, is_enough
from ampi.simulation.outcomes import flown
from ampi.simulation.plant import FlightStatus
from ampi.simulation.truth import Truth
from ampi.workers.job import JobError, finished

MODULE = __name__  # what a worker imports


@dataclass(frozen=True, eq=False)
class Batch:
    """Flights that are flown together; flown again they are the same to the bit."""

    mission: Mission
    guidance: Guidance
    truth: Truth
    record_every: float  # s
    label: str
    number: int
    records: BatchRecords | None  # where it is kept; None: it travels back

    def compute(self, announce: Callable[[int], None]) -> Future[Any]:
        """Fly them."""
        announce(0)
        arrays = flown(self.mission, self.guidance, self.truth, self.record_every)
        if self.records is None:
            return finished(arrays)
        return self.records.keep(self.number, arrays)

    def without(self, attempt: int) -> Batch:
        """There is one way to fly them."""
        return self

    def give_up(self, reason: str) -> Any:
        """There is no campaign without them."""
        raise JobError(
            f"{self.label}: {reason} If the memory was short, try fewer worker processes"
        )


class Watch:
    """What a stop rule has seen of one scheme."""

    def __init__(self, rule: StopRule | None) -> None:
        self._rule, self._hits = rule, np.zeros(0, dtype=bool)

    def see(self, batch: Mapping[str, NDArray[Any]]) -> None:
        """One more batch."""
        if self._rule is not None:
            reached = batch["status"] == int(FlightStatus.REACHED_SPEED)
            hits = reached & (batch["miss"] <= self._rule.radius)
            self._hits = np.concatenate([self._hits, hits])

    @property
    def is_enough(self) -> bool:
        """Whether it has seen enough; never without a rule."""
        return self._rule is not None and is_enough(self._hits, self._rule)
