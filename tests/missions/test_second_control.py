"""The angle of attack as a control, and final states of all kinds: what a mission may say."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft7Validator

from ampi.missions import Mission, MissionError, load_mission
from ampi.missions.explained import explained
from ampi.missions.final_states import FinalState, TargetMiss, final_states, held_states
from ampi.missions.json_schema import mission_schema
from ampi.missions.loading import parse_mission
from ampi.missions.text import toml_text
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    AZIMUTH,
    BANK,
    FLIGHT_PATH_ANGLE,
    LATITUDE,
    LONGITUDE,
    SPEED,
)
from ampi.scp.problem.scaled_problem import OptimalControlProblem

TEXT = (resources.files("ampi.missions") / "shuttle_betts2010.toml").read_text(encoding="utf-8")
SCHEDULE = {
    "variable": "speed",
    "start": 1e3,
    "end": 2e3,
    "start_angle_deg": 20.0,
    "end_angle_deg": 30.0,
}
TABLE = {
    "model": "table",
    "angle_of_attack_deg": [0.0, 40.0],
    "mach": [2.0, 25.0],
    "lift": [[0.0, 0.0], [1.0, 1.0]],
    "drag": [[0.1, 0.1], [0.9, 0.9]],
}
WEIGHTS = {
    "altitude_weight_per_km2": 1.0,
    "longitude_weight_per_deg2": 0.0,
    "latitude_weight_per_deg2": 0.0,
    "speed_weight_per_m2_s2": 1.0,
}
SPEEDS = {"over": "speed", "at": [1000.0, 4000.0]}


def changed(**sections: dict[str, Any] | None) -> str:
    """The shuttle's text with other values; None takes a value, or a section, away."""
    data: dict[str, Any] = tomllib.loads(TEXT)
    for path, values in sections.items():
        *above, name = path.split("__")
        table = data
        for part in above:
            table = table[part]
        merged = {} if values is None else table.get(name, {}) | values
        table[name] = {key: value for key, value in merged.items() if value is not None}
        if values is None:
            del table[name]
    return toml_text(data)


def mission(**sections: dict[str, Any] | None) -> Mission:
    return parse_mission(changed(**sections))


def told(**sections: dict[str, Any] | None) -> str:
    with pytest.raises(MissionError) as caught:
        mission(**sections)
    return str(caught.value)


