"""Synthetic guidance tables: random nodal values on any axes, nothing solved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.loading import segments_of
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.table import GuidanceTable
from ampi.pseudospectral.mesh import Mesh, Phase

Array = NDArray[np.float64]
TableMaker = Callable[..., GuidanceTable]

MESH = Mesh((Phase((3,), 20.0), Phase((4, 3))))


def synthetic_table(
    axes: tuple[Array, ...] | None = None, centre: tuple[int, ...] | None = None, seed: int = 0
) -> GuidanceTable:
    """Random values over `axes` (default: six of three uneven points)."""
    rng = np.random.default_rng(seed)
    if axes is None:
        axes = tuple(np.cumsum(rng.uniform(0.5, 1.5, 3)) for _ in range(6))
    shape = tuple(len(axis) for axis in axes)
    fraction = np.linspace(0.0, 1.0, 31)
    fixed = np.concatenate([np.linspace(0.0, 20.0, 11)[:-1], 20.0 * (1.0 - fraction)])
    free = np.concatenate([np.zeros(10), fraction])
    rows = len(LINEAR_TRACKING)
    values = rng.standard_normal((*shape, rows, MESH.n_nodes))
    return GuidanceTable(
        axes=axes,
        values=values,
        final_time=rng.uniform(90.0, 110.0, shape),
        segments=segments_of(MESH),
        conversion=np.ascontiguousarray(MESH.conversion(fixed + free * 100.0, 100.0).T),
        high_density_time=(fixed, free),
        centre=centre or tuple(n // 2 for n in shape),
        sensitivities=rng.standard_normal((*shape, len(shape), rows * MESH.n_nodes + 1)),
    )


@pytest.fixture(scope="session")
def make_table() -> TableMaker:
    return synthetic_table


@pytest.fixture(scope="session")
def table() -> GuidanceTable:
    return synthetic_table()
