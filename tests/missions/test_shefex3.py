"""The shipped SHEFEX-3 mission: Tables 1 and 2 and Eqs. (4), (9) of Sagliano et al. 2016, in SI."""

from __future__ import annotations

import itertools
import pickle
from pathlib import Path

import numpy as np
import pytest

from ampi.missions import Mission, load_mission, shipped_missions
from ampi.missions.loading import parse_mission
from ampi.physics.planet import WGS84
from ampi.physics.state import ENTRY_STATES

DEGREE = np.pi / 180.0


@pytest.fixture(scope="module")
def mission() -> Mission:
    return load_mission("shefex3")


@pytest.mark.parametrize("name", shipped_missions())
def test_every_shipped_mission_survives_its_own_text(name: str, tmp_path: Path) -> None:
    mission = load_mission(name)
    assert mission.name == name
    path = tmp_path / "copy.toml"
    path.write_text(mission.toml, encoding="utf-8")
    assert parse_mission(mission.toml) == load_mission(path) == load_mission(str(path)) == mission
    assert pickle.loads(pickle.dumps(mission)) == mission


@pytest.mark.parametrize("name", shipped_missions())
def test_every_shipped_mission_builds_what_the_solver_needs(name: str) -> None:
    mission = load_mission(name)
    mesh = mission.pseudospectral_mesh
    assert mesh.n_nodes == 1 + sum(s.rule.degree for s in mesh.segments)
    assert mission.flight_model.vehicle.mass == mission.vehicle.mass
    assert mission.entry_state.shape == (6,)
    for axis, nominal in zip(mission.grid_axes, mission.nominal_parameters, strict=True):
        assert nominal in axis


