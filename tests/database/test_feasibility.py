"""What is said of a mission before its build is what the build finds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from ampi.cli import app
from ampi.cli.check import in_words
from ampi.missions import load_mission
from ampi.missions.loading import parse_mission
from ampi.trajectory import Status
from database import corners
from database.corners import solve_corners
from database.feasibility import Feasibility, Reach, feasibility
from tests.support.missions import small_mission, text_on_grid

pytestmark = pytest.mark.slow
WIDE = "[grid]\nflight_path_angle_deg = [-4.0, 0.0, 0.2]\n"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def found() -> Feasibility:
    return feasibility(small_mission(), workers=2)


def test_a_mission_that_is_built_whole_is_clear(found: Feasibility) -> None:
    assert found.clear
    assert found.status is Status.SOLVED
    assert found.reach.least < found.reach.distance < found.reach.greatest
    assert found.binding == ()
    assert found.mesh is not None
    assert (found.mesh.nodes, found.mesh.finer_nodes) == (64, 88)
    assert found.mesh.position_error < 5.0
    assert found.corners is not None
    ends = [(-70.0, -0.5), (-70.0, 0.5), (70.0, -0.5), (70.0, 0.5)]
    assert [tuple(c.offsets.values()) for c in found.corners.solved] == ends
    assert found.corners.failed == ()
    assert found.cost is not None
    assert found.cost.cases == 9
    assert found.cost.seconds == pytest.approx(found.corners.seconds_each * 9 / 2)


def test_it_is_said_in_plain_words(found: Feasibility) -> None:
    lines = in_words(found)
    assert lines[-1] == "nothing speaks against the build"
    assert not any(line.startswith("!") for line in lines)
    told = json.loads(json.dumps(found.as_dict(), default=float))
    assert told["clear"] is True
    assert told["corners"]["solved"][0]["status"] == "SOLVED"


def test_a_corner_without_a_solution_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four degrees steeper the load factor cannot be kept; with no time left nobody says so."""
    import ampi

    mission = parse_mission(text_on_grid(WIDE))
    optimum = ampi.solve(mission)
    steep, shallow = solve_corners(mission, optimum).solved
    assert steep.status in (Status.LIMITS_EXCEEDED, Status.TARGET_MISSED)
    assert steep.in_words() == "flight_path_angle_deg -4"
    assert shallow.status is Status.SOLVED
    monkeypatch.setattr(corners, "MOST_SECONDS", -1.0)
    assert solve_corners(mission, optimum).solved[0].status is Status.TIME_LIMIT


def test_of_many_corners_some_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(corners, "MOST_CORNERS", 20)
    mission = load_mission("shefex3_air")
    axes = tuple(len(p.offsets) for p in mission.parameters)
    kept, number = corners._corners(corners.Grid.from_mission(mission))
    assert number == 2 ** len(axes) > len(kept) == corners.MOST_CORNERS
    assert len(set(kept)) == len(kept)
    index = np.stack(np.unravel_index(kept, axes), axis=1)
    assert all(i in (0, n - 1) for row in index.tolist() for i, n in zip(row, axes, strict=True))


def test_exit_statuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "m.toml"
    text = text_on_grid("[grid]\nspeed_m_per_s = [-1.0, 0.0]\n")
    path.write_text(text.replace("[14, 14, 14]", "[7, 7]"), encoding="utf-8")
    result = run("check", path)
    assert result.exit_code == 2
    assert "! mesh     too coarse: 36 nodes" in result.output
    assert "the nominal case has no solution: mend that first" in result.output
    monkeypatch.setattr(corners, "MOST_SECONDS", -1.0)
    path.write_text(text_on_grid(WIDE), encoding="utf-8")
    result = run("check", path, "--jobs", "1")
    assert result.exit_code == 1
    assert "! corners  1 of 2 solved" in result.output
    assert "The first: flight_path_angle_deg -4" in result.output
    result = run("check", path, "--json")
    assert json.loads(result.stdout)["corners"]["solved"][0]["status"] == "TIME_LIMIT"
    path.write_text(text_on_grid(""), encoding="utf-8")
    result = run("check", path)
    assert result.exit_code == 0
    assert "none: the mission disperses nothing" in result.output
    assert run("check", tmp_path / "no.toml").exit_code == 2


def test_a_target_out_of_reach_is_said_so() -> None:
    far = Reach(distance=2.0e6, least=0.6e6, greatest=1.7e6, nearest=3e5)
    assert not far.within
    assert Reach(distance=1.0e6, least=0.6e6, greatest=np.nan).within  # unknown is no verdict
    lines = in_words(Feasibility("m", far, Status.TARGET_MISSED, "It.", {}, (), None, None, None))
    assert lines[0].startswith("! reach")
    assert "the target lies at 2,000 km, outside: no bank angle held comes there" in lines[0]
    assert "ends 300 km from it" in lines[0]
