"""The numbers of a mission, or of a family: then those that its members differ in are arrays, (c,)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import FlightModel


@dataclass(frozen=True)
class ProblemNumbers:
    """Read alike from one mission and from a family. What is absent (None) is absent for all."""

    mission: Mission  # what the members have in common
    family: MissionFamily | None
    model: FlightModel
    limits: PathLimits

    @classmethod
    def of(cls, source: Mission | MissionFamily) -> ProblemNumbers:
        """From either."""
        if isinstance(source, Mission):
            return cls(source, None, source.flight_model, PathLimits.of(source))
        return cls(source.mission, source, source.flight_model(), source.path_limits())

    def section(self, name: str) -> Callable[[str], Any]:
        """The numbers of one section by their names (SI, rad)."""

        def number(field: str) -> Any:
            value = getattr(getattr(self.mission, name), field)
            if self.family is None or value is None:
                return value
            if isinstance(value, tuple):  # a range: both its ends
                ends = range(len(value))
                return tuple(self.family.numbers((name, field, str(end))) for end in ends)
            return self.family.numbers((name, field))

        return number

    def share(self, limit: str) -> Any:
        """What an optimum may use of a limit (`PathLimits.names`): 1 − its margin."""
        if limit.startswith("angle_of_attack"):
            return self.mission.limits.share(limit)
        return 1.0 - self.section("limits")(f"{limit.partition(' ')[0]}_margin")

    def designed(self, limit: str) -> Any:
        """A limit less its margin (SI, rad)."""
        return self.section("limits")(limit) * self.share(limit)
