"""One mission at many parameter vectors, for what works on many cases at once.

The physics is written in numpy ufuncs, so a number of the flight model may as well be an array over the
cases. `MissionFamily` makes one flight model of the family's many: where its members agree, the number;
where they differ, an array. A family that differs in its entry states alone has the plain model.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ampi.missions.path_limits import PathLimits
from ampi.missions.sections import MissionSections
from ampi.physics.equations_of_motion import FlightModel

Array = NDArray[np.float64]
AnyMission = TypeVar("AnyMission", bound=MissionSections)


@dataclass(frozen=True)
class MissionFamily(Generic[AnyMission]):
    """c missions that differ in numbers only."""

    missions: tuple[AnyMission, ...]

    @property
    def entry_states(self) -> Array:
        """(c, 6): h, θ, φ, V, γ, ψ (m, rad, m/s)."""
        return np.array([mission.entry_state for mission in self.missions]).reshape(-1, 6)

    def target(self, name: str) -> Array:
        """(c,): a number of the target (SI, rad)."""
        return np.array([getattr(mission.target, name) for mission in self.missions])

    def flight_model(self, trailing: int = 0) -> FlightModel:
        """The family's flight model; its arrays are (c,) with `trailing` axes of one point behind."""
        models = [mission.flight_model for mission in self.missions]
        joined: FlightModel = _joined(models, (len(models), *[1] * trailing))
        return joined

    def path_limits(self, trailing: int = 0) -> PathLimits:
        """The family's limits, of the same shapes."""
        limits = [PathLimits.of(mission) for mission in self.missions]
        joined: PathLimits = _joined(limits, (len(limits), *[1] * trailing))
        return joined


def _joined(values: list[Any], shape: tuple[int, ...]) -> Any:
    """`values` as one: themselves where all are alike, arrays where numbers differ."""
    first = values[0]
    if all(value is first for value in values):
        return first
    if isinstance(first, np.ndarray):  # what a model has worked out of its numbers
        return np.stack(values, axis=-1).reshape(*first.shape, *shape)
    if not isinstance(first, tuple) and all(value == first for value in values):
        return first
    if isinstance(first, float):
        return np.array(values).reshape(shape)
    if isinstance(first, tuple):
        return tuple(_joined(list(column), shape) for column in zip(*values, strict=True))
    if not is_dataclass(first):
        raise TypeError(f"expected missions that differ in numbers only, got {first!r}")
    one = copy(first)  # past __post_init__: every member has passed its checks
    for field in fields(first):
        parts = [getattr(value, field.name) for value in values]
        object.__setattr__(one, field.name, _joined(parts, shape))
    return one
