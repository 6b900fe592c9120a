"""What differs between two databases, and by how much.

Missions are compared field by field, what made the files attribute by attribute, grids point by point.
Optima are compared in the cases that both grids have and both files hold a solution of: node by node
on one mesh, on two meshes at their last node. Angles that are the same modulo a turn differ the short
way.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.dataset import TrajectoryDataset
from ampi.physics.angles import on_turn_of
from ampi.physics.state import (
    BANK,
    CIRCULAR_STATES,
    CONTROL_UNITS,
    STEERED_STATES,
    STEERED_UNITS,
    STEERING,
)
from ampi.trajectory import Status

Array = NDArray[np.float64]
Index = tuple[NDArray[np.intp], ...]

TEXTS = ("settings", "gain_settings")  # attributes that are JSON
OF_THE_MISSION = (  # attributes that follow from it, or from the numbers
    *("mission", "mission_toml", "title", "parameters", "mesh", "bank_rate_effort", "controls"),
    *("content_sha256", "known_sha256"),
)


@dataclass(frozen=True)
class Changed:
    """One thing that is not the same in both; None where it is absent."""

    name: str
    first: Any
    second: Any


@dataclass(frozen=True)
class RowDifference:
    """The greatest difference of one row over the common cases; NaN where there are none."""

    row: str
    unit: str  # SI
    greatest: float  # of the second less the first, with its sign
    case: dict[str, float]  # that has it: offsets by key of the first mission, in its units


@dataclass(frozen=True)
class Difference:
    """All that differs; empty where nothing does."""

    mission: tuple[Changed, ...]  # but for its grid
    made_by: tuple[Changed, ...]  # software and settings
    axes: tuple[Changed, ...]  # offsets
    cases: tuple[int, int]  # of each grid
    common: int  # cases that both grids have
    statuses: tuple[Changed, ...]  # of common cases, by their offsets
    compared: int  # cases that are solved in both
    same_mesh: bool  # whether all nodes are compared
    rows: tuple[RowDifference, ...]

    @property
    def same(self) -> bool:
        """Whether nothing differs at all."""
        moved = any(row.greatest != 0.0 for row in self.rows if self.compared)
        changed = (*self.mission, *self.made_by, *self.axes, *self.statuses)
        return not changed and not moved

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        return {**asdict(self), "same": self.same}


def difference(first: TrajectoryDataset, second: TrajectoryDataset) -> Difference:
    """Compare two databases from `read_dataset`."""
    here, there = _common(first, second)
    shape = tuple(len(index) for index in here)
    common = int(np.prod(shape)) if here else 0
    statuses, both = _statuses(first, second, here, there)
    same_mesh = first.mission.pseudospectral_mesh == second.mission.pseudospectral_mesh
    return Difference(
        mission=_changed(*map(_without_grid, (first, second))),
        made_by=_changed(_made_by(first.attributes), _made_by(second.attributes)),
        axes=_axes(first, second),
        cases=(first.status.size, second.status.size),
        common=common,
        statuses=statuses,
        compared=int(both.sum()),
        same_mesh=same_mesh,
        rows=tuple(_rows(first, second, (here, there), both, same_mesh)) if both.any() else (),
    )


def _changed(first: Mapping[str, Any], second: Mapping[str, Any]) -> tuple[Changed, ...]:
    flat = [dict(_leaves(table, "")) for table in (first, second)]
    names = dict.fromkeys((*flat[0], *flat[1]))
    found = (Changed(name, *(table.get(name) for table in flat)) for name in names)
    return tuple(one for one in found if one.first != one.second)


def _without_grid(dataset: TrajectoryDataset) -> dict[str, Any]:
    return {k: v for k, v in dataset.mission.as_written().items() if k != "grid"}


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Dotted path and value of all that is no table; lists of tables by number."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        value = {str(number): item for number, item in enumerate(value, 1)}
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, f"{path}.{key}" if path else key)
    else:
        yield path, value


def _made_by(attributes: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: json.loads(str(value)) if name in TEXTS else _plain(value)
        for name, value in attributes.items()
        if name not in OF_THE_MISSION
    }


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _axes(first: TrajectoryDataset, second: TrajectoryDataset) -> tuple[Changed, ...]:
    offsets = [{p.key: list(p.offsets) for p in one.mission.parameters} for one in (first, second)]
    return _changed(*offsets)


def _common(first: TrajectoryDataset, second: TrajectoryDataset) -> tuple[Index, Index]:
    """Indices along each axis of the points that both grids have; none where p is another."""
    if first.names != second.names:
        return (), ()
    pairs = [
        np.intersect1d(a, b, return_indices=True)[1:]
        for a, b in zip(first.axes, second.axes, strict=True)
    ]
    return tuple(a for a, _ in pairs), tuple(b for _, b in pairs)


def _statuses(
    first: TrajectoryDataset, second: TrajectoryDataset, here: Index, there: Index
) -> tuple[tuple[Changed, ...], NDArray[np.bool_]]:
    """Common cases whose statuses differ, and which common cases are solved in both."""
    if not here:
        return (), np.zeros(0, dtype=bool)
    one, two = first.status[np.ix_(*here)], second.status[np.ix_(*there)]
    found = []
    for index in np.argwhere(one != two):
        names = [Status(int(statuses[tuple(index)])).name for statuses in (one, two)]
        place = ", ".join(f"{k} {v:+g}" for k, v in _offsets(first, here, index).items())
        found.append(Changed(place, *names))
    return tuple(found), (one == int(Status.SOLVED)) & (two == int(Status.SOLVED))


def _offsets(dataset: TrajectoryDataset, common: Index, index: Any) -> dict[str, float]:
    return {
        p.key: p.offsets[int(axis[i])]
        for p, axis, i in zip(dataset.mission.parameters, common, index, strict=True)
    }


def _rows(
    first: TrajectoryDataset,
    second: TrajectoryDataset,
    common: tuple[Index, Index],
    both: NDArray[np.bool_],
    same_mesh: bool,
) -> Iterator[RowDifference]:
    """Of states, controls, final time and cost."""
    nodes = slice(None) if same_mesh else slice(-1, None)
    places = np.argwhere(both)

    def moved_by(name: str, last: tuple[slice, ...] = ()) -> Array:
        one, two = (
            getattr(dataset, name)[np.ix_(*index)][both][(..., *last)]
            for dataset, index in zip((first, second), common, strict=True)
        )
        return np.asarray(two - one)

    def row(name: str, unit: str, moved: Array) -> RowDifference:
        flat = moved.reshape(len(places), -1)
        worst = int(np.argmax(np.abs(flat)))
        case = places[worst // flat.shape[1]]
        return RowDifference(
            name, unit, float(flat.ravel()[worst]), _offsets(first, common[0], case)
        )

    n_states = min(dataset.mission.n_states for dataset in (first, second))
    states = moved_by("states", (slice(n_states), nodes))
    for state, (name, unit, moved) in enumerate(
        zip(STEERED_STATES, STEERED_UNITS, states.swapaxes(0, 1), strict=False)
    ):
        yield row(name, unit, on_turn_of(moved, 0.0) if state in CIRCULAR_STATES else moved)
    for name in STEERING[: n_states - BANK]:
        yield row(name, CONTROL_UNITS[0], moved_by(name, (nodes,)))
    yield row("final_time", "s", moved_by("final_time"))
    yield row("cost", "1", moved_by("cost"))
