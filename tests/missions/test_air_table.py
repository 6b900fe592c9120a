"""`[atmosphere] model = "table"`: from a file or inline, to the bit, and every fault in one sentence."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ampi
from ampi.missions import Mission, MissionError, load_mission
from ampi.missions.air_table import air_table_text, parse_air_table
from ampi.missions.family import MissionFamily
from ampi.missions.loading import parse_mission
from ampi.physics.planet import great_circle_distance

SHEFEX3 = load_mission("shefex3")
MODEL = '[atmosphere]\nmodel = "us76"'
H = np.arange(0.0, 120e3 + 1.0, 2e3)
AIR = SHEFEX3.flight_model.atmosphere
COLUMNS = (H, AIR.density(H), AIR.speed_of_sound(H))
CSV = air_table_text(COLUMNS, ["US76"])
BY_FILE = '[atmosphere]\nmodel = "table"\nfile = "air.csv"'


def text_with(atmosphere: str) -> str:
    assert SHEFEX3.toml.count(MODEL) == 1
    return SHEFEX3.toml.replace(MODEL, atmosphere)


def loaded(folder: Path, csv: str = CSV, atmosphere: str = BY_FILE) -> Mission:
    (folder / "air.csv").write_text(csv, encoding="utf-8")
    (folder / "mission.toml").write_text(text_with(atmosphere), encoding="utf-8")
    return load_mission(folder / "mission.toml")


@pytest.fixture
def mission(tmp_path: Path) -> Mission:
    return loaded(tmp_path)


def test_a_mission_holds_the_numbers_of_its_file(mission: Mission) -> None:
    said = tomllib.loads(mission.toml)["atmosphere"]
    assert set(said) == {"model", "altitude_km", "density", "speed_of_sound_m_per_s"}
    assert said["altitude_km"] == (H / 1e3).tolist()
    assert said["density"] == [float(f"{rho:.6g}") for rho in COLUMNS[1]]
    again = parse_mission(mission.toml)
    assert again == mission
    assert (again.toml, again.digest) == (mission.toml, mission.digest)
    assert again.flight_model.atmosphere == mission.flight_model.atmosphere


@pytest.mark.parametrize("name", ["altitude", "density", "speed_of_sound"])
def test_the_digest_is_that_of_every_number(mission: Mission, name: str) -> None:
    seen = {mission.digest}
    column = getattr(mission.atmosphere, name)
    for place in (1, 30, len(column) - 1):
        changed = (*column[:place], np.nextafter(column[place], 1e9).item(), *column[place + 1 :])
        air = mission.atmosphere.model_copy(update={name: changed})
        moved = mission.model_copy(update={"atmosphere": air})
        assert parse_mission(moved.toml) == moved
        seen.add(moved.digest)
    assert len(seen) == 4


def test_the_density_of_a_table_may_be_dispersed(mission: Mission) -> None:
    wide = mission.with_grid({"density_factor": [-0.1, 0.0, 0.1]})
    thick = wide.with_parameters([1.1]).flight_model.atmosphere
    assert thick.density(40e3) == pytest.approx(1.1 * AIR.density(40e3), rel=0.02)
    family = wide.family(np.array([[0.9], [1.1]]))
    assert family.flight_model().atmosphere.density(40e3) == pytest.approx(
        np.array([0.9, 1.1]) * wide.flight_model.atmosphere.density(40e3)
    )
    with pytest.raises(MissionError, match=r"structure depends on \(the mesh, a table of the air"):
        mission.with_grid({"atmosphere.density.3": [0.0, 1e-3]})


def test_missions_in_different_air_are_no_family(mission: Mission) -> None:
    density = tuple(1.01 * rho for rho in mission.atmosphere.density)
    other = mission.model_copy(
        update={"atmosphere": mission.atmosphere.model_copy(update={"density": density})}
    )
    with pytest.raises(TypeError, match=r"differ in numbers only, got atmosphere\.density\.0"):
        MissionFamily.of([mission, other])


def replaced(line: int, row: str) -> str:
    lines = CSV.splitlines()
    lines[line - 1] = row
    return "\n".join(lines)


def up_to(top: float) -> str:
    h = np.linspace(0.0, top, 61)
    return air_table_text([h, AIR.density(h), AIR.speed_of_sound(h)], [])


FAULTS: dict[str, tuple[Callable[[Path], Mission], str]] = {
    "no file": (
        lambda folder: loaded(folder, atmosphere=BY_FILE.replace("air.csv", "no.csv")),
        "atmosphere.file: no.csv: No such file or directory",
    ),
    "no text": (
        lambda folder: (
            (folder / "b.csv").write_bytes(b"\xff\xfe\x00"),
            loaded(folder, atmosphere=BY_FILE.replace("air.csv", "b.csv")),
        )[1],
        "atmosphere.file: b.csv: not a text file in UTF-8",
    ),
    "no path": (
        lambda folder: loaded(folder, atmosphere=BY_FILE.replace('"air.csv"', "3")),
        "atmosphere.file: expected the path of a CSV file, got 3",
    ),
    "a missing column": (
        lambda folder: loaded(folder, CSV.replace("density_kg_per_m3", "density")),
        "atmosphere.file: air.csv: line 2: expected the columns altitude_m, density_kg_per_m3, "
        "speed_of_sound_m_per_s, got none that is density_kg_per_m3",
    ),
    "empty": (
        lambda folder: loaded(folder, ""),
        "atmosphere.file: air.csv: expected a line of columns altitude_m, density_kg_per_m3, ",
    ),
    "a word": (
        lambda folder: loaded(folder, replaced(5, "4000,thin,320")),
        "atmosphere.file: air.csv: line 5, column density_kg_per_m3: expected a number, got 'thin'",
    ),
    "a short line": (
        lambda folder: loaded(folder, replaced(5, "4000,0.8")),
        "atmosphere.file: air.csv: line 5: expected 3 cells, one for each column, got 2",
    ),
    "not a number": (
        lambda folder: loaded(folder, replaced(5, "4000,nan,320")),
        "air.csv: line 5, column density_kg_per_m3: expected a finite number, got 'nan'",
    ),
    "a negative number": (
        lambda folder: loaded(folder, replaced(5, "4000,-0.8,320")),
        "atmosphere.density: expected positive numbers, got -0.8 at 4000 m",
    ),
    "twice the same altitude": (
        lambda folder: loaded(folder, replaced(5, "2000,0.8,320")),
        "atmosphere.file: air.csv: line 5, column altitude_m: expected more than 2000, the number of "
        "the row before, got 2000",
    ),
    "below the entry": (
        lambda folder: loaded(folder, up_to(90e3)),
        "atmosphere.altitude: expected a table that reaches entry.altitude (100.1 km), got one that "
        "ends at 90 km",
    ),
    "below an entry of the grid": (
        lambda folder: loaded(folder, up_to(100.2e3)),
        "grid.altitude_m: at offset 250: atmosphere.altitude: expected a table that reaches "
        "entry.altitude (100.35 km), got one that ends at 100.2 km",
    ),
    "numbers beside the file": (
        lambda folder: loaded(folder, atmosphere=BY_FILE + "\ndensity = [1.0]"),
        "atmosphere.file: expected a file or its numbers, got density beside air.csv",
    ),
    "another model": (
        lambda folder: loaded(folder, atmosphere=BY_FILE.replace('"table"', '"us76"')),
        "atmosphere.file: expected model = \"table\" beside it, got 'us76'",
    ),
    "a text": (
        lambda _: parse_mission(text_with(BY_FILE)),
        "atmosphere.file: expected the numbers of air.csv: a text has no folder to read it from",
    ),
    "nothing": (
        lambda folder: loaded(folder, atmosphere='[atmosphere]\nmodel = "table"'),
        "atmosphere: table needs altitude_km, density (kg/m³) and speed_of_sound_m_per_s",
    ),
    "what is of another model": (
        lambda folder: loaded(folder, atmosphere=BY_FILE + "\nsurface_density = 1.2"),
        "table is complete with altitude, density, speed_of_sound; remove surface_density",
    ),
    "a table of another model": (
        lambda folder: loaded(folder, atmosphere=f"{MODEL}\ndensity = [1.0]"),
        "atmosphere: us76 is complete in itself; remove density",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_told_in_one_sentence(tmp_path: Path, fault: str) -> None:
    make, said = FAULTS[fault]
    with pytest.raises(MissionError, match=re.escape(said)) as caught:
        make(tmp_path)
    assert len(str(caught.value).splitlines()) <= 2


def test_columns_may_come_in_any_order_beside_others() -> None:
    text = (
        "\ufeff# made by hand\nsource, speed_of_sound_m_per_s, altitude_m, density_kg_per_m3\n"
        "x, 340.0, 0, 1.2\n\ny, 330.0, 2000, 1.0\n"
    )
    assert parse_air_table(text, "it") == {
        "altitude_m": [0.0, 2000.0],
        "density": [1.2, 1.0],
        "speed_of_sound_m_per_s": [340.0, 330.0],
    }


@pytest.mark.slow
def test_the_optimum_in_a_table_of_the_standard_air_is_that_in_the_standard_air(
    mission: Mission,
) -> None:
    """Metres apart where the table is the smooth US76 itself."""
    one, two = ampi.solve(SHEFEX3), ampi.solve(mission)
    assert one.status.ok
    assert two.status.ok
    assert two.final_time == pytest.approx(one.final_time, abs=0.05)
    apart = great_circle_distance(*one.states[1:3, -1], *two.states[1:3, -1], 6_378_137.0)
    assert apart < 10.0
    assert np.abs(two.states[0] - one.states[0]).max() < 60.0


@pytest.mark.slow
def test_the_shipped_mission_in_arctic_air_is_solved() -> None:
    """In air thinner by a third at 40 km, to the same target."""
    january = load_mission("shefex3_january")
    assert january.target == SHEFEX3.target
    thinner = january.flight_model.atmosphere.density(40e3) / AIR.density(40e3)
    assert thinner == pytest.approx(0.69, abs=0.01)
    assert ampi.solve(january).status.ok
