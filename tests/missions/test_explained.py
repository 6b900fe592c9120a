"""A mission or world to edit: explained field by field, and the same as its source."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ampi.cli import app
from ampi.missions import load_mission, shipped_missions
from ampi.missions.explained import explained, section_type, told
from ampi.missions.loading import parse_mission
from ampi.missions.sections import MissionSections
from ampi.missions.units import Section
from ampi.simulation.uncertainties import CATALOGUE
from ampi.simulation.world_loading import load_world, shipped_worlds


def run(*arguments: object, status: int = 0) -> str:
    result = CliRunner().invoke(app, list(map(str, arguments)))
    assert result.exit_code == status, result.output
    return result.output


@pytest.mark.parametrize("name", shipped_missions())
def test_the_new_mission_is_its_source(name: str) -> None:
    assert (
        parse_mission("\n".join(explained(load_mission(name)))).digest == load_mission(name).digest
    )


@pytest.mark.parametrize("name", shipped_worlds())
def test_the_new_world_is_its_source(tmp_path: Path, name: str) -> None:
    run("new", tmp_path / "w.toml", "--from", name)
    copied = load_world(tmp_path / "w.toml")
    assert copied.digest == load_world(name).digest
    assert all((tmp_path / file).is_file() for file in copied.sections.files)
    text = (tmp_path / "w.toml").read_text(encoding="utf-8")
    for uncertainty in CATALOGUE:
        assert any(f"\n{key} = " in text or f"\n# {key} = " in text for key in uncertainty.keys)


def sections_below(kind: type[Section]) -> set[type[Section]]:
    found = {kind}
    for info in kind.model_fields.values():
        below = section_type(info)
        found |= sections_below(below) if below is not Section else set()
    return found


@pytest.mark.parametrize("kind", sorted(sections_below(MissionSections), key=str))
def test_every_field_has_its_description(kind: type[Section]) -> None:
    assert [n for n, f in kind.model_fields.items() if not f.description and n != "offsets"] == []


def test_a_comment_tells_units_bounds_and_default() -> None:
    entry, target = (MissionSections.model_fields[n] for n in ("entry", "target"))
    fields = section_type(entry).model_fields | {}
    assert told("altitude", fields["altitude"]) == (
        "Height over the planet's surface; in m or km; ≥ 0 and ≤ 130 km; required."
    )
    fields = section_type(target).model_fields
    assert told("position", fields["position"]).endswith("one of fixed, free; default fixed.")
    assert "; > 0 km; default 10 km." in told("position_tolerance", fields["position_tolerance"])


def test_what_is_at_its_default_may_be_taken_in() -> None:
    """Every commented assignment with a default, taken in, leaves the mission what it is."""
    text = "\n".join(explained(load_mission("shefex3")))
    taken = 0
    for line in (line for line in text.split("\n") if line.startswith("# ") and " = " in line):
        data = line[2:]
        try:
            ((key, value),) = tomllib.loads(data).items()
        except (tomllib.TOMLDecodeError, ValueError):
            continue
        if key.endswith("_factor") and value == 1.0:
            with_it = text.replace(line, data)
            assert parse_mission(with_it).digest == load_mission("shefex3").digest
            taken += 1
    assert taken == 3


def test_a_mission_is_written_once(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    said = run("new", path, "--from", "shefex3_january")
    assert "my.toml: the mission shefex3_january, explained; beside it mission.schema.json" in said
    assert path.read_text(encoding="utf-8").startswith("#:schema ./mission.schema.json\n")
    assert load_mission(path).digest == load_mission("shefex3_january").digest
    before = path.read_bytes()
    assert "nothing was overwritten" in run("new", path, "--from", "shefex3", status=2)
    assert path.read_bytes() == before
    run("new", path, "--from", "shefex3", "--force")
    assert load_mission(path).digest == load_mission("shefex3").digest
    said = run("new", path, "--from", path, "--force", status=2)
    assert "expected another file than the source" in said


def test_what_is_beside_it_stays(tmp_path: Path) -> None:
    (tmp_path / "arctic_draws.csv").write_text("mine\n", encoding="utf-8")
    said = run("new", tmp_path / "w.toml", "--from", "arctic", status=2)
    assert "arctic_draws.csv is already there" in said.replace("\n", " ")
    assert not (tmp_path / "w.toml").exists()
    assert "expected a name that ends in .toml" in run(
        "new", tmp_path / "w.h5", "--from", "entry", status=2
    )
