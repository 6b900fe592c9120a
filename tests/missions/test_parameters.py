"""Any number of a mission as a parameter: which, in which order, in which unit, and what is refused."""

from __future__ import annotations

import pickle
import re
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ampi.missions import MissionError, load_mission
from ampi.missions.family import MissionFamily
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.missions.parameters import measured_values, mission_numbers
from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.vehicle import air_loads

TEXT = load_mission("shefex3").toml
TEXT = TEXT[: TEXT.index("[grid]")]
DEGREE = np.pi / 180.0

MANY = """[grid]
density_factor = [-0.1, 0.0, 0.2]
"target.longitude_deg" = [0, 0.5]
vehicle.mass_kg = [-20.0, -5.0, 0.0, 5.0, 20.0]
entry.azimuth_rad = [-0.01, 0.0]
vehicle.angle_of_attack.start = [-2.0, 0.0, 2.0]
vehicle.aerodynamics.axial = [0.0, 0.01]
speed_km_per_s = [-0.07, 0.0]
limits.heat_flux_MW_per_m2 = [-0.2, 0.0]
drag_factor = [-0.05, 0.0]
lift_factor = [0.0, 0.05]
latitude_deg = [0.0]
"""


def gridded(grid: str) -> Mission:
    return parse_mission(f"{TEXT}[grid]\n{grid}\n")


@pytest.fixture(scope="module")
def many() -> Mission:
    return parse_mission(TEXT + MANY)


# --- laws -----------------------------------------------------------------------------------------


def test_parameters_are_entry_states_first_then_as_they_stand(many: Mission) -> None:
    assert [(p.name, p.number.unit) for p in many.parameters] == [
        ("speed", "m/s"),
        ("azimuth", "rad"),
        ("density_factor", "1"),
        ("target.longitude", "rad"),
        ("vehicle.mass", "kg"),
        ("vehicle.angle_of_attack.start", "as in the mission file"),
        ("vehicle.aerodynamics.axial", "as in the mission file"),
        ("limits.heat_flux", "W/m2"),
        ("drag_factor", "1"),
        ("lift_factor", "1"),
    ]
    assert many.grid_axes[4] == pytest.approx([480.0, 495.0, 500.0, 505.0, 520.0])
    assert many.grid_axes[0] == pytest.approx([4642.26, 4712.26])
    assert many.grid_axes[2] == pytest.approx([0.9, 1.0, 1.2])
    assert many.grid_axes[7] == pytest.approx([6.3e6, 6.5e6])


def test_the_nominal_parameters_are_on_the_axes_and_are_no_change(many: Mission) -> None:
    for axis, nominal in zip(many.grid_axes, many.nominal_parameters, strict=True):
        assert nominal in axis
    assert many.with_parameters(many.nominal_parameters) == many


def test_every_parameter_moves_its_number_and_no_other(many: Mission) -> None:
    nominal = many.nominal_parameters
    for i, parameter in enumerate(many.parameters):
        values = nominal.copy()
        values[i] = parameter.axis[0] if parameter.axis[0] != nominal[i] else parameter.axis[-1]
        moved = many.with_parameters(values)
        here, there = ({n.path: n.nominal for n in mission_numbers(m)} for m in (many, moved))
        changed = {path for path, value in here.items() if there[path] != value}
        assert changed == {parameter.number.path}
        assert there[parameter.number.path] == values[i]
        touches_model = parameter.number.path[0] in ("planet", "atmosphere", "vehicle")
        assert (moved.flight_model == many.flight_model) is not touches_model
        assert (moved.flight_model is many.flight_model) is not touches_model
        assert moved.pseudospectral_mesh is many.pseudospectral_mesh


TABLE = """[grid]
planet.radius_km = [-2.0, 0.0]
planet.surface_gravity = [-0.01, 0.0]
atmosphere.scale_height_m = [-50.0, 0.0]
vehicle.aerodynamics.lift.1.1 = [-0.01, 0.0]
vehicle.aerodynamics.angle_of_attack.1_deg = [-0.5, 0.0]
vehicle.aerodynamics.mach.1 = [-0.1, 0.0]
limits.heat_flux_MW_per_m2 = [0.0, 0.1]
target.longitude_deg = [-0.1, 0.0]
"""


