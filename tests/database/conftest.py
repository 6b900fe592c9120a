"""A nine-case database, built once: speed × flight-path angle."""

from __future__ import annotations

from pathlib import Path

import pytest

import database
from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission

SMALL_GRID = """[grid]
speed_m_per_s = [-70.0, 0.0, 70.0]
flight_path_angle_deg = [-0.5, 0.0, 0.5]
"""


def small_mission_text() -> str:
    text = load_mission("shefex3").toml
    return text[: text.index("[grid]")] + SMALL_GRID


@pytest.fixture(scope="session")
def small_mission() -> Mission:
    return parse_mission(small_mission_text())


@pytest.fixture(scope="session")
def small_database(small_mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("small") / "small.h5"
    report = database.build(small_mission, path, n_jobs=2)
    assert (report.solved, report.cases, report.failures) == (9, 9, ())
    return path
