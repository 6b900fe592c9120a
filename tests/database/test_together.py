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
from ampi.trajectory import Trajectory
from ampi.workers.supervisor import Supervisor
from database.factory.jobs import AssembleBlock, SolveCase, SolveTogether
from database.factory.tasks import planned_tasks
from database.plan.continuation import PlannedCase, layers
from database.records.campaign import Campaign

BYTES = ("states", "bank_rate", "final_time", "cost", "target_multipliers", "status")


@pytest.fixture
def campaign(small_mission: Mission, tmp_path: Path) -> Campaign:
    """With the centre solved."""
    found = Campaign(small_mission.toml, tmp_path)
    SolveCase(found, layers(found.grid)[0][0]).run(lambda attempt: None)
    return found


def plan(campaign: Campaign) -> list[PlannedCase]:
    return [planned for layer in layers(campaign.grid)[1:] for planned in layer]


def numbers(campaign: Campaign, case: int) -> dict[str, object]:
    record = campaign.record(case)
    assert record is not None
    found: dict[str, object] = {
        name: value.tobytes() if hasattr(value, "tobytes") else value
        for name, value in ((n, getattr(record.trajectory, n)) for n in BYTES)
    }
    counts = (record.trajectory.statistics.iterations, record.solves)
    return {**found, "message": record.message, "counts": counts}


def test_together_or_alone_the_records_are_the_same(campaign: Campaign, tmp_path: Path) -> None:
    alone = Campaign(campaign.toml, tmp_path / "alone")
    alone.folder.mkdir()
    SolveCase(alone, layers(alone.grid)[0][0]).run(lambda attempt: None)
    for layer in layers(campaign.grid)[1:]:
        job = SolveTogether(campaign, tuple(layer))
        assert job.cases == tuple(planned.case for planned in layer)
        job.run(lambda attempt: None)
        left = job.left()
        assert len(left) <= len(layer) - len(layer) // 2
        for one in left:
            one.run(lambda attempt: None)
        for planned in layer:
            SolveCase(alone, planned).run(lambda attempt: None)
    for planned in plan(campaign):
        assert numbers(campaign, planned.case) == numbers(alone, planned.case)


def test_what_newton_leaves_has_no_record(campaign: Campaign, tmp_path: Path) -> None:
    # At a bank limit that the family touches: portions solve the others, each of these goes alone.
    tight = campaign.toml.replace("bank_angle_deg = 60.0", "bank_angle_deg = 47.5")
    assert tight != campaign.toml
    path = tmp_path / "tight.h5"
    report = database.build(parse_mission(tight), path, n_jobs=2)
    assert report.solved == 9
    folder = tmp_path / "portion"
    folder.mkdir()
    other = Campaign(tight, folder)
    SolveCase(other, layers(other.grid)[0][0]).run(lambda attempt: None)
    first = layers(other.grid)[1]
    job = SolveTogether(other, tuple(first))
    job.run(lambda attempt: None)
    assert 0 < len(job.left()) < len(first)


def test_a_portion_that_is_given_up_or_overdue_leaves_its_cases(campaign: Campaign) -> None:
    job = SolveTogether(campaign, tuple(plan(campaign)[:4]))
    job.give_up("for a reason")
    job.without(0).run(lambda attempt: None)
    assert job.left() == [SolveCase(campaign, planned) for planned in job.planned]


def test_a_portion_whose_process_dies_is_left_in_the_end(campaign: Campaign) -> None:
    job = Deadly(campaign, tuple(plan(campaign)[:4]))
    supervisor = Supervisor("database.factory.jobs")
    supervisor.run(job)
    supervisor.close()
    assert job.left() == [SolveCase(campaign, planned) for planned in job.planned]


class Deadly(SolveTogether):
    """Kills its process."""

    def compute(self, announce: object) -> Future[None]:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


def test_portions_follow_the_width_and_other_optimisers_go_alone(small_mission: Mission) -> None:
    text = small_mission.toml + "azimuth_deg = [-0.5, 0.0, 0.5]\n"
    campaign = Campaign(text, Path("nowhere"))
    nothing = np.zeros(campaign.grid.size, dtype=bool)
    tasks = [t for t in planned_tasks(campaign, nothing, 4) if t.job.cases]
    centre, *portions = tasks
    assert isinstance(centre.job, SolveCase)
    cases = [case for task in portions for case in task.job.cases]
    assert sorted(cases) == sorted(p.case for p in plan(campaign))
    assert max(len(task.job.cases) for task in portions) <= 6
    solved = set(centre.job.cases)
    for task in portions:
        assert isinstance(task.job, SolveTogether)
        assert set(task.needs) == {n for p in task.job.planned for n in p.neighbours}
        assert solved.issuperset(task.needs)
        solved.update(task.job.cases)
    other = Campaign(text, Path("nowhere"), another_optimiser)
    kept = nothing.copy()
    kept[0] = True
    solving = [t.job for t in planned_tasks(other, kept, 4) if not isinstance(t.job, AssembleBlock)]
    assert len(solving) == 26
    assert all(isinstance(job, SolveCase) for job in solving)


def another_optimiser(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    return solve(mission, guess=guess)


def test_many_flight_models_are_solved_one_by_one(small_mission: Mission) -> None:
    factors = "density_factor = [-0.1, -0.05, 0.0, 0.05, 0.1]\nlift_factor = [-0.1, 0.0, 0.1]\n"
    few = Campaign(small_mission.toml + factors, Path("nowhere"))
    many = Campaign(f"{few.toml}drag_factor = [-0.1, 0.0, 0.1]\n", Path("nowhere"))
    assert few.together
    assert not many.together


def test_what_cannot_be_solved_together_is_left_to_be_tried_alone(
    campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raises(*arguments: object) -> None:
        raise FloatingPointError("one of them")

    planned = tuple(layers(campaign.grid)[1])
    monkeypatch.setattr("database.factory.jobs.solve_family", raises)
    SolveTogether(campaign, planned).run(lambda attempt: None)
    assert [campaign.record(p.case) for p in planned] == [None] * len(planned)
