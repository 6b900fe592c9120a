"""Parameters beyond the entry state, from a mission file to a verdict: the density of the air.

The seven-dimensional example is built with two points per axis, 128 cases; a cut through it, speed ×
density with an uneven axis, is flown.
"""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

import ampi
import database
from ampi.dataset import read_dataset
from ampi.guidance import Guidance
from ampi.loading import load_guidance
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.propagation.reintegration import reintegrate
from tests.support.command_line import run
from tests.support.missions import text_on_grid
from tests.support.worlds import of_entries

pytestmark = pytest.mark.slow

SEVEN = """[grid]
altitude_m = [0.0, 250.0]
longitude_deg = [0.0, 0.5]
latitude_deg = [-0.5, 0.0]
speed_m_per_s = [-70.0, 0.0]
flight_path_angle_deg = [0.0, 0.5]
azimuth_deg = [0.0, 0.5]
density_factor = [0.0, 0.1]
"""
CUT = """[grid]
speed_m_per_s = [-70.0, 0.0, 70.0]
density_factor = [-0.1, 0.0, 0.05, 0.1]
"""


def built(grid: str, folder: Path) -> Path:
    mission = parse_mission(text_on_grid(grid, "shefex3_density"))
    (folder / "mission.toml").write_text(mission.toml, encoding="utf-8")
    path = folder / "density.h5"
    report = database.build(mission, path, n_jobs=2)
    assert report.failures == ()
    return path


@pytest.fixture(scope="module")
def seven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(SEVEN, tmp_path_factory.mktemp("seven"))


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(CUT, tmp_path_factory.mktemp("cut"))


@pytest.fixture(scope="module")
def mission(cut: Path) -> Mission:
    return read_dataset(cut).mission


@pytest.fixture(scope="module")
def guidance(cut: Path) -> Guidance:
    return load_guidance(cut)


# --- seven dimensions -----------------------------------------------------------------------------


def test_seven_dimensions_are_built_and_true(seven: Path) -> None:
    dataset = read_dataset(seven)
    assert dataset.shape == (2,) * 7
    assert dataset.names[6] == "density_factor"
    assert dataset.position_error.max() < 20.0
    with h5py.File(seven) as file:
        assert file["axis_density_factor"].attrs["units"] == "1"
        assert file["states"].dims[6].label == "density_factor"
        assert file["states"].ndim == 9


def test_every_optimum_was_found_in_its_own_air(seven: Path) -> None:
    """Re-integrated one by one: true under its own density, far off under the nominal one."""
    dataset = read_dataset(seven)
    points = np.stack(np.meshgrid(*dataset.axes, indexing="ij"), axis=-1).reshape(-1, 7)
    for case in (0, 1, 77, 127):
        thick = dataset.mission.with_parameters(points[case])
        own = reintegrate(thick, dataset.trajectory(case)).position_error[0]
        assert own == pytest.approx(float(dataset.position_error.ravel()[case]), abs=0.05)
        if points[case][6] > 1.0:
            nominal = dataset.mission.with_parameters([*points[case][:6], 1.0])
            assert reintegrate(nominal, dataset.trajectory(case)).position_error[0] > 2e3


def test_seven_dimensions_fly(seven: Path) -> None:
    mission, guidance = read_dataset(seven).mission, load_guidance(seven)
    uniform = of_entries("uniform")
    flights = ampi.fly(mission, guidance, uniform, n=20, seed=4, n_jobs=1, cycle=0.5)
    assert flights.parameters.shape == (20, 7)
    assert flights.reached.all()
    assert not flights.clipped.any()
    middle = mission.with_parameters([axis.mean() for axis in mission.grid_axes])
    reference = guidance.reference(middle.nominal_parameters)
    assert reference.inside
    assert reference.states[:6, 0] == pytest.approx(middle.entry_state, rel=1e-12)
    assert flights.miss.max() < 3e3


# --- the cut --------------------------------------------------------------------------------------


