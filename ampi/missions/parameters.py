"""The parameters p of a mission: which of its numbers the grid disperses, Sagliano 2016, Eqs. (5)–(9).

Any number of a mission may be a parameter. Its key is the path to it in the mission file, with its
unit where it has one: `target.longitude_deg`, `vehicle.mass_kg`, `vehicle.angle_of_attack.start`. An
entry state and the factors of density, lift and drag have short keys: `speed_m_per_s` stands for
`entry.speed_m_per_s`, `density_factor` for `atmosphere.density_factor`. A number of a list or a table
goes by its place, `vehicle.aerodynamics.lift.1`. The mesh is no parameter: one table holds one set of
nodes. So where p moves the angle-of-attack manoeuvre, its kinks leave the phase boundaries: give the
schedule a `smoothing`. Start ± 4 s on SHEFEX-3 re-integrates to 222 m without, and to 6 m with 5 s.

An axis is a list of offsets from the nominal number, in the unit of its key, that holds 0. An axis of
one point moves nothing and is no dimension of the database.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel

from ampi.missions.units import UNITS, Dimension, dimension_of, si_key, symbol
from ampi.physics.angles import on_turn_of
from ampi.physics.state import ENTRY_STATES

Array = NDArray[np.float64]
Path = tuple[str, ...]

SHORT: dict[Path, str] = {
    **{("entry", state): state for state in ENTRY_STATES},
    ("atmosphere", "density_factor"): "density_factor",
    ("vehicle", "lift_factor"): "lift_factor",
    ("vehicle", "drag_factor"): "drag_factor",
}
MOST_DIMENSIONS = 10
AIR_TABLE = tuple(("atmosphere", name) for name in ("altitude", "density", "speed_of_sound"))
NOT_PARAMETERS = (
    ("grid",),
    ("mesh",),
    ("entry", "time"),  # the nodes of the mesh depend on the time
    *AIR_TABLE,  # the curve through it is structure; density_factor moves all of it
)


@dataclass(frozen=True)
class MissionNumber:
    """One number of a mission under one of its keys."""

    key: str  # with the unit, as in a mission file
    name: str  # without
    path: Path
    unit: str  # SI; of a number without a unit in its key, what the mission file says of it
    per_unit: float  # SI per unit of the key
    nominal: float  # SI
    is_circular: bool = False  # an angle that is the same modulo a turn

    def faults(self, mission: Any) -> list[str]:
        """Why no mission file could give this number the value that it has in `mission`."""
        section, path = getattr(mission, self.path[0]), self.path[1:]
        if isinstance(section, tuple):
            section, path = section[int(path[0])], path[1:]
        found: list[str] = section.faults(path, self.key[len(self.name) + 1 :] or None)
        return found


@dataclass(frozen=True)
class Parameter:
    """A number and the values (SI, rad) at which the database holds optima."""

    number: MissionNumber
    key: str  # as written in the grid
    offsets: tuple[float, ...]  # from the nominal value, in the unit of the key

    @property
    def name(self) -> str:
        """Its name in tables: `speed`, `density_factor`, `target.longitude`."""
        return self.number.name

    @property
    def axis(self) -> Array:
        """Values (not offsets), SI and radians."""
        return np.array([o * self.number.per_unit for o in self.offsets]) + self.number.nominal

    def on_axis_turn(self, value: float) -> float:
        """`value` (SI, rad), of a circular angle outside the axis on the turn nearest to its middle."""
        if not self.number.is_circular:
            return value
        low, high = self.axis[[0, -1]]
        if low <= value <= high:
            return value
        return float(on_turn_of(value, 0.5 * (low + high)))


def mission_numbers(section: BaseModel, path: Path = ()) -> Iterator[MissionNumber]:
    """Every number below `section`, once under each unit that it may be given in."""
    for name, info in type(section).model_fields.items():
        value, here = getattr(section, name), (*path, name)
        if here in NOT_PARAMETERS:
            continue
        if isinstance(value, BaseModel):
            yield from mission_numbers(value, here)
        elif isinstance(value, tuple) and any(isinstance(item, BaseModel) for item in value):
            for i, item in enumerate(value):
                yield from mission_numbers(item, (*here, str(i)))
        else:
            dimension = dimension_of(info)
            if dimension is not None and dimension.is_range and value and value[0] == value[1]:
                value = value[0]  # one number in the mission file, and one parameter
            for place, number in _floats(value, here):
                yield from _under_each_unit(number, place, dimension)


def _floats(value: Any, path: Path) -> Iterator[tuple[Path, float]]:
    """The numbers of a field: one, or those of a list or a table."""
    if isinstance(value, float):
        yield path, value
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _floats(item, (*path, str(i)))


def _under_each_unit(
    value: float, path: Path, dimension: Dimension | None
) -> Iterator[MissionNumber]:
    short = SHORT.get(path, ".".join(path))
    if dimension is None:
        unit = "1" if short.endswith("_factor") else "as in the mission file"
        yield MissionNumber(short, short, path, unit, 1.0, value)
    else:
        for unit, factor in UNITS[dimension.name].items():
            si = symbol(si_key(dimension.name))
            yield MissionNumber(
                f"{short}_{unit}", short, path, si, factor, value, dimension.is_circular
            )


def resolve(mission: BaseModel, grid: Mapping[str, tuple[float, ...]]) -> tuple[Parameter, ...]:
    """The parameters that `grid` (key → offsets) names: entry states first, then as they stand.

    Raises
    ------
    ValueError
        Naming the key that is no number of the mission, that comes twice, or that cannot take a value
        of its axis.
    """
    known = {number.key: number for number in mission_numbers(mission)}
    long = _by_whole_path(known.values())
    found: dict[str, Parameter] = {}
    for key, offsets in grid.items():
        number = known.get(key) or long.get(key)
        if number is None and _is_structure(mission, key):
            raise ValueError(
                f"grid.{key}: expected a number that leaves the structure of the mission as it is, got "
                "one that its structure depends on (the mesh, a table of the air, the name of a model); "
                "build each by itself"
            )
        if number is None:
            near = get_close_matches(key, {**known, **long}, n=4, cutoff=0.5)
            raise ValueError(
                f"grid.{key}: expected a number of this mission with its unit in the key"
                f"{', such as ' + ', '.join(near) if near else ''}; got {key!r}"
            )
        if number.name in found:
            raise ValueError(f"grid.{key}: {number.name} has an axis already; remove one of them")
        found[number.name] = Parameter(number, key, offsets)
    entry = [found.pop(state) for state in ENTRY_STATES if state in found]
    parameters = tuple(p for p in (*entry, *found.values()) if len(p.offsets) > 1)
    if len(parameters) > MOST_DIMENSIONS:
        raise ValueError(
            f"grid: expected at most {MOST_DIMENSIONS} axes of two or more points, "
            f"got {len(parameters)}; leave some numbers at their nominal value"
        )
    return parameters


def _is_structure(mission: BaseModel, key: str) -> bool:
    """Whether `key` names a part of the mission that no parameter may move."""
    here: Any = mission
    parts = tuple(key.split("."))
    if any(parts[: len(path)] == path for path in NOT_PARAMETERS):
        return True
    for part in parts:
        if isinstance(here, tuple) and part.isdigit() and int(part) < len(here):
            here = here[int(part)]
        elif isinstance(here, BaseModel) and part in type(here).model_fields:
            here = getattr(here, part)
        else:
            return False
    return isinstance(here, str | int | BaseModel)


AnySection = TypeVar("AnySection", bound=BaseModel)


def at(section: Any, path: Path) -> Any:
    """The number at `path`; of a range of one number, that number."""
    for part in path:
        section = section[int(part)] if isinstance(section, tuple) else getattr(section, part)
    return section[0] if isinstance(section, tuple) else section


def with_numbers(section: AnySection, numbers: Iterable[tuple[Path, Any]]) -> AnySection:
    """`section` with other `numbers` (SI; floats, or arrays over cases) at their paths, unchecked.

    It shares all that stays, itself included.
    """
    below: dict[str, list[tuple[Path, Any]]] = {}
    for path, number in numbers:
        below.setdefault(path[0], []).append((path[1:], number))
    parts = {name: (getattr(section, name), given) for name, given in below.items()}
    after = {name: _moved(before, given) for name, (before, given) in parts.items()}
    update = {name: value for name, value in after.items() if value is not parts[name][0]}
    return section.model_copy(update=update) if update else section


def _moved(value: Any, numbers: list[tuple[Path, Any]]) -> Any:
    """A field with other numbers below it; itself if they are its own."""
    if isinstance(value, BaseModel):
        return with_numbers(value, numbers)
    for path, number in numbers:
        if not isinstance(value, tuple):
            value = value if isinstance(number, float) and number == value else number
        elif not path:  # a range of one number
            value = value if isinstance(number, float) and value == (number,) * 2 else (number,) * 2
        else:
            i = int(path[0])
            part = _moved(value[i], [(path[1:], number)])
            value = value if part is value[i] else (*value[:i], part, *value[i + 1 :])
    return value


def parameter_values(parameters: tuple[Parameter, ...], given: ArrayLike) -> Array:
    """`given` as one finite number per parameter, circular angles on the turn of their axis.

    Raises
    ------
    ValueError
        Naming the parameters that are wanted.
    """
    values = np.asarray(given, dtype=float)
    if values.shape != (len(parameters),) or not np.all(np.isfinite(values)):
        names = ", ".join(p.name for p in parameters)
        raise ValueError(
            f"parameters: expected {len(parameters)} finite numbers ({names}), got {values}"
        )
    return np.array(
        [p.on_axis_turn(value) for p, value in zip(parameters, values.tolist(), strict=True)]
    )


def measured_values(
    mission: BaseModel, parameters: tuple[Parameter, ...], given: Mapping[str, float]
) -> Array:
    """p (d,) with the numbers `given` by key, in the key's unit; the others are nominal.

    A circular angle may be given on any turn.

    Raises
    ------
    ValueError
        Naming a key that is no parameter, a number given twice, or a value that is not finite.
    """
    at = {parameter.name: i for i, parameter in enumerate(parameters)}
    numbers = [n for n in mission_numbers(mission) if n.name in at]
    known = {n.key: n for n in sorted(numbers, key=lambda n: at[n.name])}
    long = _by_whole_path(known.values())
    values = np.array([parameter.number.nominal for parameter in parameters])
    seen: dict[str, str] = {}
    for key, value in given.items():
        number = known.get(key) or long.get(key)
        if number is None:
            raise ValueError(
                f"{key}: expected a parameter of this mission ({', '.join(known)}); all else is "
                "nominal, in the database as in its reference"
            )
        if not np.isfinite(value):
            raise ValueError(f"{key}: expected a finite number, got {value}")
        if number.name in seen:
            raise ValueError(f"{key}: {number.name} is given already, as {seen[number.name]}")
        seen[number.name] = key
        values[at[number.name]] = value * number.per_unit
    return parameter_values(parameters, values)


def _by_whole_path(numbers: Iterable[MissionNumber]) -> dict[str, MissionNumber]:
    """Short keys may be given in full: `entry.speed_m_per_s`."""
    return {".".join(n.path) + n.key[len(n.name) :]: n for n in numbers}