@pytest.mark.parametrize("text", [TEXT + MANY, f"{load_mission('cavh_wang2020').toml}\n{TABLE}"])
def test_a_family_flies_as_its_members_do(text: str) -> None:
    """One flight model with arrays against one model each, to the last bits."""
    many = parse_mission(text)
    rng = np.random.default_rng(1)
    low, high = (np.array([axis[k] for axis in many.grid_axes]) for k in (0, -1))
    family = many.family(rng.uniform(low, high, (5, len(low))))
    states = np.array([60e3, -0.3, 1.2, 4500.0, -0.05, -1.5, 0.4])[:, None] * rng.uniform(
        0.9, 1.1, (7, 5)
    )
    times = rng.uniform(50.0, 95.0, 5)
    rates = np.stack(equations_of_motion(family.flight_model(), states, np.full(5, 0.01), times))
    loads = np.stack(path_constraints(family.flight_model(), states, times))
    over_time = np.repeat(states[:, :, None], 3, axis=2)
    wide = np.stack(path_constraints(family.flight_model(trailing=1), over_time, times[:, None]))
    for i in range(len(family)):
        mission = family.member(i)
        assert_same(family.flight_model(), mission.flight_model, i)
        assert_same(family.path_limits(), PathLimits.of(mission), i)
        one = equations_of_motion(mission.flight_model, states[:, i], 0.01, times[i])
        assert rates[:, i] == pytest.approx(np.array(one), rel=1e-13)
        alone = path_constraints(mission.flight_model, states[:, i], times[i])
        assert loads[:, i] == pytest.approx(np.array(alone), rel=1e-13)
        assert wide[:, i, 2] == pytest.approx(np.array(alone), rel=1e-13)
        assert family.path_limits().loads[1][i] == mission.limits.heat_flux
        assert family.target("longitude")[i] == mission.target.longitude
        assert family.entry_states[i] == pytest.approx(mission.entry_state, rel=0)

    alike = MissionFamily.of([family.member(i) for i in range(5)])
    assert len(alike) == 5
    assert np.array_equal(alike.take([3, 1]).entry_states, family.entry_states[[3, 1]])
    for i in range(5):
        assert_same(alike.flight_model(), family.member(i).flight_model, i)
        assert alike.member(i) == family.member(i)


def assert_same(joined: Any, one: Any, case: int) -> None:
    """To the bit, down to the numbers of a physics object and what it has worked out of them."""
    if is_dataclass(one):
        for field in fields(one):
            assert_same(getattr(joined, field.name), getattr(one, field.name), case)
    elif isinstance(one, tuple):
        for pair in zip(joined, one, strict=True):
            assert_same(*pair, case)
    elif isinstance(one, float | np.ndarray):
        plain = np.shape(joined) == np.shape(one)
        assert np.array_equal(joined if plain else joined[..., case], one)
    else:
        assert joined == one


def test_a_family_of_entry_states_has_the_plain_model() -> None:
    mission = load_mission("shefex3")
    family = mission.family(mission.nominal_parameters + np.eye(6) * 1e-3)
    assert family.flight_model() is mission.flight_model
    alike = MissionFamily.of([family.member(i) for i in range(6)])
    assert np.array_equal(alike.entry_states, family.entry_states)
    assert alike.flight_model() is family.member(0).flight_model


def test_a_family_makes_no_mission_per_case(many: Mission, monkeypatch: pytest.MonkeyPatch) -> None:
    family = many.family(np.repeat(many.nominal_parameters[None], 1000, axis=0) * 1.001)
    copies = list[int]()
    copied = Mission.model_copy
    monkeypatch.setattr(Mission, "model_copy", lambda *a, **b: copies.append(1) or copied(*a, **b))
    _ = family.flight_model(), family.path_limits(1), family.entry_states, family.target("speed")
    assert len(copies) < 20


def test_missions_of_another_structure_are_no_family(many: Mission) -> None:
    spheres = load_mission("x33_liu2015"), load_mission("cavh_liu2015")
    with pytest.raises(TypeError, match=r"differ in numbers only, got .* one by one"):
        MissionFamily.of(spheres)


