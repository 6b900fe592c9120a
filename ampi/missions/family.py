"""Many missions of one structure: a mission whose numbers are arrays over its cases.

The physics is written in numpy ufuncs, so a number of a mission may as well be an array. A family is one
mission and, for some of its numbers, a column of values. Where a column holds one value throughout,
the number stays a number: a family that differs in its entry states alone has the plain flight model.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.missions.parameters import AIR_TABLE, Path, at, with_numbers
from ampi.missions.path_limits import PathLimits
from ampi.missions.sections import MissionSections
from ampi.missions.units import Section
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.state import ENTRY_STATES

Array = NDArray[np.float64]
AnyMission = TypeVar("AnyMission", bound=MissionSections)

NOT_FLOWN = ("name", "title", "grid")  # of a mission: they may differ in a family


@dataclass(frozen=True)
class MissionFamily(Generic[AnyMission]):
    """c missions: `mission` with its numbers at `paths` moved to a row of `values` (c, d; SI, rad)."""

    mission: AnyMission
    paths: tuple[Path, ...]
    values: Array

    @classmethod
    def of(cls, missions: Sequence[AnyMission]) -> MissionFamily[AnyMission]:
        """The family of these missions.

        Raises
        ------
        TypeError
            If they differ in more than numbers.
        """
        first = missions[0]
        paths = tuple(dict.fromkeys(p for other in missions for p in _differences(first, other)))
        values = np.array([[at(one, path) for path in paths] for one in missions], dtype=float)
        return cls(first, paths, values.reshape(len(missions), len(paths)))

    def __len__(self) -> int:
        return len(self.values)

    def take(self, indices: ArrayLike) -> MissionFamily[AnyMission]:
        """Those of its cases."""
        return replace(self, values=self.values[np.asarray(indices)])

    def member(self, case: int) -> AnyMission:
        """One mission, unchecked: its numbers may stem from a measurement."""
        return with_numbers(self.mission, zip(self.paths, self.values[case].tolist(), strict=True))

    def checked(self) -> Self:
        """This family, if a mission file can say every section of its members (`Mission.checked`).

        What is allowed of a number is an interval: its least and greatest value tell of all.
        """
        if len(self):
            for row in (self.values.min(axis=0), self.values.max(axis=0)):
                numbers = zip(self.paths, row.tolist(), strict=True)
                with_numbers(self.mission, numbers).checked(whole=False)
        return self

    def numbers(self, path: Path, trailing: int = 0) -> Any:
        """A number of the mission: itself, or where the cases differ (c,) with `trailing` axes of 1."""
        return at(self._over_cases(trailing), path)

    @property
    def entry_states(self) -> Array:
        """(c, 6): h, θ, φ, V, γ, ψ (m, rad, m/s)."""
        states = [self.numbers(("entry", name)) for name in ENTRY_STATES]
        return np.stack([np.broadcast_to(state, len(self)) for state in states], axis=1)

    def target(self, name: str) -> Array:
        """(c,): a number of the target (SI, rad)."""
        return np.full(len(self), self.numbers(("target", name)))

    def flight_model(self, trailing: int = 0) -> FlightModel:
        """The family's flight model; its arrays are (c,) with `trailing` axes of one point behind."""
        return self._over_cases(trailing).flight_model

    def path_limits(self, trailing: int = 0) -> PathLimits:
        """The family's limits, of the same shapes."""
        return PathLimits.of(self._over_cases(trailing))

    def _over_cases(self, trailing: int) -> AnyMission:
        """The mission with its numbers as arrays, made once."""
        made: dict[int, AnyMission] = self.__dict__.setdefault("_made", {})
        if trailing not in made:
            made[trailing] = self._with_arrays(trailing)
        return made[trailing]

    def _with_arrays(self, trailing: int) -> AnyMission:
        shape = (len(self), *[1] * trailing)
        columns: list[Any] = [
            float(column[0]) if _is_one_number(column) else column.reshape(shape)
            for column in self.values.T
        ]
        return with_numbers(self.mission, zip(self.paths, columns, strict=True))


def _is_one_number(column: Array) -> bool:
    """Whether a number may stand for its column: zero may not, for a term that is zero is left out.

    Then the expressions of a case, and its last bits, would depend on its company.
    """
    return len(column) > 0 and column[0] != 0.0 and bool(np.all(column == column[0]))


def _differences(one: Any, other: Any, path: Path = ()) -> Iterator[Path]:
    """Paths of the numbers in which `other` is not `one`."""
    if one is other:
        return
    if isinstance(one, Section) and type(one) is type(other):
        for name in type(one).model_fields:
            if path or name not in NOT_FLOWN:
                yield from _differences(getattr(one, name), getattr(other, name), (*path, name))
    elif isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        for i, pair in enumerate(zip(one, other, strict=True)):
            yield from _differences(*pair, (*path, str(i)))
    elif isinstance(one, float) and isinstance(other, float) and path[:2] not in AIR_TABLE:
        if one != other:
            yield path
    elif one != other:
        raise TypeError(
            f"missions: expected some that differ in numbers only, got {'.'.join(path)} = {one!r} and "
            f"{other!r}; solve them one by one"
        )
