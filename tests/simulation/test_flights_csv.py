"""Flights as CSV: every number of every flight, in the units of the header."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.simulation.estimates.failures import FailureClass
from ampi.simulation.flights import Flights
from ampi.simulation.flights_csv import ENDS, write_flights_csv
from ampi.simulation.plant import FlightStatus
from ampi.simulation.uncertainties import BY_NAME

FlightMaker = Callable[..., Flights]


def test_each_flight_of_each_campaign_is_a_row(
    shefex3: Mission, make_flights: FlightMaker, tmp_path: Path
) -> None:
    sha256 = shefex3.digest
    status = np.array([0, 1, 0, 0])
    miss = np.array([10.0, np.nan, 30e3, 40.0])
    common = {"status": status, "miss": miss, "mission_sha256": sha256}
    numbers = make_flights(4).numbers.copy()
    lift, angle = (list(BY_NAME).index(name) for name in ("lift_factor", "angle_of_attack_error"))
    numbers[:, lift], numbers[2, angle] = [1.1, 0.9, 1.0, 1.05], 0.01
    worlds = {Mode.AMPI: {"numbers": numbers, "world": "lift"}, Mode.MPI: {}}
    campaigns = {
        mode.value: make_flights(4, mode=mode, **common, **changes)
        for mode, changes in worlds.items()
    }
    path = tmp_path / "flights.csv"
    write_flights_csv(path, shefex3, campaigns)
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["campaign"], row["flight"]) for row in rows] == [
        (name, str(i)) for name in campaigns for i in range(4)
    ]
    varied = {"lift_factor": lift, "angle_of_attack_error_rad": angle}
    assert [c for c in rows[0] if c.startswith(tuple(BY_NAME))] == [*varied]  # and no other
    for name, flights in campaigns.items():
        own = [row for row in rows if row["campaign"] == name]
        for i, row in enumerate(own):
            assert float(row["azimuth_deg"]) == pytest.approx(np.degrees(flights.parameters[i, 5]))
            assert float(row["altitude_m"]) == pytest.approx(flights.parameters[i, 0])
            assert (row["law"], row["reference"]) == (flights.law, name)
            assert row["world"] == flights.world
            assert row["failure"] == FailureClass(flights.failures[i]).name
            for column, place in varied.items():
                assert float(row[column]) == pytest.approx(flights.numbers[i, place])
            for column, own_name in ENDS.items():
                value = getattr(flights, own_name)[i]
                assert float(row[column]) == pytest.approx(value, nan_ok=True)
            assert float(row["miss_m"]) == pytest.approx(flights.miss[i], nan_ok=True)
            assert float(row["peak_load_factor_over_limit"]) == pytest.approx(flights.peak[i, 2])
            assert row["status"] == FlightStatus(flights.status[i]).name
            assert row["passed"] == ("yes" if flights.passed[i] else "no")
            assert (row["failed_by"] == "") == flights.passed[i]
            assert row["in_a_hole"] == ("yes" if flights.hole[i] else "no")
            assert row["outside_hypercube"] == ("yes" if flights.clipped[i] else "no")
        assert own[1]["failed_by"].split(";")[:2] == ["target_speed_not_reached", "position"]
        assert "position" in own[2]["failed_by"].split(";")


def test_flights_of_another_mission_are_refused(
    shefex3: Mission, make_flights: FlightMaker, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match="expected flights of shefex3, got ampi of synthetic"):
        write_flights_csv(tmp_path / "a.csv", shefex3, {"ampi": make_flights(3)})
    assert not list(tmp_path.iterdir())
