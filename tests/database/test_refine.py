"""The error map against problems solved in the cells, and one more point where it pays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ampi
import database
from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.loading import guidance_table
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.tracker_design.riccati_gains import GainSettings
from ampi.trajectory import Status, Trajectory
from database.audit.audit import nodal_reference
from database.audit.error_map import COLUMNS, CellError, best_cell, error_map
from database.building import KnownOptimum
from database.factory.stand_in import neighbour_moved
from database.records.campaign import BuildError
from database.refine import RefineReport, refine, with_point

UNEVEN = """[grid]
speed_m_per_s = [-70.0, 0.0]  # two points: probed
flight_path_angle_deg = [-0.5, 0.0, 0.2]
"""


@pytest.fixture(scope="module")
def uneven_file(small_mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six cases: an axis of two points, and one of three uneven ones."""
    text = small_mission.toml[: small_mission.toml.index("[grid]")] + UNEVEN
    path = tmp_path_factory.mktemp("uneven") / "uneven.h5"
    assert database.build(parse_mission(text), path, n_jobs=2).solved == 6
    return path


@pytest.fixture(scope="module")
def uneven(uneven_file: Path) -> TrajectoryDataset:
    return read_dataset(uneven_file)


@pytest.fixture(scope="module")
def cells(uneven: TrajectoryDataset) -> tuple[CellError, ...]:
    return error_map(uneven, n_jobs=1)


def error_at(dataset: TrajectoryDataset, point: np.ndarray) -> dict[str, float]:
    """AMPI against the problem solved at `point`."""
    states, rate, final_time = nodal_reference(guidance_table(dataset), Mode.AMPI, point)
    mission = dataset.mission
    mesh = mission.pseudospectral_mesh
    guess = Trajectory(mesh, states, rate, final_time, np.nan, Status.SOLVED)
    truth = ampi.solve(mission.with_parameters(point), guess=guess)
    assert truth.status.ok
    worst = np.abs(states - truth.states).max(axis=1)
    found = (worst[0], worst[3], np.degrees(worst[6]), abs(final_time - truth.final_time))
    return dict(zip(COLUMNS, found, strict=True))


def test_every_cell_of_every_axis_is_in_the_map(cells: tuple[CellError, ...]) -> None:
    assert [(c.parameter, c.low, c.high, c.source, c.new_cases) for c in cells] == [
        ("speed", -70.0, 0.0, "probes", 3),
        ("flight_path_angle", -0.5, 0.0, "leave-one-out", 2),
        ("flight_path_angle", 0.0, 0.2, "leave-one-out", 2),
    ]
    # all of the error, but for the quarter that a point in every cell would leave
    assert sum(c.gain for c in cells) == pytest.approx(0.75)


def test_the_map_foretells_the_error_in_the_middle_of_a_cell(
    uneven: TrajectoryDataset, cells: tuple[CellError, ...]
) -> None:
    for cell in cells[1:]:
        axis = uneven.mission.nominal_parameters[1]
        middle = axis + np.radians(0.5 * (cell.low + cell.high))
        found = error_at(uneven, np.array([uneven.axes[0][1], middle]))
        for column in ("altitude_m", "speed_m_per_s", "bank_deg"):
            assert 0.4 < cell.errors[column] / found[column] < 2.5, (cell.low, column)


def test_a_probed_error_is_that_of_the_middle(
    uneven: TrajectoryDataset, cells: tuple[CellError, ...]
) -> None:
    found = [error_at(uneven, np.array([uneven.axes[0].mean(), v])) for v in uneven.axes[1]]
    for column in COLUMNS:
        expected = np.percentile([one[column] for one in found], 90.0)
        assert cells[0].errors[column] == pytest.approx(expected, rel=1e-3)


def test_the_best_cell_pays_most_per_solve(cells: tuple[CellError, ...]) -> None:
    best = best_cell(cells)
    assert best.gain_per_case == max(c.gain / c.new_cases for c in cells)
    assert (best.parameter, best.low) == ("flight_path_angle", -0.5)
    assert best_cell(cells, "speed") is best_cell(cells, "speed_m_per_s") is cells[0]
    with pytest.raises(ValueError, match="expected one of speed, flight_path_angle, got 'mass'"):
        best_cell(cells, "mass")


