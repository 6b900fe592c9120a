"""A block as the file will hold it: chunks ready to be copied, and what a report counts beside them.

The worker that assembles a block writes each field as one chunk of a small HDF5 file in memory,
compressed and with its checksum. The single writer copies these chunks as they are: it compresses and
decodes nothing while all workers wait, and what the worker's checksum says of a chunk holds until
somebody reads it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ampi.dataset import chunk_digest
from ampi.physics.state import BANK
from ampi.trajectory import Status
from database.file.hdf5_file import Chunk, create

LENGTH = 8  # bytes
STATIONS = 4  # nodes at which a build compares the bank angles of neighbours
COUNTED = ("status", "iterations", "position_error", "peak")
SUMMARISED = (*COUNTED, "states", "message")  # the fields that a summary is of


def stations(states: NDArray[Any]) -> NDArray[Any]:
    """Of flights (…, 7, n), the bank angles (…, s) at entry and at evenly spread nodes after it."""
    nodes = np.arange(STATIONS) * states.shape[-1] // STATIONS
    return states[..., BANK, nodes]


@dataclass(frozen=True, eq=False)
class BlockSummary:
    """What a report counts of a block's cases, each array (c, …)."""

    numbers: Mapping[str, NDArray[Any]]  # those `COUNTED`, and the bank angle at the `stations`
    unsolved: Mapping[int, tuple[Status, bytes]]  # by place in the block: status and message

    @classmethod
    def of(cls, values: Mapping[str, NDArray[Any]]) -> BlockSummary:
        """From a block's fields, each (*block's shape, …)."""
        status = values["status"].ravel()
        numbers = {name: values[name].reshape(len(status), -1) for name in COUNTED}
        numbers["bank"] = stations(values["states"]).reshape(len(status), -1)
        message = values["message"].ravel()
        places = np.flatnonzero(status != int(Status.SOLVED)).tolist()
        return cls(numbers, {k: (Status(int(status[k])), bytes(message[k])) for k in places})


@dataclass(frozen=True, eq=False)
class EncodedBlock:
    """The chunks of a block by field, and its summary."""

    chunks: Mapping[str, Chunk]
    summary: BlockSummary

    def packed(self) -> bytes:
        """The length of some JSON, that, and what it describes one after the other."""
        numbers = {n: np.ascontiguousarray(v) for n, v in self.summary.numbers.items()}
        head = {
            "chunks": {n: (c.mask, len(c.raw), c.digest.hex()) for n, c in self.chunks.items()},
            "numbers": {name: (v.dtype.str, v.shape) for name, v in numbers.items()},
            "unsolved": [(k, int(s), m.decode()) for k, (s, m) in self.summary.unsolved.items()],
        }
        text = json.dumps(head).encode()
        parts = [len(text).to_bytes(LENGTH, "little"), text, *(c.raw for c in self.chunks.values())]
        return b"".join([*parts, *(values.tobytes() for values in numbers.values())])

    @classmethod
    def unpacked(cls, raw: bytes | memoryview) -> EncodedBlock:
        """What was packed."""
        view = memoryview(raw)
        place = LENGTH + int.from_bytes(view[:LENGTH], "little")
        head, chunks, numbers = json.loads(bytes(view[LENGTH:place])), {}, {}
        for name, (mask, size, digest) in head["chunks"].items():
            chunks[name] = Chunk(mask, view[place : place + size], bytes.fromhex(digest))
            place += size
        for name, (dtype, shape) in head["numbers"].items():
            numbers[name] = np.frombuffer(raw, dtype, math.prod(shape), place).reshape(shape)
            place += numbers[name].nbytes
        unsolved = {k: (Status(s), message.encode()) for k, s, message in head["unsolved"]}
        return cls(chunks, BlockSummary(numbers, unsolved))


def encoded_block(values: Mapping[str, NDArray[Any]], block_shape: tuple[int, ...]) -> EncodedBlock:
    """The fields of a block, each (*block's shape, …), as chunks of an HDF5 file.

    `block_shape` is that of a whole block; the chunks of a smaller one at the edge are filled up.
    """
    chunks = {}
    with h5py.File("block", "w", driver="core", backing_store=False) as file:
        for name, array in values.items():
            shape = (*block_shape, *array.shape[len(block_shape) :])
            dataset = create(file, name, shape, shape)
            dataset[tuple(slice(n) for n in array.shape)] = array
            dataset.flush()
            mask, raw = dataset.id.read_direct_chunk((0,) * dataset.ndim)
            inside = dataset[tuple(slice(n) for n in array.shape)]
            chunks[name] = Chunk(mask, raw, chunk_digest(inside))
    return EncodedBlock(chunks, BlockSummary.of(values))