def test_units_of_the_same_quantity_agree(mission: Mission) -> None:
    text = mission.toml
    for old, new in (
        ("altitude_km = 100.1", "altitude_m = 100100.0"),
        ("speed_m_per_s = 4712.26", "speed_km_per_s = 4.71226"),
        ("heat_flux_kW_per_m2 = 6500.0", "heat_flux_MW_per_m2 = 6.5"),
        ("dynamic_pressure_kPa = 100.0", "dynamic_pressure_Pa = 1e5"),
        ("altitude_m = [-250.0, 0.0, 250.0]", "altitude_km = [-0.25, 0.0, 0.25]"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    other = parse_mission(text)
    for section in ("entry", "target", "limits", "objective"):
        one, two = (getattr(m, section).model_dump() for m in (mission, other))
        for name, value in one.items():
            same = (
                value
                if value is None or isinstance(value, str)
                else pytest.approx(value, rel=1e-14)
            )
            assert two[name] == same, name
    for one, two in zip(mission.grid_axes, other.grid_axes, strict=True):
        assert two == pytest.approx(one, rel=1e-14)


def test_its_own_entry_state_is_no_change(mission: Mission) -> None:
    assert mission.with_entry(mission.entry_state) == mission


def test_another_entry_state_changes_nothing_else(mission: Mission) -> None:
    corner = np.array([axis[0] for axis in mission.grid_axes])
    moved = mission.with_entry(corner)
    assert moved.entry_state == pytest.approx(corner, rel=1e-15)
    assert moved != mission
    assert moved.target == mission.target
    assert moved.flight_model is mission.flight_model  # not built again
    assert moved.pseudospectral_mesh is mission.pseudospectral_mesh
    assert mission.entry_state[0] == 100.1e3


@pytest.mark.parametrize("deep", [False, True])
def test_a_copy_derives_its_model_and_mesh_anew(mission: Mission, deep: bool) -> None:
    model, mesh = mission.flight_model, mission.pseudospectral_mesh  # cached from here on
    heavy = mission.vehicle.model_copy(update={"mass": 600.0})
    coarse = mission.mesh.model_copy(
        update={"phase": (mission.mesh.phase[-1].model_copy(update={"degrees": (7,)}),)}
    )
    copied = mission.model_copy(update={"vehicle": heavy, "mesh": coarse}, deep=deep)
    assert copied.flight_model.vehicle.mass == 600.0
    assert copied.pseudospectral_mesh.n_nodes == 8
    assert mission.flight_model is model
    assert mission.pseudospectral_mesh is mesh
    assert model.vehicle.mass == 500.0
    assert mission.model_copy(deep=deep) == mission
    # from another entry state as well: the copy's own model goes along
    moved = copied.with_entry(copied.entry_state + 1e-3)
    assert moved.flight_model.vehicle.mass == 600.0
    assert moved.model_copy(update={"vehicle": mission.vehicle}).flight_model == model


def test_a_mission_is_frozen(mission: Mission) -> None:
    with pytest.raises(ValueError, match="frozen"):
        mission.name = "other"
    with pytest.raises(ValueError, match="frozen"):
        mission.vehicle.mass = 1.0


def test_entry_conditions_of_table_1(mission: Mission) -> None:
    expected = [
        100.10e3,
        -11.60 * DEGREE,
        71.89 * DEGREE,
        4712.26,
        -10.31 * DEGREE,
        -85.92 * DEGREE,
    ]
    assert ENTRY_STATES == (
        "altitude",
        "longitude",
        "latitude",
        "speed",
        "flight_path_angle",
        "azimuth",
    )
    assert mission.entry_state == pytest.approx(expected, rel=1e-14)


def test_terminal_conditions_of_table_1(mission: Mission) -> None:
    target = mission.target
    assert target.altitude == pytest.approx(23.50e3)
    assert target.longitude == pytest.approx(-45.75 * DEGREE)
    assert target.latitude == pytest.approx(66.40 * DEGREE)
    assert target.speed == pytest.approx(595.0)
    assert target.altitude_tolerance == pytest.approx(2.5e3)
    assert target.speed_tolerance == pytest.approx(25.0)
    assert target.position_tolerance == pytest.approx(25e3)  # Table 5
    assert target.judged_radii == pytest.approx((3e3, 6.5e3, 13e3, 25e3))


def test_radii_follow_from_the_position_tolerance_unless_they_are_given(mission: Mission) -> None:
    text = mission.toml.replace("radii_km = [3.0, 6.5, 13.0, 25.0]", "")
    assert parse_mission(text).target.judged_radii == (6.25e3, 12.5e3, 25e3, 50e3)
    for radii in ("[]", "[0.0, 1.0]", "[2.0, 1.0]"):
        with pytest.raises(ValueError, match="positive lengths that increase strictly"):
            parse_mission(mission.toml.replace("[3.0, 6.5, 13.0, 25.0]", radii))


@pytest.mark.parametrize("name", shipped_missions())
def test_every_shipped_mission_states_its_position_tolerance(name: str) -> None:
    assert "position_tolerance" in load_mission(name).target.model_fields_set


def test_control_limits_of_table_2(mission: Mission) -> None:
    limits, schedule = mission.limits, mission.vehicle.angle_of_attack
    assert limits.bank_angle == pytest.approx(60.0 * DEGREE)
    assert limits.bank_rate == pytest.approx(5.0 * DEGREE)
    assert limits.bank_acceleration == pytest.approx(4.0 * DEGREE)
    assert limits.angle_of_attack_rate == pytest.approx(5.0 * DEGREE)
    assert limits.angle_of_attack_change == pytest.approx(4.5 * DEGREE)
    assert schedule.variable == "time"
    assert (schedule.start, schedule.end) == (58.0, 88.0)
    assert schedule.start_angle == pytest.approx(42.0 * DEGREE)
    assert schedule.end_angle == pytest.approx(17.5 * DEGREE)


def test_path_limits_and_models(mission: Mission) -> None:
    # Section III.B, Eq. (4), Section III.D; the dynamic pressure read as 10⁵ N/m².
    assert mission.vehicle.mass == 500.0
    assert mission.vehicle.heat_flux_constant == 1.2444e-3
    assert mission.vehicle.heat_flux_speed_exponent == 3.0
    assert mission.limits.heat_flux == pytest.approx(6.5e6)
    assert mission.limits.load_factor == 10.0
    assert mission.limits.dynamic_pressure == pytest.approx(1e5)
    assert mission.flight_model.planet == WGS84


def test_weights_of_eq_1(mission: Mission) -> None:
    # 1 per deg², 1e-4 per m² and per (m/s)².
    objective = mission.objective
    assert objective.longitude_weight * DEGREE**2 == pytest.approx(1.0)
    assert objective.latitude_weight * DEGREE**2 == pytest.approx(1.0)
    assert objective.altitude_weight == 1e-4
    assert objective.speed_weight == 1e-4
    assert objective.bank_rate_effort == 1e-5


def test_hexeract_of_eq_9(mission: Mission) -> None:
    offsets = [axis - x for axis, x in zip(mission.grid_axes, mission.entry_state, strict=True)]
    half = 0.5 * DEGREE
    expected = [250.0, half, half, 70.0, half, half]
    for got, size in zip(offsets, expected, strict=True):
        assert got == pytest.approx([-size, 0.0, size], abs=1e-9)
    assert len(list(itertools.product(*mission.grid_axes))) == 729


def test_phase_boundaries_stand_on_the_kinks_of_the_angle_of_attack(mission: Mission) -> None:
    ends = [phase.end for phase in mission.mesh.phase]
    assert ends == [58.0, 88.0, None]
    times = mission.pseudospectral_mesh.times(640.0)
    assert np.abs(times[:, None] - [58.0, 88.0]).min(axis=0).max() < 1e-10
