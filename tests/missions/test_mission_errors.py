"""Every class of bad input gives a MissionError: the field, what was expected, what came."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from ampi.missions import MissionError, load_mission, shipped_missions
from ampi.missions.loading import parse_mission

TEXT = (resources.files("ampi.missions") / "shefex3.toml").read_text(encoding="utf-8")

AERODYNAMICS = """model = "modified_newtonian"
normal_quadratic = 1.83
normal_linear = 0.15
axial = 0.045"""
TABLE = """model = "table"
angle_of_attack_deg = [10.0, 20.0]
mach = [5.0, 8.0]
lift = [[0.4, 0.4], [1.0, 1.0]]
drag = [[0.1, 0.1], [0.4, 0.4]]"""


def altered(*changes: tuple[str, str]) -> str:
    """The SHEFEX-3 text with each first string, which stands there once, replaced."""
    text = TEXT
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the mission"
        text = text.replace(old, new)
    return text


ZONE = """[[no_fly_zone]]
longitude_deg = {longitude}
latitude_deg = {latitude}
radius_km = 100.0
"""


FAULTS = {
    "a limit that the target alone exceeds": (
        ("dynamic_pressure_kPa = 100.0", "dynamic_pressure_kPa = 9.0"),
        "limits.dynamic_pressure: expected at least 9",
    ),
    "a guess that banks too far": (
        ("bank_angle_deg = 30.0", "bank_angle_deg = 70.0"),
        "guess.bank_angle: expected at most limits.bank_angle (60°) in size, got 70°",
    ),
    "a drag floor above the drag at the target": (
        (
            "load_factor_g = 10.0",
            "load_factor_g = 10.0\ndrag_floor_g = 9.0\ndrag_floor_speed_m_per_s = 1000.0",
        ),
        "limits.drag_floor: expected at most 0.392 g of 9.782 m/s², the drag at the target; got 9; "
        "lower the floor or change the target",
    ),
    "a zone over the target": (
        ("[grid] # [S]", ZONE.format(longitude=-45.0, latitude=66.0) + "[grid] # [S]"),
        "no_fly_zone 1: expected the target outside the zone, got it 56 km from the centre of a "
        "zone of 100 km; move the zone or the target",
    ),
    "a zone over the target from another turn": (
        ("[grid] # [S]", ZONE.format(longitude=315.0, latitude=66.0) + "[grid] # [S]"),
        "no_fly_zone 1: expected the target outside the zone, got it 56 km from the centre of a ",
    ),
    "a change of the angle of attack that takes all of it": (
        ("angle_of_attack_change_deg = 4.5", "angle_of_attack_change_deg = 17.5"),
        "limits.angle_of_attack_change: expected less than the least angle of attack scheduled "
        "(17.5°), got 17.5°",
    ),
    "a change of the angle of attack that changes nothing": (
        ("angle_of_attack_change_deg = 4.5", "angle_of_attack_change_deg = 0.0"),
        "limits.angle_of_attack_change: Input should be greater than 0 (got 0 deg)",
    ),
    "a change of the angle of attack without a rate": (
        ("angle_of_attack_rate_deg_per_s = 5.0", ""),
        "limits: angle_of_attack_change_deg and angle_of_attack_rate_deg_per_s: expected both or "
        "neither",
    ),
    "a rate of the angle of attack that is none": (
        ("angle_of_attack_rate_deg_per_s = 5.0", "angle_of_attack_rate_deg_per_s = -5.0"),
        "limits.angle_of_attack_rate: Input should be greater than 0 (got -5 deg/s)",
    ),
    "a guess that banks too far, on another turn": (
        ("bank_angle_deg = 30.0", "bank_angle_deg = 290.0"),
        "guess.bank_angle: expected at most limits.bank_angle (60°) in size, got -70°",
    ),
    "a zone over the entry": (
        ("[grid] # [S]", ZONE.format(longitude=-11.0, latitude=72.0) + "[grid] # [S]"),
        "no_fly_zone 1: expected the entry outside the zone, got it 24 km from the centre of a "
        "zone of 100 km; move the zone or the entry",
    ),
    "an absurd weight": (
        ("bank_rate_effort = 1e-5", "bank_rate_effort = 1e300"),
        "bank_rate_effort: expected 0 or a size from 1e-20 to 1e+20 (SI), got 1e+300",
    ),
    "a missing unit": (
        ("mass_kg = 500.0", "mass = 500.0"),
        "vehicle: mass: expected a mass with its unit in the key (mass_kg), got mass = 500.0",
    ),
    "a missing unit of several": (
        ("altitude_km = 100.10", "altitude = 100.10"),
        "entry: altitude: expected a length with its unit in the key "
        "(altitude_m or altitude_km), got altitude = 100.1",
    ),
    "a unit of another dimension": (
        ("altitude_km = 100.10", "altitude_deg = 100.10"),
        "entry: altitude: expected a length (altitude_m or altitude_km), got altitude_deg",
    ),
    "an unknown unit": (
        ("mass_kg = 500.0", "mass_lb = 500.0"),
        "vehicle: mass: expected a mass (mass_kg), got mass_lb",
    ),
    "a unit of a field with a longer namesake": (
        ("altitude_km = 23.50", "altitude_ft = 77000.0"),
        "target: altitude: expected a length (altitude_m or altitude_km), got altitude_ft",
    ),
    "nothing but a longer namesake": (
        ("altitude_km = 23.50", ""),
        "target: altitude: expected a length (altitude_m or altitude_km), got nothing",
    ),
    "an angle in kilometres": (
        ("longitude_deg = -11.60", "longitude_km = -11.60"),
        "entry: longitude: expected an angle (longitude_rad or longitude_deg), got longitude_km",
    ),
    "an angle without a unit": (
        ("azimuth_deg = -85.92", "azimuth = -85.92"),
        "entry: azimuth: expected an angle with its unit in the key (azimuth_rad or azimuth_deg), "
        "got azimuth = -85.92",
    ),
    "a missing angular rate": (
        ("bank_rate_deg_per_s = 5.0", ""),
        "limits: bank_rate: expected an angular rate (bank_rate_rad_per_s or "
        "bank_rate_deg_per_s), got nothing",
    ),
    "a double unit": (
        ("altitude_km = 100.10", "altitude_km = 100.10\naltitude_m = 100100.0"),
        "entry: altitude: given more than once, as altitude_m and altitude_km",
    ),
    "a missing quantity": (
        ("load_factor_g = 10.0", ""),
        "limits: load_factor: expected a load factor (load_factor_g), got nothing",
    ),
    "a missing number": (
        ("bank_rate_effort = 1e-5", ""),
        "objective: expected at least one term: bank_rate_effort, flight_time, …",
    ),
    "a missing section": (("[target]", "[goal]"), "target: Field required"),
    "an unknown field": (
        ("mass_kg = 500.0", "mass_kg = 500.0\ncolour = 3"),
        "vehicle.colour: Extra inputs are not permitted (got 3)",
    ),
    "an unknown section": (("[target]", "[goal]"), "goal: Extra inputs are not permitted"),
    "nan": (
        ("mass_kg = 500.0", "mass_kg = nan"),
        "vehicle.mass: Input should be a finite number (got nan)",
    ),
    "inf": (
        ("speed_m_per_s = 595.0", "speed_m_per_s = inf"),
        "target.speed: Input should be a finite number (got inf)",
    ),
    "a negative mass": (
        ("mass_kg = 500.0", "mass_kg = -500.0"),
        "vehicle.mass: Input should be greater than 0 (got -500 kg)",
    ),
    "a negative weight": (
        ("altitude_weight_per_m2 = 1e-4", "altitude_weight_per_m2 = -1.0"),
        "objective.altitude_weight: Input should be greater than or equal to 0 (got -1 1/m2)",
    ),
    "an entry above the atmosphere": (
        ("altitude_km = 100.10", "altitude_km = 140.0"),
        "entry.altitude: Input should be less than or equal to 130 km (got 140 km)",
    ),
    "an entry at the pole": (
        ("latitude_deg = 71.89", "latitude_deg = 180.0"),
        "entry.latitude: Input should be less than 90 deg (got 180 deg)",
    ),
    "no text where text belongs": (
        ('title = "SHEFEX-3 (surrogate vehicle)"', "title = 3"),
        "title: Input should be a valid string (got 3)",
    ),
    "text where a number belongs": (
        ("bank_rate_effort = 1e-5", 'bank_rate_effort = "small"'),
        "objective.bank_rate_effort: Input should be a valid number (got 'small')",
    ),
    "a quoted number": (
        ("bank_rate_effort = 1e-5", 'bank_rate_effort = "1e-5"'),
        "objective.bank_rate_effort: Input should be a valid number (got '1e-5')",
    ),
    "a boolean number": (
        ("bank_rate_effort = 1e-5", "bank_rate_effort = true"),
        "objective.bank_rate_effort: Input should be a valid number (got True)",
    ),
    "a quoted quantity": (
        ("altitude_km = 100.10", 'altitude_km = "100.10"'),
        "entry: altitude_km: expected a number, got '100.10'",
    ),
    "a boolean quantity": (
        ("mass_kg = 500.0", "mass_kg = true"),
        "vehicle: mass_kg: expected a number, got True",
    ),
    "a quoted end of a phase": (
        ("end_s = 58.0", 'end_s = "58.0"'),
        "mesh.phase.0: end_s: expected a number, got '58.0'",
    ),
    "a quoted offset": (
        ("altitude_m = [-250.0, 0.0, 250.0]", 'altitude_m = [-250.0, "0.0", 250.0]'),
        "grid: altitude_m: expected a number, got '0.0'",
    ),
    "a boolean offset": (
        ("altitude_m = [-250.0, 0.0, 250.0]", "altitude_m = [-250.0, false, 250.0]"),
        "grid: altitude_m: expected a number, got False",
    ),
    "a list where a quantity belongs": (
        ("altitude_km = 100.10", "altitude_km = [100.10]"),
        "entry.altitude: Input should be a valid number (got [100.1])",
    ),
    "a quoted number in a table": (
        (AERODYNAMICS, TABLE.replace("[1.0, 1.0]", '[1.0, "1.0"]')),
        "vehicle.aerodynamics.table.lift.1.1: Input should be a valid number (got '1.0')",
    ),
    "a quoted Mach number": (
        (AERODYNAMICS, TABLE.replace("[5.0, 8.0]", '["5.0", 8.0]')),
        "vehicle.aerodynamics.table.mach.0: Input should be a valid number (got '5.0')",
    ),
    "a quoted fraction": (
        ("degrees = [5, 8]", 'degrees = [5, 8]\nfractions = [0.0, "0.5", 1.0]'),
        "mesh.phase.0.fractions.1: Input should be a valid number (got '0.5')",
    ),
    "a name with a space": (
        ('name = "shefex3"', 'name = "Shefex 3"'),
        "name: String should match pattern '^[a-z0-9_]+$' (got 'Shefex 3')",
    ),
    "a grid that does not increase": (
        ("altitude_m = [-250.0, 0.0, 250.0]", "altitude_m = [0.0, -250.0, 250.0]"),
        "grid: altitude_m: expected strictly increasing offsets, got [0.0, -250.0, 250.0]",
    ),
    "a grid that stands still": (
        ("altitude_m = [-250.0, 0.0, 250.0]", "altitude_m = [0.0, 0.0]"),
        "grid: altitude_m: expected strictly increasing offsets, got [0.0, 0.0]",
    ),
    "an empty grid": (
        ("altitude_m = [-250.0, 0.0, 250.0]", "altitude_m = []"),
        "grid: altitude_m: expected strictly increasing offsets, got []",
    ),
    "a grid without the nominal": (
        ("altitude_m = [-250.0, 0.0, 250.0]", "altitude_m = [-250.0, 250.0]"),
        "grid: altitude_m: expected offsets that contain 0, the nominal value, got [-250.0, 250.0]",
    ),
    "nan in a grid": (
        ("altitude_m = [-250.0, 0.0, 250.0]", "altitude_m = [nan, 0.0]"),
        "grid: altitude_m: expected finite offsets, got nan",
    ),
    "a target faster than the entry": (
        ("speed_m_per_s = 595.0", "speed_m_per_s = 5950.0"),
        "target.speed (5950 m/s) must be below entry.speed (4712.26 m/s)",
    ),
    "a schedule that ends before it starts": (
        ("end = 88.0", "end = 38.0"),
        "angle_of_attack: end (38.0) must lie after start (58.0)",
    ),
    "a schedule in an unknown variable": (
        ('variable = "time"', 'variable = "mach"'),
        "vehicle.angle_of_attack.variable: Input should be 'time' or 'speed' (got 'mach')",
    ),
    "unknown aerodynamics": (
        ('model = "modified_newtonian"', 'model = "newton"'),
        "vehicle.aerodynamics: Input tag 'newton' found using 'model' does not match any of the "
        "expected tags: 'modified_newtonian', 'polynomial', 'table'",
    ),
    "a table that is too small": (
        (AERODYNAMICS, TABLE.replace("[[0.4, 0.4], [1.0, 1.0]]", "[[0.4, 0.4]]")),
        "aerodynamics.lift: expected 2 rows (angle_of_attack) of 2 numbers (mach), got rows of [2]",
    ),
    "a ragged table": (
        (AERODYNAMICS, TABLE.replace("[[0.1, 0.1], [0.4, 0.4]]", "[[0.1, 0.1], [0.4]]")),
        "aerodynamics.drag: expected 2 rows (angle_of_attack) of 2 numbers (mach), "
        "got rows of [2, 1]",
    ),
    "a table over falling Mach numbers": (
        (AERODYNAMICS, TABLE.replace("[5.0, 8.0]", "[8.0, 5.0]")),
        "aerodynamics.mach: expected at least two strictly increasing values, got [8.0, 5.0]",
    ),
    "a table at one angle": (
        (AERODYNAMICS, TABLE.replace("[10.0, 20.0]", "[0.0]")),
        "aerodynamics.angle_of_attack: expected at least two strictly increasing values, got [0.0]",
    ),
    "an Earth of another size": (
        ('model = "wgs84"', 'model = "wgs84"\nradius_km = 6371.0'),
        "planet: wgs84 is complete in itself; remove radius",
    ),
    "an Earth that stands still": (
        ('model = "wgs84"', 'model = "wgs84"\nrotation_rate = 0.0\nload_factor_gravity = 9.8'),
        "planet: wgs84 is complete in itself; remove load_factor_gravity, rotation_rate",
    ),
    "a standard atmosphere of another height": (
        ('model = "us76"', 'model = "us76"\nscale_height_m = 7000.0\nsurface_density = 1.2'),
        "atmosphere: us76 is complete in itself; remove scale_height, surface_density",
    ),
    "an unknown planet": (
        ('model = "wgs84"', 'model = "mars"'),
        "planet.model: Input should be 'wgs84' or 'sphere' (got 'mars')",
    ),
    "a sphere of negative size": (
        ('model = "wgs84"', 'model = "sphere"\nradius_km = -3396\nsurface_gravity = 3.71'),
        "planet.radius: Input should be greater than 0 (got -3396 km)",
    ),
    "an atmosphere that grows with altitude": (
        ('model = "us76"', 'model = "exponential"\nsurface_density = 1.2\nscale_height_km = -7'),
        "atmosphere.scale_height: Input should be greater than 0 (got -7 km)",
    ),
    "a zone as large as the planet": (
        (
            "[grid] # [S]",
            ZONE.format(longitude=135, latitude=-66).replace("100.0", "30000") + "[grid] # [S]",
        ),
        "got it 19982 km from the centre of a zone of 30000 km; move the zone or the target",
    ),
    "half a sphere": (
        ('model = "wgs84"', 'model = "sphere"\nradius_km = 6371.0'),
        "planet: a sphere needs radius_km (or radius_m) and surface_gravity (m/s²)",
    ),
    "half an exponential atmosphere": (
        ('model = "us76"', 'model = "exponential"\nsurface_density = 1.2'),
        "atmosphere: exponential needs surface_density (kg/m³) and scale_height_m",
    ),
    "a guess without a unit": (
        ("bank_angle_deg = 30.0", "bank_angle = 30.0"),
        "with its unit in the key (bank_angle_rad or bank_angle_deg), got bank_angle = 30.0",
    ),
    "a phase without segments": (
        ("end_s = 58.0\ndegrees = [", "end_s = 58.0\nfractions = [0.0]\ndegrees = []\n# ["),
        "mesh.phase.degrees: expected at least one segment of degree 1 or more, got []",
    ),
    "a segment of degree zero": (
        ("degrees = [5, 8]", "degrees = [5, 0]"),
        "mesh.phase.degrees: expected at least one segment of degree 1 or more, got [5, 0]",
    ),
    "a segment of negative degree": (
        ("degrees = [5, 8]", "degrees = [-5, 8]"),
        "mesh.phase.degrees: expected at least one segment of degree 1 or more, got [-5, 8]",
    ),
    "fractions that start late": (
        ("degrees = [5, 8]", "degrees = [5, 8]\nfractions = [0.1, 0.5, 1.0]"),
        "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.1, 0.5, 1.0)",
    ),
    "fractions that end early": (
        ("degrees = [5, 8]", "degrees = [5, 8]\nfractions = [0.0, 0.5, 0.9]"),
        "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.0, 0.5, 0.9)",
    ),
    "too few fractions": (
        ("degrees = [5, 8]", "degrees = [5, 8]\nfractions = [0.0, 1.0]"),
        "mesh.phase.fractions: expected 3 increasing numbers from 0 to 1, got (0.0, 1.0)",
    ),
    "phases out of order": (
        ("end_s = 58.0", "end_s = 98.0"),
        "mesh: phase ends must increase from zero, got [98.0, 88.0] s",
    ),
    "a free phase in the middle": (
        ("end_s = 58.0", ""),
        "mesh: every phase but the last needs an end time, the last must be free; "
        "got [None, 88.0, None]",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_field_is_named(fault: str) -> None:
    change, message = FAULTS[fault]
    with pytest.raises(MissionError, match=re.escape(message)):
        parse_mission(altered(change), "trial")


def test_every_faulty_field_is_listed_under_the_label() -> None:
    text = altered(("mass_kg = 500.0", "mass_kg = -1.0"), ("load_factor_g = 10.0", ""))
    with pytest.raises(MissionError) as caught:
        parse_mission(text, "trial.toml")
    lines = str(caught.value).splitlines()
    assert lines[0] == "trial.toml: 2 faulty field(s)"
    assert lines[1].strip().startswith("vehicle.mass:")
    assert lines[2].strip().startswith("limits: load_factor:")


def test_what_does_not_fit_together_is_listed_beside_faulty_fields() -> None:
    text = altered(
        ("mass_kg = 500.0", "mass_kg = -1.0"),
        ("speed_m_per_s = 595.0", "speed_m_per_s = 5950.0"),
        ("bank_angle_deg = 30.0", "bank_angle_deg = 70.0"),
        ("end_s = 58.0", "end_s = 98.0"),
        ("[grid] # [S]", ZONE.format(longitude=-45.0, latitude=66.0) + "[grid] # [S]"),
    )
    with pytest.raises(MissionError) as caught:
        parse_mission(text, "trial.toml")
    label, *lines = (line.strip() for line in str(caught.value).splitlines())
    assert label == "trial.toml: 5 faulty field(s)"
    openings = [
        "vehicle.mass: Input should be greater than 0",
        "mesh: phase ends must increase",
        "target.speed (5950 m/s) must be below",
        "no_fly_zone 1: expected the target outside",
        "guess.bank_angle: expected at most",
    ]
    assert [line[: len(o)] for line, o in zip(lines, openings, strict=True)] == openings


def test_every_disagreement_within_a_section_is_told() -> None:
    text = altered(
        ("load_factor_g = 10.0", "load_factor_g = 10.0\ndrag_floor_g = 0.1"),
        ("bank_angle_deg = 60.0", "bank_angle_deg = 60.0\nbank_angle_minimum_deg = 60.0"),
        ("bank_rate_effort = 1e-5", ""),
        ("speed_weight_per_m2_s2 = 1e-4", ""),
    )
    with pytest.raises(MissionError, match="4 faulty") as caught:
        parse_mission(text)
    for sentence in (
        "limits: drag_floor_g and drag_floor_speed_m_per_s: expected both or neither",
        "limits: bank_angle_minimum: expected less than bank_angle",
        "objective: expected all four target weights or none, missing speed_weight",
        "objective: expected at least one term",
    ):
        assert sentence in str(caught.value)


def test_an_unknown_axis_is_named_beside_what_does_not_fit() -> None:
    text = altered(
        ("speed_m_per_s = 595.0", "speed_m_per_s = 4713.0"),
        ("altitude_m = [-250.0, 0.0, 250.0]", "altitud_m = [-250.0, 0.0, 250.0]"),
    )
    with pytest.raises(MissionError, match=r"must be below") as caught:
        parse_mission(text)
    assert "grid.altitud_m: expected a number of this mission" in str(caught.value)


def test_what_needs_a_faulty_section_is_not_asked() -> None:
    # the limits cannot be compared with those of a vehicle without a mass, nor the guess with no limit
    text = altered(
        ("mass_kg = 500.0", "mass_kg = -1.0"),
        ("dynamic_pressure_kPa = 100.0", "dynamic_pressure_kPa = 1.0"),
    )
    with pytest.raises(MissionError, match=r"1 faulty field\(s\)\n  vehicle\.mass"):
        parse_mission(text)
    text = altered(("bank_angle_deg = 60.0", "bank_angle_deg = 600.0"), ("= 30.0", "= 70.0"))
    with pytest.raises(MissionError, match=r"1 faulty field\(s\)\n  limits\.bank_angle: .*180 deg"):
        parse_mission(text)


def test_several_limits_and_several_units_are_named_at_once() -> None:
    limits = (
        ("dynamic_pressure_kPa = 100.0", "dynamic_pressure_kPa = 1.0"),
        ("load_factor_g = 10.0", "load_factor_g = 0.1"),
    )
    with pytest.raises(MissionError) as caught:
        parse_mission(altered(*limits))
    assert "limits.dynamic_pressure: expected at least 9.02" in str(caught.value)
    assert re.search(r"limits.load_factor: .* g of 9.782 m/s², .* got 0.1;", str(caught.value))
    units = (
        ("altitude_km = 100.10", "altitude = 100.10"),
        ("azimuth_deg = -85.92", "azimuth = -85.92"),
    )
    with pytest.raises(MissionError, match="2 faulty") as caught:
        parse_mission(altered(*units))
    assert "entry: altitude: expected a length" in str(caught.value)
    assert "entry: azimuth: expected an angle" in str(caught.value)


def test_a_file_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    path, plain = tmp_path / "marked.toml", load_mission("shefex3")
    path.write_bytes(b"\xef\xbb\xbf" + plain.toml.encode())
    assert load_mission(path).toml == plain.toml
    assert parse_mission("\ufeff" + plain.toml).toml == plain.toml


def test_an_unknown_name_lists_the_known_ones() -> None:
    known = ", ".join(shipped_missions())
    assert "shefex3" in known
    message = f"mission: expected one of {known} or the path of a .toml file, got 'shefex4'"
    with pytest.raises(MissionError, match=re.escape(message)):
        load_mission("shefex4")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "nowhere.toml"
    with pytest.raises(MissionError, match=re.escape(f"mission: no file at {path}")):
        load_mission(path)
    with pytest.raises(MissionError, match=re.escape(f"mission: no file at {tmp_path}")):
        load_mission(tmp_path)


def test_invalid_toml_names_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "broken.toml"
    path.write_text('name = "x"\ntitle = \n', encoding="utf-8")
    with pytest.raises(MissionError) as caught:
        load_mission(path)
    assert str(caught.value).startswith(f"{path}: not valid TOML: ")
    assert "line 2" in str(caught.value)


def test_a_file_that_is_not_utf_8_is_named(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes('title = "Raumfähre"\n'.encode("latin-1"))
    message = f"{path}: not a text file in UTF-8"
    with pytest.raises(MissionError, match=f"^{re.escape(message)}$") as caught:
        load_mission(path)
    assert caught.value.__suppress_context__


def test_a_file_s_faults_open_with_its_path(tmp_path: Path) -> None:
    path = tmp_path / "light.toml"
    path.write_text(altered(("mass_kg = 500.0", "mass_kg = 0.0")), encoding="utf-8")
    with pytest.raises(MissionError, match=re.escape(f"{path}: 1 faulty field(s)")):
        load_mission(path)


def test_a_mission_error_is_a_value_error_without_a_chain() -> None:
    with pytest.raises(ValueError, match=r"vehicle\.mass") as caught:
        parse_mission(altered(("mass_kg = 500.0", "mass_kg = -1.0")))
    assert isinstance(caught.value, MissionError)
    assert caught.value.__suppress_context__


@pytest.mark.parametrize("state", [np.zeros(5), np.full(6, np.nan), np.zeros((6, 1))])
def test_a_bad_entry_state_is_refused(state: np.ndarray) -> None:
    with pytest.raises(ValueError, match="entry_state: expected 6 finite numbers"):
        load_mission("shefex3").with_entry(state)


def test_the_alterations_are_what_is_refused() -> None:
    assert parse_mission(altered(("mass_kg = 500.0", "mass_kg = 501.0"))).vehicle.mass == 501.0
    mission = parse_mission(altered((AERODYNAMICS, TABLE)))
    lift, drag = mission.flight_model.vehicle.aerodynamics.coefficients(np.radians(20.0), 5.0)
    assert (lift, drag) == pytest.approx((1.0, 0.4))
    cuts = altered(("degrees = [5, 8]", "degrees = [5, 8]\nfractions = [0.0, 0.3, 1.0]"))
    assert parse_mission(cuts).mesh.phase[0].fractions == (0.0, 0.3, 1.0)


def test_whole_numbers_are_numbers() -> None:
    mission = parse_mission(altered(("mass_kg = 500.0", "mass_kg = 500"), ("= 1e-5", "= 1")))
    assert mission.vehicle.mass == 500.0
    assert mission.objective.bank_rate_effort == 1.0


@pytest.mark.parametrize(("rate", "expected"), [("", 0.0), ("rotation_rate = 7e-5", 7e-5)])
def test_a_sphere_takes_the_keys_that_wgs84_refuses(rate: str, expected: float) -> None:
    sphere = f'model = "sphere"\nradius_km = 6371.0\nsurface_gravity = 9.8\n{rate}'
    planet = parse_mission(altered(('model = "wgs84"', sphere))).flight_model.planet
    assert planet.equatorial_radius == 6371e3
    assert planet.rotation_rate == expected
    assert planet.load_factor_gravity == 9.8


MARS = 'model = "sphere"\nradius_km = 3396.2\nsurface_gravity = 3.71'
CARBON_DIOXIDE = 'model = "exponential"\nsurface_density = 0.02\nscale_height_km = 11.1'


def test_air_is_that_of_its_planet() -> None:
    change = (('model = "wgs84"', MARS), ('model = "us76"', CARBON_DIOXIDE))
    for key, ratio in (("", 1.4), ("specific_heat_ratio = 1.29", 1.29)):
        text = altered(*change).replace("scale_height_km = 11.1", f"scale_height_km = 11.1\n{key}")
        air = parse_mission(text).flight_model.atmosphere
        expected = np.sqrt(ratio * 3.71 * 11.1e3)
        assert air.speed_of_sound(20e3) == pytest.approx(expected, rel=1e-12)
    with pytest.raises(
        MissionError, match="us76 is complete in itself; remove specific_heat_ratio"
    ):
        parse_mission(altered(('model = "us76"', 'model = "us76"\nspecific_heat_ratio = 1.3')))


def test_load_factors_say_their_g() -> None:
    heavy = ("load_factor_g = 10.0", "load_factor_g = 0.01")
    for key, gravity in (("", "3.71"), ("\nload_factor_gravity = 9.80665", "9.807")):
        change = (('model = "wgs84"', MARS + key), ('model = "us76"', CARBON_DIOXIDE), heavy)
        with pytest.raises(
            MissionError, match=rf"load_factor: .* g of {gravity} m/s², its value at"
        ):
            parse_mission(altered(*change))


def test_a_limit_below_the_entry_value_is_named() -> None:
    text = TEXT.replace("heat_flux_MW_per_m2 = 6.5", "heat_flux_MW_per_m2 = 0.05")
    with pytest.raises(
        MissionError, match=r"limits\.heat_flux: expected at least .* got 0\.05; raise the limit"
    ):
        parse_mission(text)
