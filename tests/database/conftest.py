"""The nine-case database and its mission: speed × flight-path angle."""

from __future__ import annotations

from pathlib import Path

import pytest

from ampi.missions.mission import Mission
from tests.support import databases, missions


@pytest.fixture(scope="session")
def small_mission() -> Mission:
    return missions.small_mission()


@pytest.fixture(scope="session")
def small_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return databases.small_database(tmp_path_factory)
