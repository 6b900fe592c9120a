"""`ampi atmosphere`: a table that a mission flies in, numbers as JSON, one sentence for a fault."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ampi.missions import load_mission
from tests.support.command_line import run

PLACE = ("--latitude", "70", "--longitude", "-30")


def test_a_mission_flies_in_what_was_written(tmp_path: Path) -> None:
    told = run("atmosphere", "--date", "2026-01-15", *PLACE, "--json", "air.csv", cwd=tmp_path)
    numbers = json.loads(told.stdout)
    assert numbers["density_over_us76"][20] == pytest.approx(0.69, abs=0.01)  # at 40 km
    text = load_mission("shefex3").toml
    table = 'model = "table"\nfile = "air.csv"'
    (tmp_path / "here.toml").write_text(text.replace('model = "us76"', table), encoding="utf-8")
    air = load_mission(tmp_path / "here.toml").flight_model.atmosphere
    for h, density, sound in zip(
        numbers["altitude_m"],
        numbers["density_kg_per_m3"],
        numbers["speed_of_sound_m_per_s"],
        strict=True,
    ):
        assert air.density(h) == pytest.approx(density, rel=0.01)
        assert air.speed_of_sound(h) == pytest.approx(sound, rel=0.005)
    again = run("atmosphere", "--date", "2026-07-15", *PLACE, "air.csv", cwd=tmp_path).stdout
    assert "40 km   +1" in again  # its own earlier result is replaced


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--date", "January", *PLACE, "a.csv"), "--date: expected a day, YYYY-MM-DD"),
        (("--date", "2026-01-15", *PLACE, "a.txt"), "a.txt: expected a name that ends in .csv"),
        (("--date", "2026-01-15", *PLACE, "--ap", "-3", "a.csv"), "ap: expected 0 to 1000, got -3"),
    ],
)
def test_a_fault_is_told_and_nothing_written(
    tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    told = run("atmosphere", *arguments, cwd=tmp_path, code=2)
    assert said in told.stderr
    assert not list(tmp_path.iterdir())