CONTROLS = {
    "bounds that cross": (
        {"lower_deg": 30.0, "upper_deg": 10.0},
        "lower, upper: expected a lower bound below the upper one, got 30° and 10°",
    ),
    "bounds that cross over the speed": (
        {"lower_deg": [10.0, 30.0], "upper_deg": 20.0, **SPEEDS},
        "lower, upper: expected a lower bound below the upper one, got 30° and 20°",
    ),
    "a rate of zero": (
        {"rate_deg_per_s": 0.0},
        "angle_of_attack.rate: Input should be greater than 0 (got 0 deg/s)",
    ),
    "an acceleration below zero": (
        {"acceleration_deg_per_s2": -4.0},
        "angle_of_attack.acceleration: Input should be greater than 0 (got -4 deg/s2)",
    ),
    "more than half a turn": (
        {"upper_deg": 181.0},
        "angle_of_attack.upper: expected angles from -180 to 180 degrees",
    ),
    "over without at": ({"over": "mach"}, "over and at: expected both or neither"),
    "at without over": ({"at": [1.0, 2.0]}, "over and at: expected both or neither"),
    "another variable": (
        {"over": "time", "at": [1.0, 2.0]},
        "angle_of_attack.over: Input should be",
    ),
    "points that do not increase": (
        {"over": "mach", "at": [2.0, 2.0]},
        "at: expected two or more numbers that increase strictly",
    ),
    "one point": (
        {"over": "mach", "at": [2.0]},
        "at: expected two or more numbers that increase strictly",
    ),
    "more bounds than points": (
        {"lower_deg": [1.0, 2.0, 3.0], **SPEEDS},
        "lower: expected one angle, or one for each of `at` (2), got 3",
    ),
    "a list over nothing": (
        {"upper_deg": [20.0, 30.0]},
        "upper: expected one angle, or one for each of `at` (1), got 2",
    ),
}
TARGETS = {
    "a number outside its range": (
        {"altitude_range_km": [10.0, 20.0]},
        "altitude: expected a number in altitude_range, 10 km to 20 km, got 24.384 km",
    ),
    "ends that cross": (
        {"speed_range_m_per_s": [800.0, 700.0]},
        "target.speed_range: expected a number or [least, greatest]",
    ),
    "free and in a range": (
        {"free": ["altitude"], "altitude_range_km": [20.0, 30.0]},
        "altitude_range: expected none, for altitude is free; remove one of them",
    ),
    "a free position and its range": (
        {"latitude_range_deg": [20.0, 40.0]},
        "latitude_range: expected none, for latitude is free; remove one of them",
    ),
    "free twice": (
        {"free": ["speed", "speed"]},
        "free: expected each state once, got speed, speed",
    ),
    "free and unknown": (
        {"free": ["azimuth"]},
        "target.free.0: Input should be 'altitude', 'longitude', 'latitude' or 'speed'",
    ),
    "too great an angle of attack": (
        {"angle_of_attack_deg": 91.0},
        "target.angle_of_attack: expected -90° to 90°, the bounds of [angle_of_attack], got 91°",
    ),
    "too great a bank angle": (
        {"bank_angle_deg": [-95.0, 0.0]},
        "target.bank_angle: expected at most limits.bank_angle (89°) in size, got -95° to 0°",
    ),
}
TOGETHER: dict[str, tuple[dict[str, Any], str]] = {
    "a schedule and a control": (
        {"vehicle__angle_of_attack": SCHEDULE},
        "angle_of_attack: expected a schedule ([vehicle.angle_of_attack]) or a control "
        "([angle_of_attack]), got both; remove one of them",
    ),
    "neither": (
        {"angle_of_attack": None, "objective": {"angle_of_attack_effort": 0.0}},
        "vehicle.angle_of_attack: expected a schedule ([vehicle.angle_of_attack]) or a control "
        "([angle_of_attack]), got neither",
    ),
    "a table that does not cover the angles": (
        {"vehicle__aerodynamics": {"lift": None, "drag": None} | TABLE},
        "angle_of_attack: expected bounds within vehicle.aerodynamics.angle_of_attack (0° to 40°), got "
        "-90° to 90°; widen the table or narrow the bounds",
    ),
    "an entry outside the bounds": (
        {"entry": {"angle_of_attack_deg": 30.0}, "angle_of_attack": {"upper_deg": 20.0}},
        "entry.angle_of_attack: expected -90° to 20°, the bounds of [angle_of_attack], got 30°",
    ),
    "an entry that turns too fast": (
        {"entry": {"angle_of_attack_rate_deg_per_s": -6.0}},
        "entry.angle_of_attack_rate: expected at most angle_of_attack.rate (5°/s) in size, got -6°/s",
    ),
    "an effort of a schedule": (
        {"angle_of_attack": None, "vehicle__angle_of_attack": SCHEDULE},
        "objective.angle_of_attack_effort: expected 0, for the angle of attack follows a schedule; "
        "[angle_of_attack] makes it a control",
    ),
    "a final angle of a schedule": (
        {
            "angle_of_attack": None,
            "vehicle__angle_of_attack": SCHEDULE,
            "target": {"angle_of_attack_deg": 20.0},
        },
        "target.angle_of_attack: expected nothing, for the angle of attack follows a schedule; "
        "[angle_of_attack] makes it a control",
    ),
    "a weight beside a range": (
        {"objective": WEIGHTS, "target": {"altitude_range_km": [20.0, 30.0]}},
        "target.altitude_range: expected none beside objective.altitude_weight; make the weight 0 or "
        "remove the range",
    ),
    "a weight of what is free": (
        {"objective": WEIGHTS, "target": {"free": ["speed"]}},
        "target.free: expected no state with a weight in [objective], got speed; make "
        "objective.speed_weight 0 or remove speed",
    ),
    "cross-range to a point": (
        {"target": {"position": "fixed"}},
        "objective.cross_range: expected target.longitude or latitude to be free or in a range, got a "
        "target that is met exactly; name it in target.free",
    ),
    "a final speed that is given": (
        {"objective": {"final_speed": -1.0}},
        "objective.final_speed: expected target.speed to be free or in a range, got a target that is "
        "met exactly; name it in target.free",
    ),
    "a heating limit that no angle keeps at the entry": (
        {"limits": {"heat_flux_MW_per_m2": 0.1}},
        "limits.heat_flux: expected at least 0.",
    ),
}
BAD: dict[str, tuple[dict[str, Any], str]] = {
    **{name: ({"angle_of_attack": values}, line) for name, (values, line) in CONTROLS.items()},
    **{name: ({"target": values}, line) for name, (values, line) in TARGETS.items()},
    **TOGETHER,
}


