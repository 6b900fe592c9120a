"""`flights.plot`: the figures of a campaign, each a matplotlib Figure that a notebook shows.

flights.plot.footprint()
corrected.plot.misses(uncorrected=flights)        another campaign beside it, by its name
flights.plot.ground_track(mission)                what is drawn against the mission needs it
"""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.figure import Figure

from ampi.missions.mission import Mission
from ampi.report.figures import campaign, flown
from ampi.report.figures.end_map import end_map
from ampi.report.figures.misses import miss_distributions
from ampi.report.figures.sensitivity import sensitivity
from ampi.report.scheme_groups import reference_words
from ampi.simulation.flights import Flights


@dataclass(frozen=True, eq=False)
class FlightsPlots:
    """The figures of some flights."""

    flights: Flights

    def footprint(self, **others: Flights) -> Figure:
        """Where they end, across and along the nominal track, with 95 % ellipses."""
        return flown.end_points(self._beside(others))

    def misses(self, **others: Flights) -> Figure:
        """The share of the flights within a distance of the target."""
        return miss_distributions(self._beside(others))

    def altitude(self, **others: Flights) -> Figure:
        """Altitude over speed and over time."""
        return flown.descents(self._beside(others))

    def bank(self, **others: Flights) -> Figure:
        """Bank angle over time, and the change of the angle of attack where it is steered."""
        return flown.bank_angles(self._beside(others))

    def loads(self, **others: Flights) -> Figure:
        """The use of each limit over time."""
        return flown.limits_used(self._beside(others))

    def states(self, mission: Mission, **others: Flights) -> Figure:
        """The six states over time, with the target's."""
        return campaign.campaign_states(self._own(mission), self._beside(others))

    def tracking_errors(self, mission: Mission, **others: Flights) -> Figure:
        """States less those of the reference."""
        return campaign.campaign_tracking_errors(self._own(mission), self._beside(others))

    def ground_track(self, mission: Mission, **others: Flights) -> Figure:
        """Ground tracks on a map, with a window on the target."""
        return campaign.campaign_ground_tracks(self._own(mission), self._beside(others))

    def end_map(self, mission: Mission, **others: Flights) -> Figure:
        """End points on a map around the target, with their ellipses."""
        return end_map(self._own(mission), self._beside(others))

    def sensitivity(self, mission: Mission) -> Figure:
        """Rank correlations of the miss with all that differed from flight to flight."""
        return sensitivity(self._own(mission), self._beside({}))

    def _beside(self, others: dict[str, Flights]) -> dict[str, Flights]:
        """This campaign by its reference, and those that were named."""
        for name, other in others.items():
            if not isinstance(other, Flights):
                raise TypeError(f"{name}: expected Flights, from ampi.fly, got {other!r:.60}")
        return {reference_words(self.flights): self.flights, **others}

    def _own(self, mission: Mission) -> Mission:
        if not isinstance(mission, Mission) or mission.digest != self.flights.mission_sha256:
            raise ValueError(
                f"mission: expected the one that was flown, {self.flights.mission} with SHA-256 "
                f"{self.flights.mission_sha256[:12]}, got {getattr(mission, 'name', mission)!r:.60}"
            )
        return mission
