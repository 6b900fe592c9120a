"""The flight model of SHEFEX-3."""

from __future__ import annotations

import pytest

from ampi.missions.loading import load_mission
from ampi.onboard.flight_model import FlightModelData
from ampi.onboard_model import flight_model_of


@pytest.fixture(scope="session")
def model() -> FlightModelData:
    return flight_model_of(load_mission("shefex3"))