@pytest.mark.parametrize("bad", BAD)
def test_bad_input_is_refused_in_one_sentence_that_names_the_field(bad: str) -> None:
    sections, sentence = BAD[bad]
    assert sentence in told(**sections)


def test_the_shuttle_is_what_its_text_says() -> None:
    shuttle = load_mission("shuttle_betts2010")
    assert mission() == shuttle
    assert parse_mission(shuttle.toml) == shuttle
    assert parse_mission("\n".join(explained(shuttle))).digest == shuttle.digest
    assert shuttle.n_states == 8
    # Betts' numbers, in his units
    foot, slug, btu = 0.3048, 14.593902937206364, 1055.05585262
    vehicle, model = shuttle.vehicle, shuttle.flight_model
    assert vehicle.mass == pytest.approx(203000.0 / 32.174 * slug, rel=1e-14)
    assert vehicle.reference_area == pytest.approx(2690.0 * foot**2, rel=1e-14)
    mu = model.planet.gravitational_parameter
    assert mu == pytest.approx(0.14076539e17 * foot**3, rel=1e-14)
    for degrees in (-10.0, 0.0, 17.0, 45.0):
        lift, drag = model.vehicle.aerodynamics.coefficients(np.radians(degrees), None)
        assert lift == pytest.approx(-0.20704 + 0.029244 * degrees)
        assert drag == pytest.approx(0.07854 - 0.61592e-2 * degrees + 0.621408e-3 * degrees**2)
    assert shuttle.limits.heat_flux == pytest.approx(70.0 * btu / foot**2, rel=1e-14)


def test_the_new_mission_tells_what_bounds_may_go_by() -> None:
    text = "\n".join(explained(load_mission("shuttle_betts2010")))
    assert 'one of speed, mach; optional.\n# over = "speed"' in text


def test_a_list_of_bounds_is_a_mission_of_its_own() -> None:
    over = {"lower_deg": 5.0, "upper_deg": [20.0, 40.0], **SPEEDS}
    steered = mission(angle_of_attack=over)
    control = steered.angle_of_attack
    assert control is not None
    assert np.degrees(control.points) == pytest.approx(np.array([[5.0, 5.0], [20.0, 40.0]]))
    assert parse_mission(steered.toml) == steered
    assert Draft7Validator(mission_schema()).is_valid(tomllib.loads(steered.toml))


ENDS = {
    "altitude_range_km": [20.0, 30.0],
    "longitude_deg": 179.0,
    "longitude_range_deg": [170.0, -170.0],
    "position": "fixed",
    "free": ["latitude", "speed"],
    "bank_angle_deg": 0.0,
    "angle_of_attack_deg": [10.0, 20.0],
}


