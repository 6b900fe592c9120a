"""A mission is one thing: its text is written from its values, and reads back to the bit."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.missions import MissionError, load_mission, shipped_missions
from ampi.missions.loading import parse_mission
from ampi.missions.parameters import at, mission_numbers, with_numbers
from ampi.missions.sections import MeshSection, MissionSections
from ampi.missions.units import UNITS, Section, in_units
from ampi.physics.state import ENTRY_STATES
from ampi.pseudospectral.mesh import Mesh, Phase
from database.file.provenance import provenance
from database.records.campaign import Campaign

laws = settings(deadline=None, max_examples=100)
SHIPPED = {name: load_mission(name) for name in shipped_missions()}
PLACES = {
    name: list(dict.fromkeys(n.path for n in mission_numbers(mission)))
    for name, mission in SHIPPED.items()
}


def leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every field of a mission, or item of a list, that is there."""
    if isinstance(value, Section):
        for name in type(value).model_fields:
            yield from leaves(getattr(value, name), (*path, name))
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from leaves(item, (*path, str(i)))
    elif value is not None:
        yield path, value


def changed(value: Any, path: tuple[str, ...], leaf: Any) -> Any:
    """`value` with another leaf at `path`, as a person changes an object."""
    if not path:
        return leaf
    if isinstance(value, tuple):
        i = int(path[0])
        return (*value[:i], changed(value[i], path[1:], leaf), *value[i + 1 :])
    return value.model_copy(update={path[0]: changed(getattr(value, path[0]), path[1:], leaf)})


def others(leaf: Any) -> tuple[Any, ...]:
    """The values next to it: of a number the floats next to it."""
    if leaf == 0.0:
        return (1e-9, -1e-9)
    if isinstance(leaf, float):
        return math.nextafter(leaf, math.inf), math.nextafter(leaf, -math.inf)
    return (leaf + 1,) if isinstance(leaf, int) else (f"{leaf}s",)


def said_by(text: str) -> MissionSections:
    """The sections of a text, each by itself."""
    return MissionSections.model_validate(tomllib.loads(text))


def bits(mission: MissionSections) -> list[tuple[tuple[str, ...], str]]:
    return [(path, repr(leaf)) for path, leaf in leaves(mission)]


@pytest.mark.parametrize("name", SHIPPED)
def test_text_to_mission_to_text_is_the_identity(name: str) -> None:
    mission = SHIPPED[name]
    again = parse_mission(mission.toml)
    assert again == mission
    assert bits(again) == bits(mission)
    assert again.toml == mission.toml
    assert again.digest == mission.digest
    assert tomllib.loads(mission.toml)["title"] == mission.title


@pytest.mark.parametrize("name", SHIPPED)
def test_every_field_changed_on_the_object_is_what_is_built(name: str) -> None:
    """In the last bit, a title, a mesh degree: digest, text and what the text makes change with it."""
    mission, seen, unsaid = SHIPPED[name], {SHIPPED[name].digest}, []
    for path, leaf in leaves(mission):
        copies = [changed(mission, path, neighbour) for neighbour in others(leaf)]
        for moved in copies:
            assert moved.digest not in seen, path
            assert moved != mission
            seen.add(moved.digest)
        if all(moved.section_faults for moved in copies):
            unsaid.append(leaf)
        for moved in (moved for moved in copies if not moved.section_faults):
            assert bits(said_by(moved.toml)) == bits(moved), path
    words = {leaf for leaf in unsaid if isinstance(leaf, str)}  # names of models, keys of the grid
    assert len(seen) > 100
    assert all(leaf in words or leaf == 0.0 for leaf in unsaid)  # 0 stays in each axis of a grid


def test_a_changed_object_is_what_the_workers_parse_and_the_file_says(tmp_path: Path) -> None:
    mission = SHIPPED["shefex3"]
    for path in (("target", "altitude"), ("vehicle", "aerodynamics", "axial"), ("title",)):
        moved = changed(mission, path, others(at(mission, path))[0])
        campaign = Campaign(moved.toml, tmp_path)
        assert campaign.mission == moved
        attributes = provenance(campaign, {"mission_sha256": moved.digest})
        assert attributes["mission_toml"] == moved.toml


@laws
@given(st.data())
def test_numbers_moved_anywhere_read_back_to_the_bit(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(SHIPPED)))
    mission = SHIPPED[name]
    paths = data.draw(st.lists(st.sampled_from(PLACES[name]), min_size=1, max_size=8, unique=True))
    shares = [data.draw(st.floats(0.99999, 1.00001)) for _ in paths]
    moved = with_numbers(
        mission, [(p, at(mission, p) * s) for p, s in zip(paths, shares, strict=True)]
    )
    text = moved.toml
    assert bits(said_by(text)) == bits(moved)
    assert with_numbers(said_by(text), []).as_written() == moved.as_written()


