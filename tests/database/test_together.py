"""Cases solved together: the records of cases solved alone, to the bit, whatever happens to them."""

from __future__ import annotations

import os
import signal
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest

import database
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.scp.solve import solve
from ampi.workers.supervisor import Supervisor
from database.factory.jobs import Kept, SolveCase, SolvePortion
from database.factory.stand_in import neighbour_moved
from database.factory.tasks import planned_tasks
from database.plan.continuation import layers, planned
from database.plan.prediction import corners
from database.records.campaign import Campaign, Solver
from database.records.reader import RecordReader
from database.records.record_files import count_records, nowhere, record_path, recorded_cases

BYTES = ("states", "bank_rate", "final_time", "cost", "target_multipliers", "status")


def quiet(attempt: int) -> None:
    """Nobody to announce it to."""


@pytest.fixture
def campaign(small_mission: Mission, tmp_path: Path) -> Campaign:
    """With the centre solved."""
    found = Campaign(small_mission.toml, tmp_path)
    SolveCase(found, first_layers(found)[0][0]).run(quiet)
    return found


def first_layers(campaign: Campaign) -> list[tuple[int, ...]]:
    return [tuple(planned.case for planned in layer) for layer in layers(campaign.grid)]


def where(kept: Kept) -> dict[int, int]:
    return {case: cases[0] for cases in kept for case in cases}


def numbers(reader: RecordReader, case: int) -> dict[str, object]:
    record = reader.record(case)
    found: dict[str, object] = {
        name: value.tobytes() if hasattr(value, "tobytes") else value
        for name, value in ((n, getattr(record.trajectory, n)) for n in BYTES)
    }
    counts = (record.trajectory.statistics.iterations, record.solves)
    return {**found, "message": record.message, "counts": counts}


@pytest.mark.parametrize("solver", [solve, neighbour_moved])
def test_in_a_portion_or_alone_the_records_are_the_same(
    small_mission: Mission, tmp_path: Path, solver: Solver
) -> None:
    one, alone = (Campaign(small_mission.toml, tmp_path / name, solver) for name in ("a", "b"))
    centre, *rest = first_layers(one)
    for campaign in (one, alone):
        campaign.folder.mkdir()
        SolveCase(campaign, centre[0]).run(quiet)
    kept: Kept = (centre,)
    for layer in rest:
        job = SolvePortion(one, layer, where(kept))
        assert job.cases == layer
        found = job.run(quiet)
        assert len(found) == 1
        assert job.evidence(found) == record_path(one.folder, found[0][0])
        left = job.left(found)
        assert len(left) <= len(layer) - len(layer) // 2
        kept += found
        for single in left:
            kept += single.run(quiet)
        for case in layer:
            SolveCase(alone, case).run(quiet)
    for layer in rest:
        for case in layer:
            assert numbers(RecordReader(one, where(kept)), case) == numbers(
                RecordReader(alone, {}), case
            )


def test_records_that_wait_long_are_flushed_before_the_portion_is_whole(
    small_mission: Mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("database.factory.jobs.FLUSH_AFTER", 0.0)
    campaign = Campaign(small_mission.toml, tmp_path, neighbour_moved)
    centre, layer, _ = first_layers(campaign)
    SolveCase(campaign, centre[0]).run(quiet)
    kept = SolvePortion(campaign, layer).run(quiet)
    assert kept == tuple((case,) for case in layer)
    files, damaged = recorded_cases(tmp_path, campaign.grid.size, "")
    assert (files[list(layer)] == layer).all()
    assert damaged == []


def test_what_newton_leaves_has_no_record(campaign: Campaign, tmp_path: Path) -> None:
    # At a bank limit that leaves little else: each of those beyond a portion's reach goes alone.
    tight = campaign.toml.replace("bank_angle_deg = 60.0", "bank_angle_deg = 40.0")
    assert tight != campaign.toml
    path = tmp_path / "tight.h5"
    report = database.build(parse_mission(tight), path, n_jobs=2)
    assert report.solved == 9
    tight = campaign.toml.replace("load_factor_g = 10.0", "load_factor_g = 8.2")
    assert tight != campaign.toml
    folder = tmp_path / "portion"
    folder.mkdir()
    other = Campaign(tight, folder)
    centre, first, _ = first_layers(other)
    SolveCase(other, centre[0]).run(quiet)
    job = SolvePortion(other, first)
    kept = job.run(quiet)
    assert 0 < len(job.left(kept)) < len(first)
    assert sorted([*where(kept), *(one.cases[0] for one in job.left(kept))]) == sorted(first)


def test_a_portion_that_is_given_up_or_overdue_leaves_its_cases(campaign: Campaign) -> None:
    job = SolvePortion(campaign, first_layers(campaign)[1])
    assert job.give_up("for a reason") == ()
    assert job.without(0).run(quiet) == ()
    assert job.left(()) == [SolveCase(campaign, case) for case in job.portion]


def test_of_a_portion_in_turn_the_case_that_is_overdue_alone_is_left(
    small_mission: Mission, tmp_path: Path
) -> None:
    campaign = Campaign(small_mission.toml, tmp_path, neighbour_moved)
    centre, layer, _ = first_layers(campaign)
    SolveCase(campaign, centre[0]).run(quiet)
    job = SolvePortion(campaign, layer).without(1)
    told = list[int]()
    kept = job.run(told.append)
    assert told == [0, 2, 3]
    assert job.left(kept) == [SolveCase(campaign, layer[1])]


def test_a_portion_whose_process_dies_is_left_in_the_end(campaign: Campaign) -> None:
    job = Deadly(campaign, first_layers(campaign)[1])
    supervisor = Supervisor("database.factory.jobs")
    kept = supervisor.run(job)
    supervisor.close()
    assert job.left(kept) == [SolveCase(campaign, case) for case in job.portion]


class Deadly(SolvePortion):
    """Kills its process."""

    def compute(self, announce: object) -> Future[Kept]:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


@pytest.mark.parametrize("solver", [solve, neighbour_moved])
def test_portions_follow_the_width(small_mission: Mission, solver: Solver) -> None:
    text = small_mission.toml + "azimuth_deg = [-0.5, 0.0, 0.5]\n"
    campaign = Campaign(text, Path("nowhere"), solver)
    files = nowhere(campaign.grid.size)
    tasks = [t for t in planned_tasks(campaign, files, 4) if t.job.cases]
    centre, *portions = tasks
    assert isinstance(centre.job, SolveCase)
    cases = [case for task in portions for case in task.job.cases]
    assert sorted(cases) == sorted(set(range(27)) - {13})
    assert max(len(task.job.cases) for task in portions) <= 6
    solved = set(centre.job.cases)
    for task in portions:
        assert isinstance(task.job, SolvePortion)
        here = planned(campaign.grid, np.array(task.job.portion))
        needed = {n for p in here for n in p.neighbours}
        needed |= {corner for p in here for _, corner in corners(campaign.grid, p.case)}
        assert set(task.needs.tolist()) == needed
        assert solved.issuperset(needed)
        solved.update(task.job.cases)
    files[0] = 0
    solving = [t.job for t in planned_tasks(campaign, files, 4) if t.job.cases]
    assert sorted(case for job in solving for case in job.cases) == sorted(set(range(27)) - {0})


def test_what_cannot_be_solved_together_is_left_to_be_tried_alone(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raises(*arguments: object) -> None:
        raise FloatingPointError("one of them")

    layer = first_layers(campaign)[1]
    monkeypatch.setattr("database.factory.jobs.solve_family", raises)
    assert SolvePortion(campaign, layer).run(quiet) == ()
    assert count_records(campaign.folder) == 1
