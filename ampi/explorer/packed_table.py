"""A table small enough for a page: whole numbers, differences along every axis, deflated.

Each row of the table has a step, 4e-7 of its range over all optima and nodes; a value is the nearest
whole number of steps,

    v = v_least + q k,   |error| ≤ q / 2,                                                           (1)

so that every order of interpolation, whose weights sum to less than 4 in size, stays within 1e-6 of the
range. Optima are smooth in p: the mixed differences of k along all axes are small, exact in whole
numbers, and summed again by the page. Their bytes are stored plane by plane, the lowest first.

Source: own; the predictor is that of Ibarria et al. 2003 (Lorenzo predictor), for d axes.
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]

STEP = 4e-7  # of a row's range
PLANES = 4  # bytes of a difference


@dataclass(frozen=True, eq=False)
class PackedTable:
    """What the page unpacks."""

    shape: tuple[
        int, ...
    ]  # points of the axes, then columns: node by node all rows; the final time
    least: Array  # (rows + 1,), of each row; then of the final time
    step: Array  # (rows + 1,)
    planes: bytes  # deflated

    @classmethod
    def of(cls, table: GuidanceTable) -> PackedTable:
        """Of all optima of a table."""
        grid, (rows, nodes) = table.final_time.shape, table.values.shape[-2:]
        axes = tuple(i for i in range(table.values.ndim) if i != table.values.ndim - 2)
        least = np.append(table.values.min(axis=axes), table.final_time.min())
        most = np.append(table.values.max(axis=axes), table.final_time.max())
        step = np.where(most > least, STEP * (most - least), 1.0)
        nodal = np.swapaxes(table.values, -1, -2).reshape(*grid, rows * nodes)
        columns = np.concatenate([nodal, table.final_time[..., None]], axis=-1)
        of_column = np.append(np.tile(np.arange(rows), nodes), rows)
        steps = np.rint((columns - least[of_column]) / step[of_column]).astype(np.int64)
        return cls(steps.shape, least, step, zlib.compress(_planes(steps), 9, -15))

    def as_json(self) -> dict[str, Any]:
        """For the page."""
        return {
            "shape": list(self.shape),
            "least": self.least.tolist(),
            "step": self.step.tolist(),
            "planes": text_of(self.planes),
        }


def _planes(steps: NDArray[np.int64]) -> bytes:
    for axis in range(steps.ndim - 1):
        steps = np.diff(steps, axis=axis, prepend=0)
    zigzag = ((steps << 1) ^ (steps >> 63)).reshape(-1)
    if prod(zigzag.shape) and int(zigzag.max()) >= 1 << (8 * PLANES):
        raise ValueError("table: expected optima that are smooth in the parameters, got a jump")
    return b"".join(((zigzag >> (8 * k)) & 255).astype("u1").tobytes() for k in range(PLANES))


def deflated(content: bytes) -> str:
    """Bytes as the page inflates them."""
    return text_of(zlib.compress(content, 9, -15))


def text_of(content: bytes) -> str:
    """Bytes as text."""
    return base64.b64encode(content).decode()
