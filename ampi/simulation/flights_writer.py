"""Campaigns into one HDF5 file, a batch of flights at a time: no more than one is ever held.

The bytes depend on the batches and their order alone, not on who flew them or when: no times are kept
in the file, and what its layout needs to know of the batches is asked of their shapes beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from ampi.hdf5.file_sink import FileSink
from ampi.hdf5.seal import SEAL_BYTES
from ampi.simulation.flights_schema import (
    FIELDS,
    FLIGHT,
    LABELS,
    SCHEMA_VERSION,
    SEAL,
    TIME,
)

Arrays = Mapping[str, NDArray[Any]]
CHUNK_BYTES = 2**18  # of a chunk that holds many batches


class Batches(Protocol):
    """Flights in their order, some at a time; each time from the first.

    A batch is named arrays, each of its `FIELDS`: those of its flights, and what all batches agree in.
    The recorded times of one batch are the first of those of a longer one.
    """

    def shapes(self) -> Iterator[Mapping[str, tuple[int, ...]]]:
        """Of the arrays of each batch."""

    def __iter__(self) -> Iterator[Arrays]:
        """The arrays of each batch."""


@dataclass(frozen=True, eq=False)
class Content:
    """A campaign as it goes into a file."""

    attributes: Mapping[str, Any]  # numbers and words, by name
    fixed: Arrays  # arrays that belong to no flight
    batches: Batches


def write_flights(
    path: Path, campaigns: Mapping[str, Content], attributes: Mapping[str, Any]
) -> None:
    """Write campaigns, and what is said of all of them, to `path`: sealed, and flushed to disk.

    Raises
    ------
    ValueError
        If an array is not in the schema, or has not its dimensions.
    OSError
        If the disk refuses.
    """
    with FileSink(path, "w+") as sink:
        try:
            with h5py.File(sink, "w", track_order=False, userblock_size=SEAL_BYTES) as file:
                said = {**attributes, "schema_version": SCHEMA_VERSION}
                file.attrs.update(sorted(said.items()))
                file.attrs["campaigns"] = np.array(list(campaigns), dtype=object)
                for name, content in campaigns.items():
                    for _ in _writing(file.create_group(name), content):
                        sink.check()
        finally:
            sink.check()  # before what HDF5 says of it
    SEAL.write(path)


def _writing(group: h5py.Group, content: Content) -> Iterator[None]:
    """Write a campaign; stops after every batch."""
    group.attrs.update(sorted(content.attributes.items()))
    layout = Layout.of(content)
    layout.create(group)
    shared, first = dict[str, NDArray[Any]](), 0
    for name, values in content.fixed.items():
        _agree(shared, name, values)
    for batch in content.batches:
        count = 0
        for name, values in batch.items():
            if FLIGHT in FIELDS[name].dimensions:
                count = _put(group[name], FIELDS[name].dimensions, first, values)
            else:
                _agree(shared, name, values)
        group[FLIGHT][first : first + count] = np.arange(first, first + count)
        first += count
        yield
    for name, size in layout.sizes.items():
        if name == FLIGHT:
            continue
        labels = LABELS.get(name, np.arange(size))
        shared.setdefault(name, labels)
    for name, values in shared.items():
        group[name][...] = values


def _put(
    dataset: h5py.Dataset, dimensions: tuple[str, ...], first: int, values: NDArray[Any]
) -> int:
    """The values of a batch whose first flight has this number; how many flights these are."""
    count = values.shape[dimensions.index(FLIGHT)]
    dataset[
        tuple(
            slice(first, first + count) if dimension == FLIGHT else slice(size)
            for dimension, size in zip(dimensions, values.shape, strict=True)
        )
    ] = values
    return count


def _agree(shared: dict[str, NDArray[Any]], name: str, values: NDArray[Any]) -> None:
    """What belongs to no flight is the same in all batches, but for the length of their times."""
    known = shared.setdefault(name, values)
    common = min(len(known), len(values)) if FIELDS[name].dimensions == (TIME,) else None
    if not np.array_equal(known[:common], values[:common]):
        raise ValueError(f"flights.{name}: expected the same in all batches of a campaign")
    if len(values) > len(known):
        shared[name] = values


@dataclass
class Layout:
    """What there is to be in a group: its dimensions and arrays."""

    sizes: dict[str, int] = field(default_factory=dict)  # by dimension
    arrays: set[str] = field(default_factory=set)
    batch: int = 0  # flights of the first one

    @classmethod
    def of(cls, content: Content) -> Layout:
        """From the shapes of all its batches."""
        layout, flights = cls(), 0
        for name, values in content.fixed.items():
            layout._add(name, values.shape)
        for shapes in content.batches.shapes():
            layout.sizes.pop(FLIGHT, None)
            for name, shape in shapes.items():
                layout._add(name, shape)
            flights += layout.sizes.get(FLIGHT, 0)
            layout.batch = layout.batch or flights
        layout.sizes[FLIGHT] = flights
        layout.arrays |= layout.sizes.keys()
        return layout

    def _add(self, name: str, shape: tuple[int, ...]) -> None:
        if name not in FIELDS:
            raise ValueError(f"flights.{name}: expected an array of the schema, got one it lacks")
        dimensions = FIELDS[name].dimensions
        known = tuple(
            max(self.sizes.get(d, 0), size) if d == TIME else self.sizes.get(d, size)
            for d, size in zip(dimensions, shape, strict=False)
        )
        longest = tuple(
            k if d == TIME else s for d, s, k in zip(dimensions, shape, known, strict=False)
        )
        if len(shape) != len(dimensions) or longest != known:
            raise ValueError(
                f"flights.{name}: expected an array ({', '.join(dimensions)}) of shape {known}, "
                f"got {shape}"
            )
        self.sizes.update(zip(dimensions, known, strict=True))
        self.arrays.add(name)

    def create(self, group: h5py.Group) -> None:
        """Empty datasets in the order of the schema, scales first: the bytes depend on the order."""
        names = [name for name in FIELDS if name in self.arrays]
        for name in sorted(names, key=lambda name: FIELDS[name].dimensions != (name,)):
            described = FIELDS[name]
            shape = tuple(self.sizes[d] for d in described.dimensions)
            filters: dict[str, Any] = {}
            if math.prod(shape):  # HDF5 has no empty chunks
                filters = {"chunks": self._chunks(name), "fletcher32": True, "shuffle": True}
                filters |= {"compression": "gzip", "compression_opts": 1}
            fill = {"fillvalue": np.nan} if described.dtype == "f8" else {}
            dataset = group.create_dataset(name, shape, described.dtype, **filters, **fill)
            dataset.attrs["units"] = described.units
            dataset.attrs["long_name"] = described.long_name
            if described.dimensions == (name,):
                dataset.make_scale(name)
                continue
            for i, dimension in enumerate(described.dimensions):
                dataset.dims[i].label = dimension
                dataset.dims[i].attach_scale(group[dimension])

    def _chunks(self, name: str) -> tuple[int, ...]:
        """Whole batches: none is packed twice, and who reads one flight unpacks few others."""
        described = FIELDS[name]
        rest = math.prod(self.sizes[d] for d in described.dimensions if d != FLIGHT)
        at_once = CHUNK_BYTES // (self.batch * rest * np.dtype(described.dtype).itemsize)
        flights = min(self.sizes[FLIGHT], self.batch * max(1, at_once))
        return tuple(flights if d == FLIGHT else self.sizes[d] for d in described.dimensions)
