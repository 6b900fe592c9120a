"""SHEFEX-3 with a nine-case database, speed × flight-path angle, and synthetic campaigns."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from pathlib import Path

import pytest

from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.simulation.flights import Flights
from tests.support.databases import small_database
from tests.support.flights import synthetic_flights
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


@pytest.fixture(scope="session")
def short(mission: Mission) -> Mission:
    """A flight of a minute: to a speed that it passes soon."""
    target = mission.target.model_copy(update={"speed": 4000.0, "altitude": 55e3})
    return mission.model_copy(update={"target": target})


@pytest.fixture(scope="session")
def short_guidance(short: Mission, guidance: Guidance) -> Guidance:
    """The table of the whole flight as if it were of the short one."""
    own = copy(guidance)
    own.mission_sha256 = short.digest
    return own


@pytest.fixture(scope="session")
def make_flights() -> Callable[..., Flights]:
    return synthetic_flights
