"""What differs between two databases: told once, by how much, and in which case."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from ampi.cli import app
from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.physics.state import BANK, SPEED, STATES
from ampi.trajectory import Status
from database.difference import difference


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def dataset(small_database: Path) -> TrajectoryDataset:
    return read_dataset(small_database)


def moved(dataset: TrajectoryDataset, name: str, place: tuple[int, ...], by: Any) -> Any:
    values = getattr(dataset, name).copy()
    values[place] = values[place] + by
    return replace(dataset, **{name: values})


def test_nothing_differs_from_itself(dataset: TrajectoryDataset) -> None:
    found = difference(dataset, dataset)
    assert found.same
    assert (found.mission, found.made_by, found.axes, found.statuses) == ((), (), (), ())
    assert (found.cases, found.common, found.compared) == ((9, 9), 9, 9)
    assert [row.greatest for row in found.rows] == [0.0] * 10


def test_the_greatest_difference_is_found_with_its_case(dataset: TrajectoryDataset) -> None:
    other = moved(dataset, "states", (2, 0, SPEED, 5), -3.0)
    other = moved(other, "states", (0, 1, SPEED, 7), 2.0)
    other = moved(other, "final_time", (1, 2), 0.25)
    found = difference(dataset, other)
    assert not found.same
    rows = {row.row: row for row in found.rows}
    assert rows["speed"].greatest == pytest.approx(-3.0)
    assert rows["speed"].case == {"speed_m_per_s": 70.0, "flight_path_angle_deg": -0.5}
    assert rows["final_time"].case == {"speed_m_per_s": 0.0, "flight_path_angle_deg": 0.5}
    unmoved = {*STATES, "bank_rate", "cost"} - {"speed"}
    assert all(rows[name].greatest == 0.0 for name in unmoved)
    back = {row.row: row for row in difference(other, dataset).rows}
    assert back["speed"].greatest == pytest.approx(3.0)


def test_a_turn_is_no_difference(dataset: TrajectoryDataset) -> None:
    other = moved(dataset, "states", (0, 0, BANK, 3), 2.0 * np.pi + 1e-3)
    rows = {row.row: row.greatest for row in difference(dataset, other).rows}
    assert rows["bank_angle"] == pytest.approx(1e-3, rel=1e-6)


def test_statuses_and_holes(dataset: TrajectoryDataset) -> None:
    status = dataset.status.copy()
    status[1, 1] = int(Status.TARGET_MISSED)
    found = difference(dataset, replace(dataset, status=status))
    assert [tuple(vars(one).values()) for one in found.statuses] == [
        ("speed_m_per_s +0, flight_path_angle_deg +0", "SOLVED", "TARGET_MISSED")
    ]
    assert found.compared == 8
    assert not found.same


def test_missions_settings_and_versions_are_compared_by_name(dataset: TrajectoryDataset) -> None:
    mission = dataset.mission.model_copy(
        update={"vehicle": dataset.mission.vehicle.model_copy(update={"mass": 510.0})}
    )
    settings = json.loads(dataset.attributes["settings"])
    settings["max_iterations"] += 1
    attributes = {**dataset.attributes, "numpy_version": "9", "settings": json.dumps(settings)}
    found = difference(dataset, replace(dataset, mission=mission, attributes=attributes))
    assert [(one.name, one.first, one.second) for one in found.mission] == [
        ("vehicle.mass_kg", 500.0, 510.0)
    ]
    assert {one.name for one in found.made_by} == {"numpy_version", "settings.max_iterations"}


def test_the_command(small_database: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copy(small_database, tmp_path / "copy.h5"))
    result = run("diff", small_database, copy)
    assert (result.exit_code, "nothing differs" in result.output) == (0, True)
    cropped = tmp_path / "c.h5"
    crop = run(
        "crop", small_database, "--drop", "speed_m_per_s=4782.26", "--output", cropped, "-j", 1
    )
    assert crop.exit_code == 0
    result = run("diff", small_database, cropped)
    assert result.exit_code == 1
    assert "speed_m_per_s: [-70.0, 0.0, 70.0] → [-70.0, 0.0]" in result.output
    assert "cases: 9 and 6, 6 in both, 6 solved in both" in result.output
    assert "optima: the same to the bit" in result.output
    told = json.loads(run("diff", small_database, cropped, "--json").stdout)
    assert told["same"] is False
    assert told["axes"][0]["name"] == "speed_m_per_s"
    assert run("diff", small_database, tmp_path / "none.h5").exit_code == 2
