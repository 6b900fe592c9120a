"""Campaigns in one HDF5 file (`flights_schema`): whole, or not read."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ampi.dataset import partial_folder
from ampi.hdf5.seal import opened
from ampi.outputs import written
from ampi.simulation.flights import Flights
from ampi.simulation.flights_schema import (
    ATTRIBUTES,
    FIELDS,
    FLIGHT,
    SCALES,
    SCHEMA_VERSION,
    SEAL,
)
from ampi.simulation.flights_writer import Arrays, Content, write_flights
from ampi.simulation.stored_history import StoredHistory

AT_ONCE = 100  # flights that are written together
UNREADABLE = (OSError, KeyError, RuntimeError, TypeError, ValueError, zlib.error)


def save_campaigns(path: str | Path, campaigns: Mapping[str, Flights]) -> None:
    """Write campaigns of one mission (name → flights) to an HDF5 file, at once.

    Raises
    ------
    ValueError
        If they are of two missions, or a name could not be that of a group.
    OSError
        If the disk refuses.
    """
    _require_one_mission(campaigns)
    contents = {name: content_of(flights) for name, flights in campaigns.items()}
    for name in contents:
        require_name(name)
    with written(path) as temporary:
        write_flights(temporary, contents, {})


def load_campaigns(path: str | Path) -> dict[str, Flights]:
    """Read what `save_campaigns` or a campaign wrote.

    Histories stay on the disk until they are looked at: such an array has a shape and a type, and gives
    what is asked of it, `flights.states[3]` or `flights.states[()]`.

    Raises
    ------
    ValueError
        If the file is not whole, or its content is not what was written.
    OSError
        If there is none.
    """
    path = Path(path)
    if not path.exists() and partial_folder(path).is_dir():
        raise ValueError(
            f"{path}: the campaign is not finished (its flights are in {partial_folder(path)}); fly "
            "the same campaign again to complete it"
        )
    try:
        if not (SEAL.is_on(path) and SEAL.holds(path)):  # before HDF5 sees it
            raise ValueError("its content is not what was written")
        with opened(path) as file:
            if (version := file.attrs["schema_version"]) != SCHEMA_VERSION:
                raise ValueError(f"its schema is version {version}, not {SCHEMA_VERSION}")
            campaigns = {str(name): _flights(path, file[name]) for name in file.attrs["campaigns"]}
        _require_one_mission(campaigns)
    except (FileNotFoundError, IsADirectoryError, PermissionError):
        raise
    except UNREADABLE as error:
        raise ValueError(
            f"{path}: not a whole file of flights ({error}); make one with: ampi fly --output"
        ) from None
    return campaigns


def content_of(flights: Flights) -> Content:
    """A campaign in memory as it goes into a file."""
    attributes, fixed, of_flights = dict[str, Any](), dict[str, Any](), dict[str, Any]()
    for name, value in vars(flights).items():
        if name in ATTRIBUTES:
            attributes[name] = value.value if isinstance(value, Enum) else value
            continue
        described = FIELDS[SCALES.get(name, name)]
        array = np.array(value, described.dtype) if isinstance(value, tuple) else value
        chosen = of_flights if FLIGHT in described.dimensions else fixed
        chosen[SCALES.get(name, name)] = array
    return Content(attributes, fixed, Cut(of_flights, flights.n))


@dataclass(frozen=True, eq=False)
class Cut:
    """Flights in memory, cut into batches."""

    arrays: Arrays
    n: int

    def shapes(self) -> Iterator[Mapping[str, tuple[int, ...]]]:
        """Of the arrays of each batch."""
        for batch in self:
            yield {name: values.shape for name, values in batch.items()}

    def __iter__(self) -> Iterator[Arrays]:
        for first in range(0, self.n, AT_ONCE):
            yield {
                name: values[_of_flights(name, slice(first, first + AT_ONCE))]
                for name, values in self.arrays.items()
            }


def _of_flights(name: str, chosen: slice) -> tuple[slice, ...]:
    return tuple(chosen if d == FLIGHT else slice(None) for d in FIELDS[name].dimensions)


def _flights(path: Path, group: h5py.Group) -> Flights:
    parts = dict[str, Any]()
    for one in fields(Flights):
        if one.name in ATTRIBUTES:
            parts[one.name] = ATTRIBUTES[one.name](group.attrs[one.name])
        else:
            parts[one.name] = _values(path, group, SCALES.get(one.name, one.name))
    return Flights(**parts)


def _values(path: Path, group: h5py.Group, name: str) -> Any:
    """An array, or the names that are a scale's labels."""
    dataset = group[name]
    if FIELDS[name].is_history:
        return StoredHistory.of(path, dataset)
    values: NDArray[Any] = dataset[()]
    return tuple(label.decode() for label in values) if values.dtype.kind == "S" else values


def require_name(name: str) -> None:
    """Raise ValueError unless a campaign of this name can be a group of a file, and name files."""
    if not re.fullmatch(r"\w[\w .,=+-]*", name):
        raise ValueError(
            f"campaigns: expected names of letters, digits, blanks and .,=+-, got {name!r}"
        )


def _require_one_mission(campaigns: Mapping[str, Flights]) -> None:
    if len({flights.mission_sha256 for flights in campaigns.values()}) != 1:
        missions = ", ".join(f"{name} of {f.mission}" for name, f in campaigns.items())
        raise ValueError(
            f"campaigns: expected flights of one mission, got {missions or 'none'}; keep those of "
            "another mission in another file"
        )
