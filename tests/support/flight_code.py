"""The flight code, compiled once per run of the tests and called by ctypes."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

ROOT = Path(__file__).parents[2]
CORE = ROOT / "ampi" / "export" / "c"
PROBE = ROOT / "tests" / "export" / "probe.c"
COMPILER = (
    os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
)
WARNINGS = "all extra conversion shadow double-promotion cast-qual error"
STRICT = ["-std=c99", "-O2", "-ffp-contract=off", "-pedantic"]
STRICT += [f"-W{warning}" for warning in WARNINGS.split()]
COMMAND = np.dtype([("numbers", "f8", 3), ("steering", "i4"), ("health", "i4")])

needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="NO C COMPILER: the flight code is not tested here"
)


def compiled(folder: Path, *flags: str) -> ctypes.CDLL:
    """The core and the probe as a shared library."""
    assert COMPILER is not None
    library = folder / "libampi.so"
    sources = [*sorted(CORE.glob("ampi_*.c")), PROBE]
    command = [COMPILER, *STRICT, "-fPIC", "-shared", f"-I{CORE}", *flags]
    subprocess.run([*command, *map(str, sources), "-o", str(library), "-lm"], check=True)
    return _declared(ctypes.CDLL(str(library)))


def _declared(code: ctypes.CDLL) -> ctypes.CDLL:
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    code.probe_size.restype, code.probe_size.argtypes = size, [ctypes.c_int]
    code.probe_flown.restype, code.probe_flown.argtypes = pointer, [pointer]
    code.ampi_table_open.argtypes = [pointer, pointer, size]
    for name, count in {
        "ampi_reference_at": 3,
        "ampi_reference_high_density": 4,
        "ampi_guidance_begin": 3,
        "ampi_guidance_follow": 4,
        "probe_reference": 7,
    }.items():
        getattr(code, name).argtypes = [pointer] * count
        getattr(code, name).restype = None
    code.probe_row.argtypes, code.probe_row.restype = [pointer, pointer, size], None
    code.probe_fly.argtypes = [pointer, pointer, size, pointer, pointer, pointer, pointer]
    code.probe_fly.restype = None
    return code


@dataclass(frozen=True)
class CodeReference:
    """What the C says of parameters."""

    nodal: Array  # (r, n)
    final_time: float
    times: Array
    rows: Array  # (r, m)
    cell: tuple[int, ...]
    clipped: tuple[bool, ...]
    excess: tuple[float, ...]
    hole: bool
    health: int


class FlightCode:
    """A table opened by the C, and one flight on it."""

    def __init__(self, code: ctypes.CDLL, blob: bytes) -> None:
        self.code = code
        self.blob = ctypes.create_string_buffer(blob, len(blob))
        self.table, self._reference, self.guidance = (
            ctypes.create_string_buffer(code.probe_size(i)) for i in range(3)
        )
        self.status = int(code.ampi_table_open(self.table, self.blob, len(blob)))

    def reference(self, parameters: ArrayLike | None, shape: tuple[int, int, int]) -> CodeReference:
        """For a table of (rows, nodes, points); None is a NULL pointer."""
        self.code.ampi_reference_at(self.table, _pointer(parameters), self._reference)
        return self._told(self._reference, shape)

    def flown(self, shape: tuple[int, int, int]) -> CodeReference:
        """The reference of the flight."""
        return self._told(self.code.probe_flown(self.guidance), shape)

    def _told(self, reference: Any, shape: tuple[int, int, int]) -> CodeReference:
        r, n, m = shape
        columns, times, rows = (
            np.full(r * n + 1, np.nan),
            np.full(m, np.nan),
            np.full((r, m), np.nan),
        )
        excess, told = np.zeros(16), np.zeros(2, dtype=np.int32)
        cell, clipped = np.zeros((2, 16), dtype=np.uint32)
        self.code.probe_reference(
            self.table, reference, *map(_pointer, (columns, excess, cell, clipped, told))
        )
        self.code.ampi_reference_high_density(
            self.table, reference, times.ctypes.data, rows.ctypes.data
        )
        return CodeReference(
            nodal=columns[:-1].reshape(n, r).T,
            final_time=float(columns[-1]),
            times=times,
            rows=rows,
            cell=tuple(cell.tolist()),
            clipped=tuple(map(bool, clipped)),
            excess=tuple(excess.tolist()),
            hole=bool(told[0]),
            health=int(told[1]),
        )

    def begin(self, parameters: ArrayLike | None) -> None:
        """Begin a flight."""
        self.code.ampi_guidance_begin(self.guidance, self.table, _pointer(parameters))

    def follow(self, parameters: ArrayLike, of: FlightCode | None = None) -> None:
        """Fly the reference of other parameters; `of` another table."""
        p = np.asarray(parameters, dtype=float)
        table = self.table if of is None else of.table
        self.code.ampi_reference_at(table, p.ctypes.data, self._reference)
        self.code.ampi_guidance_follow(self.guidance, self.table, self._reference, p.ctypes.data)

    def fly(
        self, times: ArrayLike, navigation: ArrayLike | None, sensed: ArrayLike | None = None
    ) -> Any:
        """Commands (n,) of `COMMAND` for times (n,), navigation (n, 8) and sensed (n, 3)."""
        t, x, felt = (
            None if given is None else np.ascontiguousarray(given, dtype=float)
            for given in (times, navigation, sensed)
        )
        commands = np.zeros(np.size(times), dtype=COMMAND)
        pointers = map(_pointer, (t, x, felt, commands))
        self.code.probe_fly(self.guidance, self.table, len(commands), *pointers)
        return commands

    def row(self, n: int) -> Array:
        """Of the reference, where the last command looked it up."""
        row = np.zeros(n)
        self.code.probe_row(self.guidance, row.ctypes.data, n)
        return row


def _pointer(values: Any) -> Any:
    if values is None:
        return None
    array = np.ascontiguousarray(values)
    if array.dtype == object or array.dtype == np.int64:
        array = array.astype(float)
    # ctypes keeps no array alive: its buffer does
    return array.ctypes.data_as(ctypes.c_void_p)