def test_guidance_that_is_told_the_density_hits_what_the_nominal_misses(
    mission: Mission, guidance: Guidance
) -> None:
    uniform = of_entries("uniform")
    miss = {
        mode: ampi.fly(
            mission, guidance.in_mode(mode), uniform, n=60, seed=9, n_jobs=1, cycle=0.5
        ).miss
        for mode in (Mode.NOMINAL, Mode.AMPI, Mode.QUADRATIC)
    }
    assert np.median(miss[Mode.AMPI]) < 0.3 * np.median(miss[Mode.NOMINAL])
    assert np.median(miss[Mode.QUADRATIC]) < np.median(miss[Mode.AMPI])
    assert miss[Mode.QUADRATIC].max() < 1e3


def test_a_flight_in_a_batch_is_the_flight_in_its_own_air(
    mission: Mission, guidance: Guidance
) -> None:
    draws = of_entries("corners")
    few = ampi.fly(mission, guidance, draws, n=6, seed=1, n_jobs=1, cycle=0.5)
    many = ampi.fly(mission, guidance, draws, n=120, seed=1, n_jobs=2, cycle=0.5)
    assert few.miss == pytest.approx(many.miss[:6], abs=1e-3)
    assert few.peak == pytest.approx(many.peak[:6], rel=1e-9)
    assert few.path == pytest.approx(many.path[:6, :, : few.path.shape[2]], rel=1e-9, nan_ok=True)


def test_a_target_may_move_with_p(mission: Mission, tmp_path: Path) -> None:
    """The nominal optimum is tracked to its own target: the miss is the target's displacement."""
    grid = "[grid]\ntarget.latitude_deg = [0.0, 0.2]\ntarget.speed_m_per_s = [0.0, 20.0]\n"
    path = tmp_path / "target.h5"
    moving = parse_mission(text_on_grid(grid, "shefex3_density"))
    assert database.build(moving, path, n_jobs=1).solved == 4
    guidance = load_guidance(path)
    told, untold = (
        ampi.fly(
            moving,
            guidance.in_mode(mode),
            of_entries("uniform"),
            n=20,
            seed=2,
            n_jobs=1,
            cycle=0.5,
        )
        for mode in (Mode.AMPI, Mode.NOMINAL)
    )
    assert told.miss.max() < 1e3
    assert told.speed_error == pytest.approx(0.0, abs=1e-3)
    assert np.ptp(told.final_states[:, 3]) > 5.0
    displaced = 6.371e6 * (untold.parameters[:, 0] - moving.target.latitude)
    assert untold.miss == pytest.approx(displaced, abs=3e3)


# --- the command line -----------------------------------------------------------------------------


def test_the_command_line_takes_any_parameter(cut: Path) -> None:
    folder = cut.parent
    nominal = run("guide", "density.h5", cwd=folder).stdout
    options = ("--speed", "4740", "-p", "density_factor=1.07", "--json")
    thick = json.loads(run("guide", "density.h5", *options, cwd=folder).stdout)
    assert nominal.startswith("cell (1, 1), final time")
    assert thick["parameters"] == {"speed": 4740.0, "density_factor": 1.07}
    assert (thick["cell"], thick["outside"]) == ([1, 2], [])
    outside = run("guide", "density.h5", "-p", "density_factor=1.12", cwd=folder).stdout
    assert "outside the hypercube in density_factor: boundary trajectory" in outside


def test_audit_and_refine_print_every_number_as_json(cut: Path) -> None:
    folder = cut.parent
    options = ("--probes", "2", "--figures", "figures", "--repair", "--json")
    found = json.loads(run("audit", "density.h5", *options, cwd=folder).stdout)
    assert found["repairs"] == []
    assert found["coherence"]["outliers"] == []
    assert len(found["coherence"]["roughness"]) == 12
    assert len(found["per_case"]["limits_used"]) == 12
    assert [c["parameter"] for c in found["error_map"]] == ["speed"] * 2 + ["density_factor"] * 3
    for name in ("coherence.png", "error_map.png"):
        assert (folder / "figures" / name).read_bytes().startswith(b"\x89PNG")
    text = run("audit", "density.h5", "--probes", "0", cwd=folder).stdout
    assert "← pays most" in text
    assert "a case stands out above 10" in text
    options = ("--parameter", "speed", "--json")
    refined = json.loads(run("refine", "density.h5", *options, cwd=folder).stdout)
    assert (refined["reused"], refined["solved_anew"]) == (12, 4)
    assert refined["build"]["path"].endswith("density-refined.h5")
    assert read_dataset(folder / "density-refined.h5").shape == (4, 4)
