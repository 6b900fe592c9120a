"""A synthetic guidance (random table), and one from a nine-case database of SHEFEX-3."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import LINEAR_TRACKING
from ampi.onboard.segments import Segments
from ampi.onboard.table import GuidanceTable
from ampi.tracking.bank_limiter import BankLimits
from tests.support.databases import small_database
from tests.support.missions import small_mission

Array = NDArray[np.float64]

SIZES = np.array([5e4, 1.0, 1.0, 3e3, 0.2, 2.0, 0.5])  # of the states


@pytest.fixture(scope="session")
def mission() -> Mission:
    return small_mission()


@pytest.fixture(scope="session")
def database_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_database(tmp_path_factory)


@pytest.fixture(scope="session")
def loaded(database_file: Path) -> Guidance:
    return load_guidance(database_file)


@pytest.fixture(scope="session")
def synthetic() -> Guidance:
    """Two and three points on six axes over [−1, 1]; five nodes, 41 points, about 100 s."""
    rng = np.random.default_rng(11)
    axes = tuple(np.linspace(-1.0, 1.0, n) for n in (3, 2, 3, 2, 3, 3))
    shape = tuple(len(axis) for axis in axes)
    values = rng.standard_normal((*shape, len(LINEAR_TRACKING), 5))
    values[..., LINEAR_TRACKING.states, :] *= SIZES[:, None]
    values[..., LINEAR_TRACKING.bank_rate, :] *= 0.02
    values[..., LINEAR_TRACKING.gains, :] *= 0.01 / SIZES[:, None]
    nodes, points = np.linspace(-1.0, 1.0, 5), np.linspace(-1.0, 1.0, 41)
    conversion = np.ones((5, 41))
    for i in range(5):
        for k in set(range(5)) - {i}:
            conversion[i] *= (points - nodes[k]) / (nodes[i] - nodes[k])
    table = GuidanceTable(
        axes=axes,
        values=values,
        final_time=rng.uniform(95.0, 105.0, shape),
        segments=Segments.of([nodes], [(0.0, 0.0)], [(0.0, 0.5)]),
        conversion=conversion,
        high_density_time=(np.zeros(41), np.linspace(0.0, 1.0, 41)),
        centre=(1, 0, 1, 1, 1, 1),
    )
    return Guidance(table, BankLimits(1.0, 0.1, 0.07), cycle=0.5)