def test_every_final_state_is_free_fixed_or_in_a_range() -> None:
    anywhere = mission(target=ENDS)
    expected = (ALTITUDE, LONGITUDE, FLIGHT_PATH_ANGLE, BANK, ANGLE_OF_ATTACK)
    assert held_states(anywhere) == expected
    assert tuple(OptimalControlProblem.of(anywhere).target.state) == expected
    altitude, longitude, path, bank, angle = final_states(anywhere)
    assert altitude == FinalState(ALTITUDE, 20e3, 30e3)
    assert longitude.is_circular
    assert np.degrees([longitude.lower, longitude.upper]) == pytest.approx([170.0, 190.0])
    assert np.degrees([path.middle, bank.middle, angle.middle]) == pytest.approx([-5.0, 0.0, 15.0])
    assert parse_mission(anywhere.toml) == anywhere
    assert Draft7Validator(mission_schema()).is_valid(tomllib.loads(anywhere.toml))
    assert parse_mission("\n".join(explained(anywhere))).digest == anywhere.digest


def test_a_weight_of_zero_leaves_a_state_to_its_range() -> None:
    soft = WEIGHTS | {"speed_weight_per_m2_s2": 0.0, "altitude_weight_per_km2": 1.0}
    ranged = mission(objective=soft, target={"speed_range_m_per_s": [700.0, 800.0]})
    target = OptimalControlProblem.of(ranged).target
    assert held_states(ranged) == (ALTITUDE, SPEED, FLIGHT_PATH_ANGLE)
    assert target.weight[0] > 0.0
    assert (target.weight[1], target.upper[1]) == (0.0, pytest.approx(0.05))


def test_a_miss_counts_from_the_range() -> None:
    anywhere = mission(target=ENDS)
    final = np.zeros(8)
    final[[ALTITUDE, LONGITUDE, SPEED, FLIGHT_PATH_ANGLE]] = 25e3, -3.0, 10.0, np.radians(-5.0)
    final[[LATITUDE, AZIMUTH, ANGLE_OF_ATTACK]] = 1.0, 2.0, np.radians(15.0)
    miss = TargetMiss.of(anywhere, final)
    assert miss.is_met
    assert (miss.horizontal, miss.altitude, miss.speed) == (0.0, 0.0, 0.0)
    assert list(miss.angles) == ["flight_path_angle", "bank_angle", "angle_of_attack"]
    final[[ALTITUDE, LONGITUDE, ANGLE_OF_ATTACK]] = 19e3, np.radians(-169.0), np.radians(9.0)
    off = TargetMiss.of(anywhere, final)
    radius = anywhere.flight_model.planet.equatorial_radius
    assert off.altitude == -1e3
    assert off.horizontal == pytest.approx(radius * np.cos(1.0) * np.radians(1.0), rel=1e-3)
    assert off.angles["angle_of_attack"] == pytest.approx(np.radians(1.0))
    assert not off.is_met


def test_the_heat_flux_goes_by_the_angle_of_attack() -> None:
    shuttle = load_mission("shuttle_betts2010")
    state = np.array([60e3, 0.0, 0.0, 6e3, 0.0, 1.0, 0.0, np.radians(20.0)])
    foot = 0.3048
    density = 0.002378 * np.exp(-60e3 / foot / 23800.0)
    expected = 17700.0 * np.sqrt(density) * (1e-4 * 6e3 / foot) ** 3.07
    c = 1.0672181, -0.19213774e-1, 0.21286289e-3, -0.10117249e-5
    expected *= sum(a * 20.0**k for k, a in enumerate(c)) * 1055.05585262 / foot**2
    found = path_constraints(shuttle.flight_model, state, 0.0)[1]
    assert found == pytest.approx(expected, rel=1e-12)


def test_what_guidance_may_change_has_its_acceleration() -> None:
    limits = load_mission("shefex3").limits
    assert limits.angle_of_attack_acceleration == np.radians(4.0)
    faster = mission(limits={"angle_of_attack_acceleration_deg_per_s2": 8.0})
    assert faster.limits.angle_of_attack_acceleration == pytest.approx(np.radians(8.0))
    assert "limits.angle_of_attack_acceleration: Input should be greater than 0" in told(
        limits={"angle_of_attack_acceleration_deg_per_s2": 0.0}
    )