@laws
@given(st.sampled_from(sorted(UNITS)), st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_in_a_unit_is_the_number(dimension: str, value: float) -> None:
    unit, number = in_units(dimension, value)
    assert math.copysign(1.0, number) == math.copysign(1.0, value)
    assert float(repr(number)) * UNITS[dimension][unit] == value


def test_an_entry_state_and_a_parameter_moved_are_written() -> None:
    """Whatever floats a measurement has."""
    mission, rng = SHIPPED["shefex3_density"], np.random.default_rng(3)
    for _ in range(20):
        there = mission.with_entry(mission.entry_state * rng.uniform(0.9999, 1.0001, 6))
        assert said_by(there.toml).entry == there.entry
        point = mission.nominal_parameters * rng.uniform(0.9999, 1.0001, 7)
        moved = mission.with_parameters(point)
        assert np.array_equal(
            parse_mission(moved.toml).nominal_parameters, moved.nominal_parameters
        )


def test_what_a_mission_keeps_is_of_its_own_sections() -> None:
    """Nothing that it has derived outlives what it was derived from."""
    mission = SHIPPED["shefex3"]
    kept = mission.toml, mission.digest, mission.parameters, mission.flight_model
    assert all(kept)
    light = mission.model_copy(
        update={"vehicle": mission.vehicle.model_copy(update={"mass": 400.0})}
    )
    assert light.flight_model.vehicle.mass == 400.0
    assert "mass_kg = 400.0" in light.toml
    assert light.model_copy(update={"vehicle": mission.vehicle}) == mission
    assert light.model_copy(update={"vehicle": mission.vehicle}).digest == mission.digest
    slow = mission.with_entry(mission.entry_state - np.eye(6)[3])
    assert slow.parameters[3].number.nominal == mission.entry.speed - 1.0
    mesh = Mesh((Phase((4, 4), end=np.float64(58.0)), Phase((np.int64(9),), None, (0.0, 1.0))))
    coarse = mission.with_mesh(mesh)
    assert coarse.pseudospectral_mesh is mesh
    assert coarse.flight_model is mission.flight_model
    assert parse_mission(coarse.toml).pseudospectral_mesh == mesh
    assert coarse.with_mesh(mission.pseudospectral_mesh) == mission


def test_the_text_of_a_mesh_makes_it_again() -> None:
    mesh = Mesh((Phase((5, 8), 58.0), Phase((8,), 88.0), Phase((3, 4), None, (0.0, 0.3, 1.0))))
    tables = tomllib.loads(MeshSection.of(mesh).toml)["mesh"]
    assert MeshSection.model_validate(tables).build() == mesh


def test_a_copy_takes_no_name_that_a_mission_has_not() -> None:
    mission = SHIPPED["shefex3"]
    for section, name in ((mission, "toml"), (mission, "flight_model"), (mission.entry, "altitud")):
        with pytest.raises(ValueError, match=f"update: expected fields of .*, got {name}"):
            section.model_copy(update={name: ""})


def test_a_grid_is_given_by_its_offsets() -> None:
    mission = SHIPPED["shefex3"].with_grid({"speed_m_per_s": [-70, 0], "density_factor": [0, 0.1]})
    assert [p.name for p in mission.parameters] == ["speed", "density_factor"]
    assert parse_mission(mission.toml) == mission
    assert mission.toml.endswith(
        "[grid]\nspeed_m_per_s = [-70.0, 0.0]\ndensity_factor = [0.0, 0.1]\n"
    )
    for grid, said in (
        ({"speed_m_per_s": [70.0, 0.0]}, "expected strictly increasing offsets"),
        ({"speed_m_per_s": [-4700.0, 0.0]}, "at offset -4700"),
        ({"mesh.phase.0.degrees.0": [0.0, 1.0]}, "structure depends on"),
        ({"vehicle.aerodynamics.model": [0.0, 1.0]}, "structure depends on"),
    ):
        with pytest.raises(MissionError, match=said) as caught:
            mission.with_grid(grid)
        assert "\n" not in str(caught.value)


def test_a_default_that_is_written_out_is_the_same_mission() -> None:
    """Whatever object holds it: the digest is of values."""
    mission = SHIPPED["shefex3"]
    text = mission.toml.replace('variable = "time"', 'variable = "time"\nshape = "line"')
    text = text.replace("load_factor_g = 10.0", "load_factor_g = 10.0\nheat_flux_margin = 0.0")
    assert text != mission.toml
    assert parse_mission(text).toml == mission.toml
    angles = mission.vehicle.angle_of_attack.model_copy(update={"shape": "".join(["li", "ne"])})
    assert angles.as_written() == mission.vehicle.angle_of_attack.as_written()


@pytest.mark.parametrize("title", ['"quoted" \\ back', "Ångström — °", "del \x7f", ""])
def test_a_title_may_hold_any_character(title: str) -> None:
    mission = SHIPPED["shefex3"].model_copy(update={"title": title})
    assert parse_mission(mission.toml) == mission


def test_an_angle_of_a_range_and_an_optional_number_are_written() -> None:
    target = SHIPPED["cavh_liu2015"].target
    for angles in ((-0.1, 0.2), (0.3, 0.3), (3.0, 3.5), (0.0, -0.0), None):
        mission = SHIPPED["cavh_liu2015"].model_copy(
            update={"target": target.model_copy(update={"azimuth": angles})}
        )
        assert repr(said_by(mission.toml).target.azimuth) == repr(angles)
    assert ENTRY_STATES[0] == "altitude"
