"""The write side of the HDF5 schema (ampi.dataset): blocks made anywhere (`encoded_block`), one file."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from ampi.dataset import (
    DIGEST,
    FIELDS,
    SENSITIVITY_FIELDS,
    STEERED_FIELDS,
    DatasetError,
    Field,
    content_digest,
    described,
    seal,
)
from ampi.hdf5.file_sink import FileSink
from ampi.hdf5.seal import SEAL_BYTES, opened
from ampi.trajectory import Status

Array = NDArray[np.float64]
Slices = tuple[slice, ...]


class Chunk(NamedTuple):
    """One field of a block, as it lies in a file."""

    mask: int  # which filters were left out
    raw: bytes | memoryview  # what the others made of the values
    digest: bytes  # of the values (`ampi.dataset.chunk_digest`)


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
    is read back must be what was written; the digest of the chunks' values was made with them.
    """
    path = path.resolve()  # a link stays one, and the file is written where it leads
    temporary, form = path.with_name(path.name + ".tmp"), described(attributes)
    try:
        with FileSink(temporary, "w+") as sink:
            try:
                with h5py.File(sink, "w", track_order=False, userblock_size=SEAL_BYTES) as file:
                    file.attrs.update(attributes)
                    _write_scales(file, names, axes, axis_units, scales)
                    for name, field in form.items():
                        _create_field(file, name, field, names, block_shape)
                    for name, value in values.items():
                        file[name][...] = value
                    fields = {name: file[name].id for name in form}
                    digests = {name: hashlib.sha256() for name in form if name not in values}
                    for slices, chunks in blocks:
                        _write_chunks(fields, slices, chunks)
                        sink.check()
                        _read_back(fields, slices, chunks, temporary)
                        for name, chunk in chunks.items():
                            digests[name].update(chunk.digest)
                    file["status"].attrs["meanings"] = "; ".join(
                        f"{int(s)} {s.name}: {s.sentence}" for s in Status
                    )
                    file.flush()
                    known = {name: found.digest() for name, found in digests.items()}
                    digest = file.attrs[DIGEST] = content_digest(file, known)
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
    for name, chunk in chunks.items():
        fields[name].write_direct_chunk(_place(fields[name], slices), chunk.raw, chunk.mask)


def _read_back(
    fields: Mapping[str, h5py.h5d.DatasetID],
    slices: Slices,
    chunks: Mapping[str, Chunk],
    path: Path,
) -> None:
    for name, chunk in chunks.items():
        mask, raw = fields[name].read_direct_chunk(_place(fields[name], slices))
        if (mask, raw) != (chunk.mask, chunk.raw):
            raise DatasetError(f"{path}: {name} does not read back as it was written")


def _place(field: h5py.h5d.DatasetID, slices: Slices) -> tuple[int, ...]:
    """Of a block's chunk."""
    return (*(s.start for s in slices), *(0,) * (field.rank - len(slices)))


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
        dtype=(FIELDS | SENSITIVITY_FIELDS | STEERED_FIELDS)[name].dtype,
        chunks=chunks,
        shuffle=True,
        compression="gzip",
        compression_opts=1,  # the last digits are noise: higher levels save 1 % more
        fletcher32=True,
    )
