"""What the first pass leaves is tried again from all sides, and no kill or worker leaves a trace."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import database
from ampi.dataset import partial_folder, read_dataset
from ampi.missions.mission import Mission
from ampi.trajectory import Status
from database.factory.attempts import Attempt, attempts, is_vain
from database.factory.second_pass import nearby
from database.plan.grid import Grid
from database.records.record_files import again_folder, block_path, record_path
from database.rerun import rerun


@pytest.fixture
def misbehaving(small_database: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).parent)
    monkeypatch.setenv("AMPI_TEST_DATABASE", str(small_database))
    import misbehaving

    return misbehaving


def test_a_case_is_solved_from_one_that_was_solved_after_it(
    small_mission: Mission, misbehaving: ModuleType, tmp_path: Path
) -> None:
    """Case 7 from case 6, which lies farther from the centre; then case 8 from case 7."""
    path = tmp_path / "a.h5"
    report = database.build(small_mission, path, n_jobs=2, solver=misbehaving.roundabout)
    assert (report.solved, report.failures) == (9, ())
    messages = [m.decode() for m in read_dataset(path).message.ravel()]
    assert messages[7] == f"again from case 6 in 1 step(s): {Status.SOLVED.sentence}"
    assert messages[8] == f"again from case 7 in 1 step(s): {Status.SOLVED.sentence}"
    assert sum("again" in message for message in messages) == 2
    assert not partial_folder(path).exists()
    found = rerun(path, 7, solver=misbehaving.roundabout)
    assert found.trajectory.status.ok
    assert found.attempts[-1].attempt == "from case 6 in 1 step(s)"


def test_a_second_pass_goes_on_where_it_was_stopped(
    small_mission: Mission, misbehaving: ModuleType, tmp_path: Path, monkeypatch: Any
) -> None:
    undisturbed, path = tmp_path / "undisturbed.h5", tmp_path / "a.h5"
    options = {"solver": misbehaving.roundabout, "n_jobs": 1}
    database.build(small_mission, undisturbed, **options)
    with monkeypatch.context() as patch:
        patch.setattr("database.file.writer.write_dataset", lambda *_, **options: 1 // 0)
        with pytest.raises(ZeroDivisionError):
            database.build(small_mission, path, **options)
    folder = partial_folder(path)
    first, second = again_folder(folder, 1), again_folder(folder, 2)
    assert record_path(first, 7).exists()
    assert not record_path(second, 7).exists()
    damaged = record_path(first, 7).read_bytes()
    record_path(first, 7).write_bytes(damaged[:-1] + bytes([damaged[-1] ^ 1]))
    record_path(second, 8).unlink()
    block_path(second, 0).unlink()
    report = database.build(small_mission, path, **options)
    assert (report.resumed, report.solved) == (9, 9)
    assert path.read_bytes() == undisturbed.read_bytes()
    assert not folder.exists()


def test_what_lies_nearby_differs_on_one_axis_or_two(small_mission: Mission) -> None:
    grid = Grid.from_mission(small_mission)
    for case in range(grid.size):
        here = np.array(np.unravel_index(case, grid.shape))
        found = dict(nearby(grid, case))
        there = {c: np.abs(np.unravel_index(c, grid.shape) - here) for c in range(grid.size)}
        assert sorted(found) == [c for c, step in there.items() if c != case and step.max() == 1]
    assert list(nearby(grid, 7)) == [(4, True), (6, False), (8, False), (3, True), (5, True)]
    assert dict(nearby(grid, 8))[4]


def test_a_branch_that_ends_is_followed_once(small_mission: Mission) -> None:
    ways = attempts([1, 2], predicted=True)
    missed, stalled = Status.TARGET_MISSED, Status.STALLED

    def made(ended: list[Status | None]) -> list[Attempt]:
        return [way for way in ways if not is_vain(way, ways, ended)]

    short, nothing = Attempt(1, 4), Attempt(None)
    assert made([missed, missed, Status.LIMITS_EXCEEDED]) == [*ways[:3], short, nothing]
    for other in (stalled, None):
        assert made([missed, missed, other]) == ways
    assert attempts([], predicted=False) == [nothing]
    assert not is_vain(nothing, [nothing], [])
