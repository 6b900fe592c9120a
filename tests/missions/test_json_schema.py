"""What editors check by: every shipped file is valid, a wrong type or an unknown name is not."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft7Validator
from typer.testing import CliRunner

from ampi.cli import app
from ampi.missions import load_mission
from ampi.missions.json_schema import mission_schema
from ampi.missions.loading import SHELF
from ampi.simulation import world_loading
from ampi.simulation.world_schema import world_schema

Change = Callable[[Any], object]
MISSION, WORLD = Draft7Validator(mission_schema()), Draft7Validator(world_schema())
SHIPPED = [(MISSION, SHELF, name) for name in SHELF.names] + [
    (WORLD, world_loading.SHELF, name) for name in world_loading.SHELF.names
]


def read(shelf: Any, name: str) -> Any:
    return tomllib.loads(shelf.read(name)[1])


@pytest.mark.parametrize(("validator", "shelf", "name"), SHIPPED, ids=[n for *_, n in SHIPPED])
def test_shipped_files_are_valid(validator: Any, shelf: Any, name: str) -> None:
    Draft7Validator.check_schema(validator.schema)
    assert [error.message for error in validator.iter_errors(read(shelf, name))] == []


def test_a_mission_that_is_written_is_valid() -> None:
    for name in SHELF.names:
        assert MISSION.is_valid(tomllib.loads(load_mission(name).toml))


WRONG: dict[str, Change] = {
    "a text for a number": lambda m: m["entry"].update(altitude_km="100"),
    "a boolean for a number": lambda m: m["vehicle"].update(mass_kg=True),
    "an unknown name": lambda m: m["limits"].update(bank_angel_deg=3.0),
    "an unknown section": lambda m: m.update(vehicel={}),
    "no unit": lambda m: m["entry"].update(altitude=100e3),
    "another dimension": lambda m: m["target"].update(altitude_deg=3.0),
    "two units": lambda m: m["entry"].update(altitude_m=100e3),
    "a missing field": lambda m: m["entry"].pop("speed_m_per_s"),
    "a missing section": lambda m: m.pop("target"),
    "out of bounds": lambda m: m["entry"].update(altitude_km=131.0),
    "another word": lambda m: m["atmosphere"].update(model="us77"),
    "a part of a table": lambda m: m["vehicle"].update(
        aerodynamics={"model": "table", "mach": [1]}
    ),
    "a scalar axis": lambda m: m["grid"].update(altitude_m=3.0),
    "half a degree": lambda m: m["mesh"]["phase"][0].update(degrees=[5, 8.5]),
    "three ends of a range": lambda m: m["target"].update(azimuth_deg=[1, 2, 3]),
}
RIGHT: dict[str, Change] = {
    "an angle": lambda m: m["target"].update(flight_path_angle_deg=-20),
    "a range": lambda m: m["target"].update(azimuth_deg=[10, 20.5]),
    "a file of the air": lambda m: m.update(atmosphere={"model": "table", "file": "a.csv"}),
    "a file of coefficients": lambda m: m["vehicle"].update(
        aerodynamics={"model": "table", "file": "a.csv"}
    ),
    "an axis by its path": lambda m: m["grid"].update({"target.longitude_deg": [-1, 0]}),
    "an axis in a table": lambda m: m["grid"].update({"target": {"longitude_deg": [-1, 0]}}),
}


def changed(change: Change, name: str = "shefex3") -> Any:
    data = copy.deepcopy(read(SHELF, name))
    change(data)
    return data


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_mission_is_not_valid(wrong: str) -> None:
    assert not MISSION.is_valid(changed(WRONG[wrong]))


@pytest.mark.parametrize("right", RIGHT)
def test_what_a_mission_may_say_is_valid(right: str) -> None:
    assert MISSION.is_valid(changed(RIGHT[right]))


WRONG_WORLDS: dict[str, Change] = {
    "an unknown uncertainty": lambda w: w["density"].update(factro=1.0),
    "a text for a law": lambda w: w["density"].update(factor="1.1"),
    "an unknown law": lambda w: w["density"].update(factor={"distribution": "gauss"}),
    "a key of another law": lambda w: w["density"].update(
        factor={"distribution": "uniform", "three_sigma": 0.1}
    ),
    "no unit": lambda w: w["wind"].update(east=3.0),
    "an unknown section": lambda w: w.update(winds={}),
    "a month": lambda w: w.update(draws={"table": "a.csv", "months": [13]}),
}


@pytest.mark.parametrize("wrong", WRONG_WORLDS)
def test_a_wrong_world_is_not_valid(wrong: str) -> None:
    data = read(world_loading.SHELF, "everything")
    WRONG_WORLDS[wrong](data)
    assert not WORLD.is_valid(data)


@pytest.mark.parametrize(("kind", "made"), [("mission", mission_schema), ("world", world_schema)])
def test_the_command_prints_or_writes_it(tmp_path: Path, kind: str, made: Any) -> None:
    result = CliRunner().invoke(app, ["schema", kind])
    assert json.loads(result.stdout) == made()
    path = tmp_path / "s.json"
    for _ in range(2):  # an earlier one of its own is replaced
        assert CliRunner().invoke(app, ["schema", kind, "--output", str(path)]).exit_code == 0
    assert json.loads(path.read_text(encoding="utf-8")) == made()
