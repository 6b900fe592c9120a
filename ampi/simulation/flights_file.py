"""Campaigns as one compressed .npz: whole, or not read."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Mapping
from io import BytesIO
from lzma import LZMAError
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.reference import Mode
from ampi.outputs import written
from ampi.simulation.dispersions import Distribution
from ampi.simulation.flights import Flights

# what a few wrong bytes in an archive raise
DAMAGED = (BadZipFile, LZMAError, zlib.error, OSError, EOFError, RuntimeError, MemoryError)
DIGEST = "sha256"  # in a file of flights: of all else in it


def save_campaigns(path: str | Path, campaigns: Mapping[str, Flights]) -> None:
    """Write campaigns of one mission (name → flights) as one compressed .npz, at once."""
    _require_one_mission(campaigns)
    packed: dict[str, Any] = {
        f"{name}/{key}": np.asarray(value.value if isinstance(value, Mode) else value)
        for name, flights in campaigns.items()
        for key, value in vars(flights).items()
    }
    packed[DIGEST] = np.asarray(_digest(packed))
    with written(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **packed)


def load_campaigns(path: str | Path) -> dict[str, Flights]:
    """Read what `save_campaigns` wrote.

    Raises
    ------
    ValueError
        If the file is not whole, or its content is not what was written.
    """
    content = BytesIO(Path(path).read_bytes())
    try:
        with np.lib.npyio.NpzFile(content) as packed:
            arrays = {key: packed[key] for key in packed.files}
        if DIGEST not in arrays or str(arrays.pop(DIGEST)) != _digest(arrays):
            raise ValueError("its content is not what was written")
        found: dict[str, dict[str, Any]] = {}
        for key, array in arrays.items():
            name, _, part = key.partition("/")
            found.setdefault(name, {})[part] = array if array.ndim else array.item()
        campaigns = {name: Flights(**_typed(parts)) for name, parts in found.items()}
        _require_one_mission(campaigns)
    except (*DAMAGED, KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: not a whole file of flights ({error}); make one with: ampi fly --output"
        ) from None
    return campaigns


def _typed(parts: dict[str, Any]) -> dict[str, Any]:
    """Enums and names of limits as they are in memory."""
    distribution, mode = Distribution(parts["distribution"]), Mode(parts["mode"])
    return {**parts, "distribution": distribution, "mode": mode, "limits": tuple(parts["limits"])}


def _digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 of names, types, shapes and values."""
    digest = hashlib.sha256()
    for key, array in sorted(arrays.items()):
        digest.update(f"{key} {array.dtype.str} {array.shape}\0".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _require_one_mission(campaigns: Mapping[str, Flights]) -> None:
    if len({flights.mission_sha256 for flights in campaigns.values()}) != 1:
        missions = ", ".join(f"{name} of {f.mission}" for name, f in campaigns.items())
        raise ValueError(
            f"campaigns: expected flights of one mission, got {missions or 'none'}; keep those of "
            "another mission in another file"
        )
