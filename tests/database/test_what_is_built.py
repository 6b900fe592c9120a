"""A build makes what the mission object says, and refuses what no mission file could say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ampi
import database
from ampi.dataset import read_dataset
from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions import Mission, MissionError
from ampi.missions.family import MissionFamily
from ampi.missions.grid import GridSection
from ampi.pseudospectral.mesh import Mesh
from database.estimate import estimate
from database.records.campaign import BuildError


def changed(mission: Mission, section: str, **fields: Any) -> Mission:
    """A mission changed in memory, unchecked."""
    return mission.model_copy(update={section: getattr(mission, section).model_copy(update=fields)})


def test_what_the_object_says_is_what_is_built(small_mission: Mission, tmp_path: Path) -> None:
    """82 nodes instead of 64, and a target at 30 km instead of 23.5."""
    *before, last = small_mission.pseudospectral_mesh.phases
    finer = Mesh((*before, replace(last, degrees=(15, 15, 15, 15))))
    moved = changed(small_mission, "target", altitude=30e3, speed=1200.0).with_mesh(finer)
    moved = moved.with_grid({"speed_m_per_s": [0.0, 70.0]})
    path = tmp_path / "moved.h5"
    assert database.build(moved, path, n_jobs=1).solved == 2
    dataset = read_dataset(path)
    assert dataset.mission == moved
    assert dataset.attributes["mission_toml"] == moved.toml
    assert dataset.states.shape == (2, 7, 82)
    assert dataset.states[:, 0, -1] == pytest.approx([30e3, 30e3], abs=20.0)
    guidance = load_guidance(path)
    assert guidance.mission_sha256 == moved.digest != small_mission.digest
    for another in (small_mission, moved.with_mesh(small_mission.pseudospectral_mesh)):
        with pytest.raises(ValueError, match="built for another mission"):
            ampi.fly(another, guidance, n=1, n_jobs=1)


FAULTS: dict[str, tuple[Callable[[Mission], Any], str]] = {
    "NaN": (
        lambda m: changed(m, "target", latitude=np.nan),
        "target.latitude: Input should be a finite number (got nan)",
    ),
    "an infinite number": (
        lambda m: changed(m, "limits", load_factor=np.inf),
        "limits.load_factor: Input should be a finite number (got inf)",
    ),
    "a target below the ground": (
        lambda m: changed(m, "target", altitude=-2e3),
        "target.altitude: Input should be greater than or equal to 0 (got -2 km)",
    ),
    "a number as text": (
        lambda m: changed(m, "vehicle", mass="500"),
        "vehicle.mass_kg: expected a number, got '500'",
    ),
    "a number where a range is": (
        lambda m: changed(m, "target", azimuth=0.5),
        "target.azimuth: expected what a mission file can say, (0.5, 0.5), got 0.5",
    ),
    "no number": (
        lambda m: changed(m, "entry", speed=None),
        "entry.speed_m_per_s: expected a number, got None",
    ),
    "no section": (
        lambda m: m.model_copy(update={"target": None}),
        "target: Input should be a valid dictionary or instance of TargetSection",
    ),
    "a table for a section": (
        lambda m: m.model_copy(update={"entry": m.entry.as_written()}),
        "entry: expected a section of a mission, got {",
    ),
    "a degree that is no whole number": (
        lambda m: m.model_copy(
            update={
                "mesh": m.mesh.model_copy(
                    update={"phase": (m.mesh.phase[-1].model_copy(update={"degrees": (8.5,)}),)}
                )
            }
        ),
        "mesh.phase.0.degrees.0: Input should be a valid integer (got 8.5)",
    ),
}

OF_THE_WHOLE: dict[str, tuple[Callable[[Mission], Any], str]] = {
    "a target faster than the entry": (
        lambda m: changed(m, "target", speed=5e3),
        "target.speed (5000 m/s) must be below entry.speed",
    ),
    "a limit below what the target needs": (
        lambda m: changed(m, "limits", dynamic_pressure=10.0),
        "limits.dynamic_pressure: expected at least",
    ),
    "a grid over a mesh degree": (
        lambda m: gridded(m, "mesh.phase.0.degrees.0"),
        "grid.mesh.phase.0.degrees.0: expected a number that leaves the structure",
    ),
    "a grid over the name of a model": (
        lambda m: gridded(m, "vehicle.aerodynamics.model"),
        "grid.vehicle.aerodynamics.model: expected a number that leaves the structure",
    ),
    "a grid beyond what a number may be": (
        lambda m: gridded(m, "target.altitude_km", (-30.0, 0.0)),
        "grid.target.altitude_km: at offset -30: altitude: Input should be greater than or equal to 0",
    ),
}


def gridded(mission: Mission, key: str, offsets: tuple[float, ...] = (0.0, 1.0)) -> Mission:
    return mission.model_copy(
        update={"grid": GridSection.model_construct(offsets=((key, offsets),))}
    )


@pytest.fixture(scope="module")
def guidance(small_database: Path) -> Guidance:
    return load_guidance(small_database)


@pytest.mark.parametrize("fault", [*FAULTS, *OF_THE_WHOLE])
def test_what_no_file_could_say_is_refused_before_any_work(
    small_mission: Mission, guidance: Guidance, tmp_path: Path, fault: str
) -> None:
    change, sentence = {**FAULTS, **OF_THE_WHOLE}[fault]
    mission, path = change(small_mission), tmp_path / "none.h5"
    asked: list[Callable[[], Any]] = [
        lambda: database.build(mission, path),
        lambda: estimate(mission, path, workers=1),
        lambda: ampi.fly(mission, guidance, n=1),
    ]
    if fault in FAULTS:
        asked.append(lambda: ampi.solve(mission))
    for ask in asked:
        with pytest.raises(MissionError) as refused:
            ask()
        assert sentence in str(refused.value)
        assert str(refused.value).startswith("shefex3: ")
        assert "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_a_family_with_one_impossible_member_is_refused(
    small_mission: Mission, small_database: Path
) -> None:
    nominal = read_dataset(small_database).trajectory(4)
    low = changed(small_mission, "target", altitude=-2e3)
    absurd = small_mission.with_entry(small_mission.entry_state * np.array([1, 1, 1, 9, 1, 1]))
    for missions, sentence in (
        ([small_mission, low], "target.altitude: Input should be greater"),
        ([absurd, small_mission], "entry.speed: Input should be less than or equal to 12000 m/s"),
    ):
        with pytest.raises(MissionError, match=sentence):
            ampi.solve_family(MissionFamily.of(missions), [nominal] * 2)


def test_a_measured_entry_far_out_is_a_hard_problem_and_no_fault(small_mission: Mission) -> None:
    """So deep that the heat-flux limit is exceeded, say: that is for the optimiser to find."""
    deep = small_mission.with_entry(small_mission.entry_state - np.array([60e3, 0, 0, 0, 0, 0]))
    with pytest.raises(MissionError, match=r"limits\.heat_flux: expected at least .* at the entry"):
        deep.checked()
    assert deep.checked(whole=False) is deep


def test_what_is_no_mission_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BuildError, match="mission: expected a Mission, got 'shefex3'"):
        database.build("shefex3", tmp_path / "none.h5")  # type: ignore[arg-type]
