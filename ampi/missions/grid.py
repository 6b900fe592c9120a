"""The grid of a mission file: offsets from its nominal numbers, an axis for each parameter."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pydantic import model_validator

from ampi.missions.units import Section


class GridSection(Section):
    """Offsets from the nominal numbers, one strictly increasing axis per parameter, Eq. (9)."""

    offsets: tuple[tuple[str, tuple[float, ...]], ...] = ()  # of a key, in the unit of the key

    @model_validator(mode="before")
    @classmethod
    def _axes_increase(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        offsets = dict(leaves(data))
        for key, axis in offsets.items():
            if not isinstance(axis, list | tuple):
                raise ValueError(f"{key}: expected a list of offsets, got {axis!r}")
            for value in axis:
                if isinstance(value, bool) or not isinstance(value, int | float):
                    raise ValueError(f"{key}: expected a number, got {value!r}")
                if not abs(value) < sys.float_info.max:  # a TOML integer may be of any size
                    raise ValueError(f"{key}: expected finite offsets, got {value}")
            if len(axis) == 0 or np.any(np.diff(axis) <= 0):
                raise ValueError(f"{key}: expected strictly increasing offsets, got {list(axis)}")
            if 0 not in axis:
                raise ValueError(
                    f"{key}: expected offsets that contain 0, the nominal value, got {list(axis)}"
                )
        return {"offsets": tuple(offsets.items())}

    def as_written(self) -> dict[str, Any]:
        """Offsets by key."""
        return {key: list(axis) for key, axis in self.offsets}


def leaves(table: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted path and value of every leaf: `target.longitude_deg` quoted or not, TOML allows both."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value