@pytest.mark.parametrize(
    ("key", "lift", "drag", "density"),
    [
        ("atmosphere.density_factor", 1.02, 1.02, 1.02),
        ("vehicle.lift_factor", 1.02, 1.0, 1.0),
        ("vehicle.drag_factor", 1.0, 1.02, 1.0),
    ],
)
@pytest.mark.parametrize("name", ["shefex3", "cavh_zhou2021"])
def test_a_factor_multiplies_what_it_names(
    name: str, key: str, lift: float, drag: float, density: float
) -> None:
    text = load_mission(name).toml
    if "[grid]" in text:
        text = text[: text.index("[grid]")]
    mission = parse_mission(f"{text}\n[grid]\n{key} = [0.0, 0.02]\n")
    (nominal, thick) = (
        air_loads(m.flight_model.vehicle, m.flight_model.atmosphere, 40e3, 4000.0, 70.0)
        for m in (mission, mission.with_parameters([1.02]))
    )
    assert thick.lift / nominal.lift == pytest.approx(lift)
    assert thick.drag / nominal.drag == pytest.approx(drag)
    assert thick.density / nominal.density == pytest.approx(density)


def test_a_mission_with_parameters_can_be_pickled(many: Mission) -> None:
    assert pickle.loads(pickle.dumps(many)) == many


# --- the seven-dimensional example ----------------------------------------------------------------


def test_the_density_mission_is_shefex3_with_a_seventh_axis() -> None:
    shefex3, density = load_mission("shefex3"), load_mission("shefex3_density")
    assert density.with_parameters(density.nominal_parameters) == density
    sections = set(type(density).model_fields) - {"name", "title", "grid"}
    for section in sections:
        assert getattr(density, section) == getattr(shefex3, section), section
    assert [p.name for p in density.parameters[:6]] == [p.name for p in shefex3.parameters]
    assert density.parameters[6].name == "density_factor"
    assert density.grid_axes[6] == pytest.approx([0.9, 1.0, 1.1])
    assert np.prod([len(axis) for axis in density.grid_axes]) == 2187


# --- what is refused ------------------------------------------------------------------------------

REFUSED = {
    "an unknown number, near names told": (
        "vehicle.mas_kg = [0, 1]",
        "grid.vehicle.mas_kg: expected a number of this mission with its unit in the key, such as "
        "vehicle.mass_kg, ",
    ),
    "an unknown factor": ("densty_factor = [0, 1]", "such as density_factor"),
    "a key without its unit": ("vehicle.mass = [0, 1]", "such as vehicle.mass_kg"),
    "a word": ("vehicle.load_factor = [0, 1]", "grid.vehicle.load_factor: expected a number that"),
    "a node of the mesh": ("mesh.phase.0.end_s = [0, 1]", "grid.mesh.phase.0.end_s: expected a n"),
    "a schedule that has kinks at one point alone": (
        "vehicle.angle_of_attack.smoothing = [0, 5]",
        "grid.vehicle.angle_of_attack.smoothing: at offset 5: smoothing: expected a positive number at",
    ),
    "the name of a model": (
        "vehicle.aerodynamics.model = [0, 1]",
        "grid.vehicle.aerodynamics.model: expected a number that leaves the structure",
    ),
    "an axis given twice": (
        "speed_m_per_s = [0, 1]\nentry.speed_km_per_s = [0, 1]",
        "grid.entry.speed_km_per_s: speed has an axis already; remove one of them",
    ),
    "an axis that does not increase": (
        "density_factor = [0.1, 0.0]",
        "grid: density_factor: expected strictly increasing offsets, got [0.1, 0.0]",
    ),
    "an axis of values instead of offsets": (
        "density_factor = [0.9, 1.0, 1.1]",
        "grid: density_factor: expected offsets that contain 0, the nominal value, got [0.9, 1.0",
    ),
    "an axis that does not increase in the number's own rounding": (
        "altitude_m = [-100.0, 0.0, 1e-12, 100.0]",
        "grid.altitude_m: expected offsets that differ beside the nominal value",
    ),
    "a number beyond any float": (
        f"altitude_m = [0, {10**400}]",
        "grid: altitude_m: expected finite offsets, got 1000",
    ),
    "a number that is not finite": (
        "density_factor = [0.0, inf]",
        "grid: density_factor: expected finite offsets, got inf",
    ),
    "no list": (
        "density_factor = 0.1",
        "grid: density_factor: expected a list of offsets, got 0.1",
    ),
    "no number": (
        'density_factor = [0.0, "0.1"]',
        "grid: density_factor: expected a number, got '0.1'",
    ),
    "a limit that meets its opposite": (
        "limits.bank_angle_minimum_deg = [0, 60]",
        "grid.limits.bank_angle_minimum_deg: at offset 60: bank_angle_minimum: expected less than",
    ),
    "the only term of the objective taken away": (
        "objective.bank_rate_effort = [-1e-5, 0]",
        "grid.objective.bank_rate_effort: at offset -1e-05: expected at least one term",
    ),
    "a value that the field refuses": (
        "density_factor = [-1.0, 0.0]",
        "grid.density_factor: at offset -1: density_factor: Input should be greater than 0 (got 0)",
    ),
    "a value that the vehicle refuses": (
        "vehicle.angle_of_attack.start = [0.0, 40.0]",
        "grid.vehicle.angle_of_attack.start: at offset 40: angle_of_attack: end (88.0) must lie",
    ),
    "a limit below the entry's value": (
        "limits.heat_flux_MW_per_m2 = [-6.45, 0.0]",
        "grid.limits.heat_flux_MW_per_m2: at offset -6.45: limits.heat_flux: expected at least",
    ),
    "a target faster than the entry": (
        "target.speed_km_per_s = [0.0, 5.0]",
        "grid.target.speed_km_per_s: at offset 5: target.speed (5595 m/s) must be below",
    ),
    "a latitude beyond the pole, in its own unit": (
        "latitude_deg = [0.0, 20.0]",
        "grid.latitude_deg: at offset 20: latitude: Input should be less than 90 deg (got 91.89 deg)",
    ),
    "an altitude too high, in its own unit": (
        "entry.altitude_km = [0.0, 40.0]",
        "at offset 40: altitude: Input should be less than or equal to 130 km (got 140.1 km)",
    ),
    "offsets that are lost in the nominal value": (
        "altitude_km = [0.0, 1e-16]",
        "grid.altitude_km: expected offsets that differ beside the nominal value, 100.1; got",
    ),
    "eleven dimensions": (
        MANY.removeprefix("[grid]\n") + "target.speed_m_per_s = [0.0, 1.0]",
        "grid: expected at most 10 axes of two or more points, got 11",
    ),
}


