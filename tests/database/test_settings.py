"""The solver settings of a build reach every solve of it, its file, and what goes on with that."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import database
from ampi.dataset import read_dataset
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.problem.convergence import ConvergenceSettings
from database.factory.stand_in import neighbour_moved
from database.records.campaign import BuildError, as_built, settings_of
from database.refine import refine
from database.rerun import rerun

TIGHT = SolverSettings(max_iterations=299, convergence=ConvergenceSettings(step=1e-7))


@pytest.fixture(scope="module")
def mission(small_mission: Mission) -> Mission:
    """Of three cases."""
    one_axis = small_mission.toml.replace("flight_path_angle_deg = [-0.5, 0.0, 0.5]", "")
    return parse_mission(one_axis)


@pytest.fixture(scope="module")
def tight(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("settings") / "tight.h5"
    assert database.build(mission, path, n_jobs=1, settings=TIGHT).solved == 3
    return path


def test_they_reach_the_nominal_case_and_the_portions(tight: Path, small_database: Path) -> None:
    """The other database has the three cases in the middle of its second axis."""
    found, other = read_dataset(tight), read_dataset(small_database)
    assert np.all(found.iterations > other.iterations[:, 1])
    assert not np.any(found.final_time == other.final_time[:, 1])


def test_the_file_says_them_and_a_case_run_again_has_them(tight: Path) -> None:
    dataset = read_dataset(tight)
    assert settings_of(dataset.attributes["settings"]) == TIGHT
    assert json.loads(dataset.attributes["settings"]) == asdict(TIGHT)
    for case in (0, 1):
        again = rerun(tight, case).trajectory
        np.testing.assert_array_equal(again.states, dataset.trajectory(case).states)


def test_a_refinement_keeps_them(tight: Path, tmp_path: Path) -> None:
    assert refine(tight, tmp_path / "finer.h5", n_jobs=1).build.solved == 4
    assert settings_of(read_dataset(tmp_path / "finer.h5").attributes["settings"]) == TIGHT


def test_a_build_with_others_is_another_build(mission: Mission, tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with pytest.raises(ZeroDivisionError):
        database.build(
            mission, path, n_jobs=1, settings=TIGHT, advance=lambda n: 1 // 0 if n else 0
        )
    with pytest.raises(BuildError, match=r"cases of another build \(different settings\)"):
        database.build(mission, path, n_jobs=1)


def test_another_optimiser_has_none(mission: Mission, tmp_path: Path) -> None:
    with pytest.raises(BuildError, match=r"settings: expected None with another optimiser than"):
        database.build(mission, tmp_path / "a.h5", solver=neighbour_moved, settings=TIGHT)
    with pytest.raises(BuildError, match=r"settings: expected SolverSettings or None, got 3"):
        database.build(mission, tmp_path / "a.h5", settings=3)  # type: ignore[arg-type]
    database.build(mission, tmp_path / "a.h5", n_jobs=1, solver=neighbour_moved)
    assert as_built(read_dataset(tmp_path / "a.h5"), neighbour_moved)["settings"] is None
