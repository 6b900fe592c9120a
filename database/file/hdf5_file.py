"""The write side of the HDF5 schema (ampi.dataset): blocks made anywhere (`encoded_block`), one file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ampi.dataset import (
    DIGEST,
    FIELDS,
    SEAL_BYTES,
    DatasetError,
    Field,
    content_digest,
    opened,
    seal,
)
from ampi.trajectory import Status
from database.file.file_sink import FileSink

Array = NDArray[np.float64]
Slices = tuple[slice, ...]
Chunk = tuple[int, bytes]  # which filters were left out, and the bytes that the others made


def write_dataset(
    path: Path,
    *,
    names: tuple[str, ...],
    axes: tuple[Array, ...],
    axis_units: tuple[str, ...],
    scales: Mapping[str, NDArray[Any]],
    values: Mapping[str, NDArray[Any]],
    block_shape: tuple[int, ...],
    blocks: Iterable[tuple[Slices, Mapping[str, Chunk]]],
    attributes: Mapping[str, Any],
) -> None:
    """Write a database under another name, read it back, flush it and rename it to `path`.

    `values` are the fields that belong to no case; `blocks` gives the chunks of the others by field, a
    hyperslab of the grid at a time, always in the same order: the bytes of the file depend on it. What
    is read back gives the digest, and every chunk is held against its checksum on the way.
    """
    path = path.resolve()  # a link stays one, and the file is written where it leads
    temporary = path.with_name(path.name + ".tmp")
    try:
        with FileSink(temporary, "w+") as sink:
            try:
                with h5py.File(sink, "w", track_order=False, userblock_size=SEAL_BYTES) as file:
                    file.attrs.update(attributes)
                    _write_scales(file, names, axes, axis_units, scales)
                    for name, field in FIELDS.items():
                        _create_field(file, name, field, names, block_shape)
                    for name, value in values.items():
                        file[name][...] = value
                    fields = {name: file[name].id for name in FIELDS}
                    for slices, chunks in blocks:
                        sink.check()
                        _write_chunks(fields, slices, chunks)
                    file["status"].attrs["meanings"] = "; ".join(
                        f"{int(s)} {s.name}: {s.sentence}" for s in Status
                    )
                    file.flush()
                    digest = file.attrs[DIGEST] = content_digest(file)
            finally:
                sink.check()  # before what HDF5 says of it
        seal(temporary)
        with opened(temporary) as file:
            if file.attrs.get(DIGEST) != digest:
                raise DatasetError(f"{temporary}: the file does not read back as it was written")
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _write_chunks(
    fields: Mapping[str, h5py.h5d.DatasetID], slices: Slices, chunks: Mapping[str, Chunk]
) -> None:
    start = tuple(s.start for s in slices)
    for name, (mask, raw) in chunks.items():
        inner = (0,) * (fields[name].rank - len(start))
        fields[name].write_direct_chunk((*start, *inner), raw, mask)


def _write_scales(
    file: h5py.File,
    names: tuple[str, ...],
    axes: tuple[Array, ...],
    axis_units: tuple[str, ...],
    scales: Mapping[str, NDArray[Any]],
) -> None:
    for name, axis, unit in zip(names, axes, axis_units, strict=True):
        _write_scale(file, f"axis_{name}", axis, name, unit, f"parameter axis: {name}")
    for name, values in scales.items():
        _write_scale(file, name, values, name, "1", f"{name} labels")


def _write_scale(
    file: h5py.File, name: str, values: NDArray[Any], label: str, units: str, long_name: str
) -> None:
    scale = file.create_dataset(name, data=values, fletcher32=True, chunks=True)
    scale.make_scale(label)
    scale.attrs["units"], scale.attrs["long_name"] = units, long_name


def _create_field(
    file: h5py.File,
    name: str,
    field: Field,
    names: tuple[str, ...],
    block_shape: tuple[int, ...],
) -> None:
    parameters = tuple(f"axis_{n}" for n in names) if field.per_case else ()
    scales = (*parameters, *field.dimensions)
    shape = tuple(len(file[scale]) for scale in scales)
    chunks = (*block_shape, *shape[len(parameters) :]) if field.per_case else True
    dataset = create(file, name, shape, chunks)
    dataset.attrs["units"], dataset.attrs["long_name"] = field.units, field.long_name
    for i, scale in enumerate(scales):
        dataset.dims[i].label = scale.removeprefix("axis_")
        dataset.dims[i].attach_scale(file[scale])


def create(
    file: h5py.File, name: str, shape: tuple[int, ...], chunks: tuple[int, ...] | bool
) -> h5py.Dataset:
    """An empty field of this name."""
    return file.create_dataset(
        name,
        shape=shape,
        dtype=FIELDS[name].dtype,
        chunks=chunks,
        shuffle=True,
        compression="gzip",
        compression_opts=1,  # the last digits are noise: higher levels save 1 % more
        fletcher32=True,
    )
