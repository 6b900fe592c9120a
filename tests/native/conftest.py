"""SHEFEX-3, its nine-case database and the three laws; without the engine these tests are skipped."""

from __future__ import annotations

from pathlib import Path

import pytest

from ampi._native import engine
from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions.mission import Mission
from tests.support.databases import small_database
from tests.support.missions import small_mission

LAWS = ("linear_quadratic", "drag_sliding_mode", "drag_shuttle")


@pytest.fixture(autouse=True)
def _engine() -> None:
    if not engine.is_available():
        pytest.skip(engine.WHY_NOT)


@pytest.fixture(scope="session")
def mission() -> Mission:
    return small_mission()


@pytest.fixture(scope="session")
def guidances(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Guidance]:
    """By law; the nominal cycle is half a second."""
    database: Path = small_database(tmp_path_factory)
    return {law: load_guidance(database, law=law, cycle=0.5) for law in LAWS}


@pytest.fixture(scope="session")
def guidance(guidances: dict[str, Guidance]) -> Guidance:
    """The linear-quadratic law."""
    return guidances["linear_quadratic"]


@pytest.fixture(scope="session")
def short(mission: Mission) -> Mission:
    """A flight of a minute: to a speed that it passes soon."""
    target = mission.target.model_copy(update={"speed": 4300.0, "altitude": 55e3})
    return mission.model_copy(update={"target": target})