@pytest.mark.parametrize("fault", list(REFUSED))
def test_a_bad_axis_is_one_sentence(fault: str) -> None:
    grid, message = REFUSED[fault]
    with pytest.raises(MissionError, match=re.escape(message)) as caught:
        gridded(grid)
    assert "1 faulty field(s)" in str(caught.value)


@pytest.mark.parametrize("values", [np.zeros(9), np.full(10, np.nan), np.zeros((10, 1))])
def test_bad_parameters_are_refused(many: Mission, values: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"parameters: expected 10 finite numbers \(speed, azimu"):
        many.with_parameters(values)
    if values.shape != (10,):
        with pytest.raises(ValueError, match=r"values: expected shape \(n, 10\)"):
            many.family(values)


def test_measured_values_take_keys_in_any_unit(many: Mission) -> None:
    values = measured_values(many, many.parameters, {"speed_m_per_s": 4700, "vehicle.mass_kg": 490})
    expected = many.nominal_parameters.copy()
    expected[[0, 4]] = 4700.0, 490.0
    assert values == pytest.approx(expected, rel=0)
    kilo = measured_values(many, many.parameters, {"speed_km_per_s": 4.7})
    assert kilo[0] == pytest.approx(4700.0)
    with pytest.raises(
        ValueError, match=r"latitude_deg: expected a parameter of this mission \(sp"
    ):
        measured_values(many, many.parameters, {"latitude_deg": 70.0})
    with pytest.raises(ValueError, match="drag_factor: expected a finite number, got inf"):
        measured_values(many, many.parameters, {"drag_factor": np.inf})


def test_keys_in_full_are_measured_too(many: Mission) -> None:
    values = measured_values(many, many.parameters, {"entry.speed_km_per_s": 4.7})
    assert values[0] == pytest.approx(4700.0)


ANGLES = """azimuth_deg = [-0.5, 0.0, 0.5]
latitude_deg = [-0.5, 0.0, 0.5]
"target.longitude_deg" = [0.0, 0.5]
"""


