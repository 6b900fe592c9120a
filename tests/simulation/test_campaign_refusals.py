"""What cannot be flown is one sentence before the first flight."""

from __future__ import annotations

from copy import copy
from pathlib import Path
from typing import Any

import pytest

from ampi.guidance import Guidance
from ampi.missions.mission import Mission
from ampi.onboard.row_layout import RowLayout
from ampi.simulation.campaign_records import CampaignError
from ampi.simulation.monte_carlo import fly
from ampi.simulation.world import WorldError
from ampi.tracking.linear_quadratic import LinearQuadratic
from tests.support.worlds import HEAD

NORMAL = '{ distribution = "normal", three_sigma = 0.1 }'
PAIRS = [("density_factor", "lift_factor"), ("lift_factor", "drag_factor")]
PAIRS += [("density_factor", "drag_factor")]
CORRELATED = f"[density]\nfactor = {NORMAL}\n[aerodynamics]\nlift_factor = {NORMAL}\n"
CORRELATED += f"drag_factor = {NORMAL}\n"
for pair, value in zip(PAIRS, (0.9, 0.9, -0.9), strict=True):
    CORRELATED += f'[[correlation]]\nof = ["{pair[0]}", "{pair[1]}"]\nvalue = {value}\n'
SHORT = "altitude_m,factor\n" + "".join(f"{z},1.1\n" for z in range(0, 90001, 10000))


def refused(mission: Any, guidance: Any, kind: type[Exception] = ValueError, **options: Any) -> str:
    """The sentence, below the name of a faulty file if there is one; nothing has flown."""
    flown: list[int] = []
    with pytest.raises(kind) as told:
        fly(mission, guidance, **{"n": 3, "n_jobs": 1, "advance": flown.append, **options})
    assert not flown
    *above, sentence = str(told.value).split("\n")
    assert all(line.endswith("1 faulty field(s)") for line in above), above
    return sentence


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"n": 0}, "n: expected at least one flight, a whole number; got 0"),
        ({"n": 1.5}, "n: expected at least one flight, a whole number; got 1.5"),
        ({"n": True}, "n: expected at least one flight, a whole number; got True"),
        ({"seed": -1}, "seed: expected a whole number, 0 or greater, got -1"),
        ({"seed": 1.5}, "seed: expected a whole number, 0 or greater, got 1.5"),
        ({"pool": "best"}, "pool: expected one of reported, tuning, got 'best'"),
        ({"n_jobs": 0}, "n_jobs: expected at least 1 worker process, got 0"),
        ({"cycle": 0.0}, "cycle: expected at least 0.001 s, got 0.0"),
        ({"cycle": -0.5}, "cycle: expected at least 0.001 s, got -0.5"),
        ({"cycle": float("nan")}, "cycle: expected at least 0.001 s, got nan"),
        ({"cycle": "often"}, "cycle: expected at least 0.001 s, got 'often'"),
        ({"record_every": -5}, "record_every: expected a positive number of seconds, got -5"),
        ({"record_every": "no"}, "record_every: expected a positive number of seconds, got 'no'"),
        (
            {"record_every": float("nan")},
            "record_every: expected a positive number of seconds, got n",
        ),
        ({"stop": 0.05}, "stop: expected an ampi.StopRule, or None to fly all, got 0.05"),
        ({"world": "mars"}, "world: expected one of arctic, "),
        ({"world": "absent.toml"}, "world: no file at absent.toml"),
        ({"world": 3}, "world: expected a world, its name or the path of its file, got 3"),
    ],
)
def test_options(
    mission: Mission, guidance: Guidance, options: dict[str, Any], sentence: str
) -> None:
    assert refused(mission, guidance, **options).startswith(sentence)


def test_a_name_that_is_no_option(mission: Mission, guidance: Guidance) -> None:
    told = refused(mission, guidance, TypeError, sed=3)
    assert told == (
        "fly: expected the options seed, pool, cycle, engine, record_every, stop, output, resume, "
        "n_jobs, client, advance, got sed"
    )


def test_what_is_no_mission_or_no_guidance(mission: Mission, guidance: Guidance) -> None:
    told = refused("shefex3", guidance)
    assert told == "mission: expected a mission, from ampi.load_mission(name), got 'shefex3'"
    told = refused(mission, "small.h5")
    assert told == "guidance: expected guidance, from ampi.load_guidance(path), got 'small.h5'"


@pytest.mark.parametrize(
    ("head", "body", "words"),
    [
        (HEAD + "scale = -1.0\n", "", ("entry.scale", "greater than 0", "-1")),
        (HEAD, "[density]\nnoise = -0.1\n", ("density.noise", "at least 0", "-0.1")),
        (
            HEAD,
            '[density]\nfactor = { distribution = "normal", sigma = -1.0 }\n',
            ("density.factor", "greater than 0", "-1"),
        ),
        (HEAD, "[aerodynamic]\nlift_factor = 1.1\n", ("aerodynamic:", "such as aerodynamics")),
        (HEAD, "[wind]\neast_m_per_second = 3.0\n", ("wind", "east_m_per_s", "east_m_per_second")),
        (HEAD, "[density]\nfactr = 1.1\n", ("density.factr", "such as factor", "'factr'")),
        (HEAD, CORRELATED, ("correlation", "positive definite")),
        (HEAD + "offsets = { azimuth_deg = 1.0 }\n", "", ("azimuth_deg", "mission does not know")),
        (HEAD, '[density]\ntable = "short.csv"\n', ("short.csv", "entry altitude", "0 to 90 km")),
        (HEAD, "[density\n", ("not valid TOML",)),
    ],
)
def test_worlds(
    mission: Mission,
    guidance: Guidance,
    tmp_path: Path,
    head: str,
    body: str,
    words: tuple[str, ...],
) -> None:
    """A scale below zero, an unknown uncertainty, a typo, a correlation that is none, a short table."""
    (tmp_path / "short.csv").write_text(SHORT)
    path = tmp_path / "world.toml"
    path.write_text(head + body)
    told = refused(mission, guidance, WorldError, world=path)
    for word in words:
        assert word in told


def test_guidance_of_another_mission(mission: Mission, guidance: Guidance) -> None:
    heavier = mission.vehicle.model_copy(update={"mass": mission.vehicle.mass + 1.0})
    told = refused(mission.model_copy(update={"vehicle": heavier}), guidance)
    assert told.startswith("guidance: its database was built for another mission than shefex3; fly")


def test_guidance_whose_table_is_of_another_law(mission: Mission, guidance: Guidance) -> None:
    class Other(LinearQuadratic):
        name = "other"
        layout = RowLayout(LinearQuadratic().layout.rows[:-7])

    mixed = copy(guidance)
    mixed.law = Other()
    told = refused(mission, mixed)
    assert told.startswith("law: expected a table with the rows of other (altitude, ")
    assert told.endswith("load the database for this law")


def test_a_mission_that_is_none(mission: Mission, guidance: Guidance) -> None:
    """Changed in memory, it says what no file could."""
    slow = mission.entry.model_copy(update={"speed": 10.0})
    told = refused(mission.model_copy(update={"entry": slow}), guidance)
    assert "target.speed" in told


def test_an_output_that_cannot_be(mission: Mission, guidance: Guidance, tmp_path: Path) -> None:
    told = refused(mission, guidance, CampaignError, output=tmp_path / "absent" / "a.h5")
    assert told.endswith("absent does not exist")
    told = refused(mission, guidance, CampaignError, output=tmp_path)
    assert told.endswith("expected a file to write, got a folder")
