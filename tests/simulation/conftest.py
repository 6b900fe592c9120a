"""SHEFEX-3 with a nine-case database, speed × flight-path angle, and synthetic campaigns."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.reference import Mode
from ampi.simulation.dispersions import Distribution
from ampi.simulation.flights import Flights
from tests.support.databases import small_database
from tests.support.missions import small_mission


@pytest.fixture(scope="session")
def shefex3() -> Mission:
    """As shipped: all six axes have three points."""
    return load_mission("shefex3")


@pytest.fixture(scope="session")
def mission() -> Mission:
    return small_mission()


@pytest.fixture(scope="session")
def database_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_database(tmp_path_factory)


@pytest.fixture(scope="session")
def dataset(database_file: Path) -> TrajectoryDataset:
    return read_dataset(database_file)


@pytest.fixture(scope="session")
def guidance(database_file: Path) -> Guidance:
    return load_guidance(database_file)


def synthetic_flights(n: int = 200, seed: int = 0, **changes: Any) -> Flights:
    """A campaign of random numbers; k = 4 recorded points."""
    rng = np.random.default_rng(seed)
    along, across = 20e3 * rng.standard_normal(n), 10e3 * rng.standard_normal(n)
    values: dict[str, Any] = {
        "mission": "synthetic",
        "mission_sha256": "0" * 64,
        "mode": Mode.AMPI,
        "seed": 7,
        "cycle": 0.5,
        "distribution": Distribution.NORMAL,
        "half_widths": np.ones(6),
        "centre": np.zeros(6),
        "parameters": np.random.default_rng(99).standard_normal((n, 6)),
        "clipped": rng.random(n) < 0.2,
        "hole": np.arange(n) % 7 == 0,
        "status": np.zeros(n, dtype=np.int64),
        "final_states": rng.standard_normal((n, 7)),
        "final_time": rng.uniform(500.0, 600.0, n),
        "miss": np.hypot(along, across),
        "along": along,
        "across": across,
        "altitude_error": 100.0 * rng.standard_normal(n),
        "speed_error": 1e-6 * rng.standard_normal(n),
        "times": np.arange(4.0),
        "states": rng.standard_normal((n, 7, 4)),
        "reference_states": rng.standard_normal((n, 7, 4)),
        "bank_rate": rng.standard_normal((n, 4)),
        "limits": PathLimits().names,
        "path": rng.uniform(0.0, 1.1, (n, 5, 4)),
        "peak": rng.uniform(0.5, 1.1, (n, 5)),
        "position_tolerance": 25e3,
        "altitude_tolerance": 150.0,
        "speed_tolerance": 25.0,
        "radii": np.array([3e3, 6.5e3, 13e3, 25e3]),
    }
    return Flights(**{**values, **changes})


@pytest.fixture(scope="session")
def make_flights() -> Callable[..., Flights]:
    return synthetic_flights
