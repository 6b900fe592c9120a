"""Building: resume, failures as records, the same file whatever the workers."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import database
from ampi.dataset import DatasetError, partial_folder, read_dataset
from ampi.loading import load_guidance
from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission
from ampi.missions.path_limits import KEPT, PathLimits
from ampi.propagation.reintegration import reintegrate
from ampi.scp.solve import solve
from ampi.trajectory import Status, Trajectory
from ampi.workers.job import JobError
from database.factory.jobs import SolveCase, SolvePortion
from database.factory.stand_in import neighbour_moved
from database.plan.continuation import layers
from database.plan.grid import Grid
from database.records.campaign import BuildError, Campaign
from database.records.reader import RecordReader
from database.records.record_files import count_records, record_path
from database.rerun import rerun
from tests.support.missions import coarse, text_on_grid

pytestmark = pytest.mark.slow


def test_file_is_the_same_for_any_number_of_workers(
    small_mission: Mission, small_database: Path, tmp_path: Path
) -> None:
    one = tmp_path / "one.h5"
    database.build(small_mission, one, n_jobs=1)
    first, second = read_dataset(small_database), read_dataset(one)
    assert first.attributes["content_sha256"] == second.attributes["content_sha256"]
    assert small_database.read_bytes() == one.read_bytes()


def test_interrupted_build_resumes_to_the_same_file(
    small_mission: Mission, small_database: Path, tmp_path: Path
) -> None:
    path = tmp_path / "resumed.h5"

    class StoppedHereError(Exception):
        pass

    done = 0

    def interrupt(count: int) -> None:
        nonlocal done
        done += count
        if done >= 4:
            raise StoppedHereError

    with pytest.raises(StoppedHereError):
        database.build(small_mission, path, n_jobs=2, advance=interrupt)
    assert not path.exists()
    kept = count_records(partial_folder(path))
    assert 4 <= kept < 9
    with pytest.raises(DatasetError, match=r"not finished .* same build command"):
        load_guidance(path)
    report = database.build(small_mission, path, n_jobs=2)
    assert report.resumed >= kept
    assert report.solved == 9
    assert not partial_folder(path).exists()
    assert path.read_bytes() == small_database.read_bytes()


def test_a_damaged_record_is_solved_again(
    small_mission: Mission, small_database: Path, tmp_path: Path
) -> None:
    path = tmp_path / "damaged.h5"
    folder = partial_folder(path)
    with pytest.raises(ZeroDivisionError):
        database.build(
            small_mission, path, n_jobs=1, advance=lambda count: 1 // 0 if count else None
        )
    kept, nominal = count_records(folder), record_path(folder, 4)  # what follows it may be kept
    nominal.write_bytes(nominal.read_bytes()[:100])
    report = database.build(small_mission, path, n_jobs=1)
    assert report.resumed == kept - 1
    assert path.read_bytes() == small_database.read_bytes()


def test_a_folder_of_another_build_is_refused(small_mission: Mission, tmp_path: Path) -> None:
    path = tmp_path / "other.h5"
    other = parse_mission(small_mission.toml.replace("mass_kg = 500.0", "mass_kg = 499.0"))
    with pytest.raises(ZeroDivisionError):
        database.build(other, path, n_jobs=1, advance=lambda count: 1 // 0 if count else None)
    with pytest.raises(BuildError, match=r"another build \(different mission_sha256\)"):
        database.build(small_mission, path)


def test_a_missing_folder_is_named(small_mission: Mission, tmp_path: Path) -> None:
    with pytest.raises(BuildError, match=r"the folder .*absent does not exist"):
        database.build(small_mission, tmp_path / "absent" / "a.h5")


def test_a_case_out_of_reach_is_a_record_and_the_file_cannot_fly(tmp_path: Path) -> None:
    """The steep entry cannot keep a load-factor limit that the nominal one keeps."""
    limit = "load_factor_g = 8.2\nload_factor_margin = 0.025"  # kept between the nodes too
    text = coarse(text_on_grid("[grid]\nflight_path_angle_deg = [-0.5, 0.0]\n"))
    text = text.replace("load_factor_g = 10.0", limit)
    path = tmp_path / "holes.h5"
    report = database.build(parse_mission(text), path, n_jobs=2)
    dataset = read_dataset(path)
    assert 0 < report.solved < report.cases
    assert len(report.failures) == report.cases - report.solved
    failed = ~dataset.solved
    assert np.all(np.isnan(dataset.final_time[failed]))
    assert np.all(np.isnan(dataset.states[failed]))
    assert np.all(dataset.status[failed] != int(Status.SOLVED))
    for message in dataset.message[failed]:
        assert message.decode().startswith("from case")
    with pytest.raises(DatasetError, match=r"cases have no solution.*holes cannot fly"):
        load_guidance(path)


def test_an_exception_in_the_optimiser_is_a_record(small_mission: Mission, tmp_path: Path) -> None:
    def explode(*_: object, **__: object) -> Trajectory:
        raise RuntimeError("boom")

    case = layers(Grid.from_mission(small_mission))[0][0].case
    campaign = Campaign(small_mission.toml, tmp_path, explode)
    SolveCase(campaign, case).run(lambda attempt: None)
    record = RecordReader(campaign, {}).record(case)
    assert record.trajectory.status is Status.ERROR
    assert "RuntimeError: boom" in record.message


def test_a_case_leaves_its_record_and_nothing_else(small_mission: Mission, tmp_path: Path) -> None:
    case = layers(Grid.from_mission(small_mission))[0][0].case
    SolveCase(Campaign(small_mission.toml, tmp_path), case).run(lambda attempt: None)
    assert [f.name for f in tmp_path.iterdir()] == [f"cases_{case:06d}.rec"]


def test_no_case_is_solved_without_a_neighbour_that_was_lost(
    small_mission: Mission, tmp_path: Path
) -> None:
    """From the others it would come to other bits than in an undisturbed build."""
    plan = layers(Grid.from_mission(small_mission))
    campaign = Campaign(small_mission.toml, tmp_path, neighbour_moved)
    for planned in (plan[0][0], plan[1][0]):
        SolveCase(campaign, planned.case).run(lambda attempt: None)
    corner = plan[2][0]
    there, lost = corner.neighbours
    assert RecordReader(campaign, {}).solved(there) is not None
    for job in (SolveCase(campaign, corner.case), SolvePortion(campaign, (corner.case,))):
        with pytest.raises(JobError, match=rf"cases_{lost:06d}\.rec has disappeared or changed"):
            job.run(lambda attempt: None)


@pytest.mark.parametrize(
    ("axis", "message"),
    [
        (
            "limits.bank_angle_minimum_deg = [0, 20]",
            "bank_angle_minimum: asked for by mission shef",
        ),
        ("objective.altitude_weight_per_m2 = [-1e-4, 0]", r"weight is 0; leave out that point"),
    ],
)
def test_what_a_point_of_the_grid_asks_for_is_known_before(
    small_mission: Mission, tmp_path: Path, axis: str, message: str
) -> None:
    """Each was taken for the nominal problem, or ended the build in the middle."""
    others, _, _ = small_mission.toml.partition("[grid]")
    mission = parse_mission(f"{others}[grid]\n{axis}\n")
    with pytest.raises(ValueError, match=message):
        database.build(mission, tmp_path / "a.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_nominal_flight_far_from_its_optimum_ends_the_build(tmp_path: Path) -> None:
    """The mesh of this mission is made for another method: re-integration contradicts the optimum."""
    text = load_mission("rlv_liu2024").toml + "\n[grid]\ndensity_factor = [0, 0.02]\n"
    with pytest.raises(
        BuildError, match=r"Flown again, it lies .* m from its nodes .* try: ampi solve --refine"
    ):
        database.build(parse_mission(text), tmp_path / "a.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_case_whose_flight_exceeds_a_limit_is_a_hole_with_its_reason(
    small_mission: Mission, tmp_path: Path
) -> None:
    """The nodes keep a limit that acts, what lies between does not: solved together or alone."""
    others, _, _ = small_mission.toml.partition("[grid]")
    peak = reintegrate(small_mission, solve(small_mission)).peak[0, 0]
    lower = (0.9 * peak - 1.0) * small_mission.limits.dynamic_pressure / 1e3
    text = f"{others}[grid]\nlimits.dynamic_pressure_kPa = [{lower}, -0.1, 0.0]\n"
    report = database.build(parse_mission(text), tmp_path / "a.h5")
    assert report.solved == 2
    assert report.worst_limit <= 1.0 + KEPT
    (failure,) = report.failures
    assert failure.status is Status.INACCURATE
    assert Status.INACCURATE.sentence in failure.message
    assert "dynamic_pressure_margin" in failure.message
    dataset = read_dataset(tmp_path / "a.h5")
    assert dataset.status.tolist() == [int(Status.INACCURATE), 0, 0]
    assert dataset.peak.shape == (3, len(PathLimits.of(dataset.mission).names))
    assert 1.0 + KEPT < dataset.peak[0, 0] < 1.05
    assert dataset.position_error[0] < 50.0
    assert np.all(np.isnan(dataset.states[0]))
    assert np.all(np.isnan(dataset.gains[0]))
    again = rerun(tmp_path / "a.h5", 0)
    assert again.trajectory.status is Status.INACCURATE
    assert again.attempts[-1].outcome in again.stored


def test_an_existing_file_survives_a_failed_rebuild(
    small_mission: Mission, small_database: Path, tmp_path: Path
) -> None:
    path = tmp_path / "kept.h5"
    shutil.copy(small_database, path)
    with pytest.raises(ZeroDivisionError):
        database.build(
            small_mission,
            path,
            n_jobs=1,
            resume=False,
            advance=lambda count: 1 // 0 if count else None,
        )
    assert path.read_bytes() == small_database.read_bytes()
