"""A database with holes: what is said of them, and the part of the grid without them."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import database
from ampi.cli import app
from ampi.dataset import partial_folder, read_dataset
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.trajectory import Status
from database.audit.verify import verify
from database.build_report import BuildReport
from database.crop import CropReport, crop, largest_box
from database.records.campaign import BuildError

Holed = tuple[Path, BuildReport, dict[str, Any]]


@pytest.fixture(scope="module")
def holed(
    small_mission: Mission, small_database: Path, tmp_path_factory: pytest.TempPathFactory
) -> Holed:
    """Nothing is solved at the greatest speed: three of nine cases; with its solver."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parent)
        patch.setenv("AMPI_TEST_DATABASE", str(small_database))
        import misbehaving

        path = tmp_path_factory.mktemp("holed") / "holed.h5"
        options = {"solver": misbehaving.misses, "n_jobs": 1}
        return path, database.build(small_mission, path, **options), options


@pytest.fixture
def misbehaving(small_database: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Whose solvers the workers of a crop import."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    monkeypatch.setenv("AMPI_TEST_DATABASE", str(small_database))
    import misbehaving

    return misbehaving


@pytest.fixture
def cropped(holed: Holed, misbehaving: ModuleType, tmp_path: Path) -> tuple[CropReport, Path]:
    path, _, options = holed
    output = tmp_path / "cropped.h5"
    return crop(path, output, drop=[("speed_km_per_s", 4.78226)], **options), output


def test_failures_are_three_lines_and_every_case(holed: Holed) -> None:
    path, report, _ = holed
    assert (report.solved, report.cases) == (6, 9)
    where, why, way_out = report.failure_summary
    assert where == (
        "3 of 9 cases not solved: all of them at speed_m_per_s = 4782.26, where there are 3 cases"
    )
    assert why == f"reasons: 3 × {Status.TARGET_MISSED.sentence}"
    assert way_out.startswith(
        f"ampi crop {path} --drop speed_m_per_s=4782.26 keeps the other 6 cases; with --holes fly"
    )
    assert [one.index for one in report.failures] == [(2, 0), (2, 1), (2, 2)]
    assert [one["case"] for one in report.as_dict()["failures"]] == [6, 7, 8]
    corner = report.failures[0].as_dict()
    assert corner["values"] == pytest.approx(
        {"speed_m_per_s": 4782.26, "flight_path_angle_deg": -10.81}
    )
    assert corner["status"] == "TARGET_MISSED"
    assert corner["message"].startswith("from ")


def test_a_finished_build_is_found_whole_and_its_failures_told_again(
    small_mission: Mission, holed: Holed
) -> None:
    path, first, options = holed
    before = path.stat()
    again = database.build(small_mission, path, **options)
    assert (path.stat().st_ino, path.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert (again.already_whole, first.already_whole) == (True, False)
    for name in ("cases", "solved", "failures", "failure_summary", "worst_position_error"):
        assert getattr(again, name) == getattr(first, name)
    assert (again.median_iterations, again.worst_iterations, again.resumed) == (1.0, 1, 9)
    assert not partial_folder(path).exists()


def test_a_whole_file_that_was_made_otherwise_is_not_overwritten(
    small_mission: Mission, holed: Holed
) -> None:
    path, _, options = holed
    before = path.read_bytes()
    with pytest.raises(
        BuildError, match=r"made otherwise \(different time_limit \(60\.0 there, 30\.0.*no-resume"
    ):
        database.build(small_mission, path, time_limit=30.0, **options)
    with pytest.raises(BuildError, match=r"made otherwise \(different solver"):
        database.build(small_mission, path)
    assert path.read_bytes() == before


def test_a_damaged_file_of_the_same_mission_is_built_anew(
    small_mission: Mission, holed: Holed, misbehaving: ModuleType, tmp_path: Path
) -> None:
    path, _, options = holed
    raw = bytearray(path.read_bytes())
    raw[-100] ^= 1
    damaged = tmp_path / "a.h5"
    damaged.write_bytes(raw)
    assert not database.build(small_mission, damaged, **options).already_whole
    assert damaged.read_bytes() == path.read_bytes()


def test_a_crop_holds_the_other_cases_as_they_were(
    holed: Holed, cropped: tuple[CropReport, Path]
) -> None:
    report, path = cropped
    assert report.dropped == {"speed_m_per_s": (pytest.approx(4782.26),)}
    assert (report.cases_before, report.build.cases, report.build.solved) == (9, 6, 6)
    before, after = read_dataset(holed[0]), read_dataset(path)
    assert "speed_m_per_s = [-70.0, 0.0]\n" in after.mission.toml
    removed = set(before.mission.toml.splitlines()) - set(after.mission.toml.splitlines())
    assert removed == {"speed_m_per_s = [-70.0, 0.0, 70.0]"}
    for name in ("states", "bank_rate", "gains", "final_time", "cost", "status", "iterations"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name)[:2])
    assert after.message[0, 0].startswith(b"case 0 of the grid before cropping: from ")
    assert verify(path).whole


def test_a_hole_that_stays_is_not_solved_again(
    holed: Holed, misbehaving: ModuleType, tmp_path: Path
) -> None:
    """Axes of one point are none: the other one is left."""
    path, _, options = holed
    output = tmp_path / "line.h5"
    drop = [("flight_path_angle_deg", -10.81), ("flight_path_angle_deg", -9.81)]
    report = crop(path, output, drop=drop, **options)
    assert (report.build.cases, report.build.solved, report.build.resumed) == (3, 2, 3)
    dataset = read_dataset(output)
    assert dataset.names == ("speed",)
    assert dataset.solved.tolist() == [True, True, False]
    assert dataset.message[2].startswith(b"case 7 of the grid before cropping: from ")
    assert verify(output).whole
    assert crop(path, output, drop=drop, **options).build.already_whole


def test_the_largest_box_is_cropped(holed: Holed, misbehaving: ModuleType, tmp_path: Path) -> None:
    path, _, options = holed
    report = crop(path, tmp_path / "box.h5", box=True, **options)
    assert (report.build.cases, report.build.solved) == (6, 6)
    with pytest.raises(BuildError, match="expected something to leave out, got a grid without a"):
        crop(tmp_path / "box.h5", tmp_path / "again.h5", box=True, **options)


@pytest.mark.parametrize(
    ("drop", "message"),
    [
        ([], "expected at least one KEY=VALUE to leave out, or box, got neither"),
        ([("speed", 4782.26)], r"speed: expected a parameter of this mission \(speed_m_per_s"),
        (
            [("speed_m_per_s", 4780.0)],
            r"grid point of speed_m_per_s \(4642\.26, 4712\.26, 4782\.26\), got .* = 4780",
        ),
        ([("speed_m_per_s", 4712.26)], "speed_m_per_s = 4712.26 is the nominal value"),
        ([("speed_km_per_s", 4.7122601)], "is the nominal value, which every grid holds"),
        (
            [
                *(("speed_m_per_s", speed) for speed in (4642.26, 4782.26)),
                *(("flight_path_angle_deg", angle) for angle in (-10.81, -9.81)),
            ],
            "nothing but the nominal case would be left",
        ),
    ],
)
def test_what_cannot_be_left_out_is_named(
    holed: Holed, tmp_path: Path, drop: list[tuple[str, float]], message: str
) -> None:
    path, _, options = holed
    with pytest.raises(ValueError, match=message):
        crop(path, tmp_path / "a.h5", drop=drop, **options)
    assert list(tmp_path.iterdir()) == []


def test_the_database_to_crop_is_no_output(holed: Holed) -> None:
    path, _, options = holed
    with pytest.raises(BuildError, match="output: expected another file than the database to crop"):
        crop(path, path, box=True, **options)


@given(st.data())
def test_the_largest_box_is_the_largest_of_all(data: st.DataObject) -> None:
    shape = tuple(data.draw(st.lists(st.integers(1, 4), min_size=1, max_size=3)))
    centre = tuple(data.draw(st.integers(0, n - 1)) for n in shape)
    solved = np.array(data.draw(st.lists(st.booleans(), min_size=64, max_size=64)))
    solved = solved[: int(np.prod(shape))].reshape(shape)
    solved[centre] = True
    found = largest_box(solved, centre, tuple(tuple(range(n)) for n in shape))
    assert solved[np.ix_(*found)].all()
    assert all(c in indices for c, indices in zip(centre, found, strict=True))
    assert all(np.all(np.diff(indices) == 1) for indices in found)
    sides = [
        [range(a, b) for a in range(c + 1) for b in range(c + 1, n + 1)]
        for c, n in zip(centre, shape, strict=True)
    ]
    sizes = [
        int(np.prod([len(side) for side in box]))
        for box in itertools.product(*sides)
        if solved[np.ix_(*box)].all()
    ]
    assert int(np.prod([len(indices) for indices in found])) == max(sizes)


def test_failures_in_several_places_are_counted_by_place(small_mission: Mission) -> None:
    """A corner and an edge that share no axis value but nominal ones."""
    from database.build_report import Tally

    mission = parse_mission(small_mission.toml + "azimuth_deg = [-0.5, 0.0, 0.5]\n")
    tally = Tally.of(mission)
    for case in (3, 4, 5, 22):  # (0, 1, …) thrice, (2, 1, 1)
        tally.fail(case, Status.STALLED, b"from case 13: it stalled")
    where, why, way_out = tally.report(Path("a.h5"), resumed=0, already_whole=False).failure_summary
    assert where == (
        "4 of 27 cases not solved: 3 at speed_m_per_s = 4642.26, 1 at speed_m_per_s = 4782.26"
    )
    assert why == f"reasons: 4 × {Status.STALLED.sentence}"
    assert "--drop speed_m_per_s=4642.26 --drop speed_m_per_s=4782.26 keeps the other 9" in way_out
    tally.fail(1, Status.ERROR, b"Its worker process died 3 times, by SIGSEGV.")
    tally.fail(7, Status.ERROR, b"Its worker process died 3 times, by SIGSEGV.")
    tally.fail(14, Status.ERROR, b"Its worker process died 3 times, by SIGSEGV.")
    report = tally.report(Path("a.h5"), resumed=0, already_whole=False)
    assert "2 × Its" not in report.failure_summary[1]
    assert "3 × Its worker process died 3 times, by SIGSEGV." in report.failure_summary[1]
    assert "1 elsewhere" in report.failure_summary[0]
    assert "crop a.h5 --box keeps the largest box" in report.failure_summary[2]


def test_the_command_crops_and_says_what_is_left(small_database: Path, tmp_path: Path) -> None:
    path, output = tmp_path / "small.h5", tmp_path / "small-cropped.h5"
    path.write_bytes(small_database.read_bytes())
    words = ["crop", str(path), "--drop", "speed_m_per_s=4782.26", "-j", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0
    said = "6 of 9 cases, 6 of them solved; without speed_m_per_s = 4782.26"
    assert done.stdout == f"{output}: {said}\n"
    again = CliRunner().invoke(app, [*words, "--json"])
    assert json.loads(again.stdout)["build"]["already_whole"] is True
    guided = CliRunner().invoke(app, ["guide", str(output), "--speed", "4650", "--holes", "fly"])
    assert guided.exit_code == 0
    for words, message in (
        (["crop", str(path), "--drop", "speed"], "--drop: expected KEY=NUMBER, got 'speed'"),
        (
            ["crop", str(path), "--box"],
            "expected something to leave out, got a grid without a hole",
        ),
        (["guide", str(path), "--holes", "some"], "--holes: expected refuse or fly, got 'some'"),
    ):
        refused = CliRunner().invoke(app, words)
        assert refused.exit_code == 2
        assert message in refused.stderr
        assert len(refused.stderr.splitlines()) == 1