@pytest.mark.parametrize("turns", [-1, 1])
def test_a_circular_angle_is_measured_on_any_turn(turns: int) -> None:
    mission, turn = gridded(ANGLES), 360.0 * turns
    given = {"azimuth_deg": -85.92 + turn, "target.longitude_deg": -45.5 - turn}
    values = measured_values(mission, mission.parameters, given)
    expected = np.radians([71.89, -85.92, -45.5])
    assert values == pytest.approx(expected, rel=1e-14)
    moved = mission.with_parameters(np.radians([71.89, -85.92 + turn, -45.5]))
    assert moved.entry.azimuth == pytest.approx(np.radians(-85.92), rel=1e-14)
    # a latitude does not come round
    (key,) = (p.key for p in mission.parameters if p.name == "latitude")
    far = measured_values(mission, mission.parameters, {key: 71.89 + turn})
    assert far[0] == pytest.approx(np.radians(71.89 + turn))


def test_an_axis_may_cross_a_meridian_at_which_angles_begin_again() -> None:
    text = TEXT.replace("azimuth_deg = -85.92", "azimuth_deg = 179.0")
    text = text.replace("longitude_deg = -11.6", "longitude_deg = 359.5")
    axes = "azimuth_deg = [-2.0, 0.0, 2.0]\nlongitude_deg = [-1.0, 0.0, 1.0]\n"
    mission = parse_mission(f"{text}[grid]\n{axes}")
    assert np.degrees(mission.grid_axes[1]) == pytest.approx([177.0, 179.0, 181.0])
    given = {"azimuth_deg": -179.5, "longitude_deg": 0.25}
    values = measured_values(mission, mission.parameters, given)
    assert np.degrees(values) == pytest.approx([360.25, 180.5])


def test_a_range_of_azimuth_may_cross_south() -> None:
    others, _, _ = load_mission("rlv_liu2024").toml.partition("[grid]")
    across = parse_mission(others.replace("azimuth_deg = 90.0", "azimuth_deg = [170.0, -170.0]"))
    assert across.target.azimuth == pytest.approx(np.radians([170.0, 190.0]))
    with pytest.raises(MissionError, match=r"target.azimuth: expected a number or \[least"):
        parse_mission(others.replace("azimuth_deg = 90.0", "azimuth_deg = [95.0, 60.0]"))


def test_a_range_may_not_be_turned_inside_out() -> None:
    others, _, _ = load_mission("rlv_liu2024").toml.partition("[grid]")
    others = others.replace("azimuth_deg = 90.0", "azimuth_deg = [60.0, 95.0]")
    with pytest.raises(MissionError, match=r"at offset 90: azimuth: expected a number or \[least"):
        parse_mission(f'{others}[grid]\n"target.azimuth.0_deg" = [0, 90]\n')


def test_a_number_measured_twice_is_refused(many: Mission) -> None:
    given = {"speed_m_per_s": 4700.0, "speed_km_per_s": 4.8}
    with pytest.raises(
        ValueError, match=r"speed_km_per_s: speed is given already, as speed_m_per_s"
    ):
        measured_values(many, many.parameters, given)


# an axis of rlv_liu2024, where its number stands, and what stands there at its first point
OF_ANY_KIND = {
    "target.flight_path_angle_deg = [-0.5, 0.0]": ("target.flight_path_angle", (-10.5, -10.5)),
    "planet.radius_km = [-1.0, 0.0]": ("planet.radius", 6377137.0),
    "vehicle.aerodynamics.lift.1 = [-1e-3, 0.0]": (
        "vehicle.aerodynamics.lift",
        (-0.041065, 0.015292, 0.0002602),
    ),
}


@pytest.mark.parametrize("axis", list(OF_ANY_KIND))
def test_ranges_optional_numbers_and_coefficients_are_parameters(axis: str) -> None:
    mission = parse_mission(f"{load_mission('rlv_liu2024').toml}\n[grid]\n{axis}\n")
    path, expected = OF_ANY_KIND[axis]
    value: Any = mission.with_parameters([mission.grid_axes[0][0]])
    for part in path.split("."):
        value = getattr(value, part)
    if "angle" in path:
        value = np.degrees(value)
    assert value == pytest.approx(expected)
    assert mission.with_parameters(mission.nominal_parameters) == mission


def test_a_folder_does_not_hide_a_shipped_mission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shefex3").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load_mission("shefex3").name == "shefex3"