@pytest.fixture(scope="module")
def refined(
    uneven_file: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[RefineReport, Path]:
    path = tmp_path_factory.mktemp("refined") / "refined.h5"
    return refine(uneven_file, path, n_jobs=2), path


def test_refining_solves_what_is_new_alone(
    uneven: TrajectoryDataset, refined: tuple[RefineReport, Path]
) -> None:
    report, path = refined
    assert (report.reused, report.solved_anew, report.offset) == (6, 2, -0.25)
    assert (report.build.resumed, report.build.solved, report.build.cases) == (6, 8, 8)
    after = read_dataset(path)
    assert after.shape == (2, 4)
    for name in ("states", "bank_rate", "final_time", "cost", "iterations"):
        assert np.array_equal(getattr(after, name)[:, [0, 2, 3]], getattr(uneven, name)), name
    assert after.message[1, 2] == (b"case 4 of the grid before refinement: " + uneven.message[1, 1])
    assert dict(after.mission.grid.offsets)["flight_path_angle_deg"] == (-0.5, -0.25, 0.0, 0.2)
    assert all(error < 10.0 for error in after.position_error.ravel())


def test_settings_of_the_file_are_kept_and_another_optimiser_is_refused(
    small_mission: Mission, tmp_path: Path
) -> None:
    path, output = tmp_path / "a.h5", tmp_path / "refined.h5"
    settings = GainSettings(horizontal_miss=1500.0)
    database.build(small_mission, path, solver=neighbour_moved, gains=settings, time_limit=30.0)
    refine(path, output, parameter="speed", solver=neighbour_moved)
    before, after = read_dataset(path), read_dataset(output)
    for name in ("solver", "settings", "gain_settings", "time_limit"):
        assert after.attributes[name] == before.attributes[name], name
    with pytest.raises(
        ValueError, match=r"solved by database\.factory\.stand_in\.neighbour_moved, got ampi"
    ):
        refine(path, tmp_path / "other.h5", parameter="speed")


def test_a_refinement_is_not_continued_from_another_source(
    small_mission: Mission, tmp_path: Path
) -> None:
    """Both databases are of one mission, and their optima differ: the file would mix them."""
    one, other, output = (tmp_path / f"{name}.h5" for name in ("one", "other", "refined"))
    database.build(small_mission, one, solver=neighbour_moved)
    first = KnownOptimum.of(read_dataset(one), 0)
    longer = replace(first.trajectory, final_time=first.trajectory.final_time + 1.0)
    known = {0: replace(first, trajectory=longer)}
    database.build(small_mission, other, solver=neighbour_moved, known=known)
    options: dict[str, Any] = {"parameter": "speed", "solver": neighbour_moved}
    with pytest.raises(ZeroDivisionError):
        refine(one, output, advance=lambda count: 1 // 0, **options)
    with pytest.raises(BuildError, match=r"cases of another build \(different known_sha256\)"):
        refine(other, output, **options)
    assert refine(one, output, **options).build.resumed >= 9


def test_the_database_to_refine_is_no_output(uneven_file: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.h5"
    link.symlink_to(uneven_file)
    for output in (uneven_file, link):
        with pytest.raises(
            BuildError, match="output: expected another file than the database to re"
        ):
            refine(uneven_file, output)


def test_an_output_that_is_a_link_stays_one(small_mission: Mission, tmp_path: Path) -> None:
    elsewhere = tmp_path / "disk" / "a.h5"
    elsewhere.parent.mkdir()
    link = tmp_path / "a.h5"
    link.symlink_to(elsewhere)
    database.build(small_mission, link, solver=neighbour_moved)
    assert link.is_symlink()
    assert read_dataset(elsewhere).solved.all()


def test_the_refined_file_interpolates_better(
    uneven: TrajectoryDataset, refined: tuple[RefineReport, Path]
) -> None:
    point = uneven.mission.nominal_parameters + np.array([0.0, np.radians(-0.2)])
    before, after = error_at(uneven, point), error_at(read_dataset(refined[1]), point)
    assert after["altitude_m"] < 0.5 * before["altitude_m"]
    assert after["bank_deg"] < 0.5 * before["bank_deg"]


def test_a_point_is_added_to_the_grid_and_to_nothing_else(small_mission: Mission) -> None:
    lines = set(small_mission.toml.splitlines())
    refined = with_point(small_mission, "speed", 35.0)
    assert set(refined.toml.splitlines()) - lines == {"speed_m_per_s = [-70.0, 0.0, 35.0, 70.0]"}
    assert refined.model_copy(update={"grid": small_mission.grid}) == small_mission


@pytest.mark.parametrize(
    "axis",
    [
        '"vehicle.mass_kg" = [0, 5]',
        "vehicle.mass_kg = [0, # [S]\n 5,\n]",
        "'vehicle.mass_kg'=[0, 5.0]",
        "[grid.vehicle]\nmass_kg = [0, 5] # kg",
    ],
)
def test_an_axis_may_be_written_as_toml_allows(small_mission: Mission, axis: str) -> None:
    zone = "\n[[no_fly_zone]]\nlongitude_deg = 0.0\nlatitude_deg = 0.0\nradius_km = 1.0\n"
    mission = with_point(parse_mission(small_mission.toml + axis + zone), "vehicle.mass", 2.5)
    assert mission.toml.endswith('"vehicle.mass_kg" = [0.0, 2.5, 5.0]\n')
    assert dict(mission.grid.offsets)["vehicle.mass_kg"] == (0.0, 2.5, 5.0)
    assert len(mission.no_fly_zone) == 1


def test_a_grid_may_be_one_line_or_lie_in_two_places(small_mission: Mission) -> None:
    others, _, _ = small_mission.toml.partition("[grid]")
    inline = "grid = {speed_m_per_s = [-70.0, 0.0], vehicle.mass_kg = [0.0, 5.0]}\n"
    mission = with_point(parse_mission(inline + others), "vehicle.mass", 2.5)
    written = '[grid]\nspeed_m_per_s = [-70.0, 0.0]\n"vehicle.mass_kg" = [0.0, 2.5, 5.0]\n'
    assert mission.toml == others + written
    apart = small_mission.toml.replace("[planet]", "[grid.vehicle]\nmass_kg = [0.0, 5.0]\n[planet]")
    mission = with_point(parse_mission(apart), "speed", 35.0)
    assert dict(mission.grid.offsets)["speed_m_per_s"] == (-70.0, 0.0, 35.0, 70.0)
    assert dict(mission.grid.offsets)["vehicle.mass_kg"] == (0.0, 5.0)
