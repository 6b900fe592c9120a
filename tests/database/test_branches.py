"""Two branches in one family are told apart by degrees, kilometres and continuation, and mended."""

from __future__ import annotations

import dataclasses
import importlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

import ampi
import database
from ampi.cli import app
from ampi.dataset import TrajectoryDataset, read_dataset
from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission
from ampi.trajectory import Trajectory
from database.audit.branches import (
    SETTINGS,
    Branches,
    _position_error,
    astray,
    branches,
    halfway,
    same_optimum,
    suspects,
)
from database.audit.coherence import coherence
from database.build_report import BuildReport
from database.building import KnownOptimum
from database.file.encoded_block import stations
from database.plan.grid import Grid
from database.repair import Move, repair

Array = NDArray[np.float64]

CHANGED = {
    "\nlongitude_deg = -11.6": "\nlongitude_deg = 0.0",
    "\nlatitude_deg = 71.89": "\nlatitude_deg = 0.0",
    "\nazimuth_deg = -85.92": "\nazimuth_deg = -90.0",
    "\nlongitude_deg = -45.75": "\nlongitude_deg = -13.0",
    "\nlatitude_deg = 66.4": "\nlatitude_deg = -1.0",
}


@pytest.fixture(scope="module")
def retrograde() -> Mission:
    """SHEFEX-3 flown westward along the equator: four optima reach the target in the nominal case.

    One enters to the left and costs half as much as another that enters to the right; it exists in all
    four cases, the other not in case 0. A third enters to the right too, and costs half as much.
    """
    text, _, _ = load_mission("shefex3").toml.partition("[grid]")
    for there, here in CHANGED.items():
        assert text.count(there) == 1
        text = text.replace(there, here)
    axes = "speed_m_per_s = [-70.0, 0.0]\nflight_path_angle_deg = [-0.5, 0.0]\n"
    return parse_mission(f"{text}[grid]\n{axes}")


def bank(degrees: float) -> ampi.ConstantBank:
    return ampi.ConstantBank(np.radians(degrees))


def mirrored(flight: Trajectory) -> Trajectory:
    """On the other side of the equator, from an entry due west."""
    states = flight.states.copy()
    states[[2, 6]] *= -1.0
    states[5] = -np.pi - states[5]
    return dataclasses.replace(flight, states=states, bank_rate=-flight.bank_rate)


@pytest.fixture(scope="module")
def mixed(
    retrograde: Mission, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, BuildReport]:
    """Its database with case 0 on the left branch, the others on the right one."""
    grid, known = Grid.from_mission(retrograde), dict[int, KnownOptimum]()
    right = ampi.solve(retrograde, guess=mirrored(ampi.solve(retrograde, guess=bank(-30.0))))
    for case in range(4):
        here = retrograde.with_parameters(grid.point(case))
        guess = right if case else bank(10.0)
        known[case] = KnownOptimum(ampi.solve(here, guess=guess), "planted")
    path = tmp_path_factory.mktemp("mixed") / "mixed.h5"
    report = database.build(retrograde, path, n_jobs=1, known=known)
    assert (report.solved, report.resumed) == (4, 4)
    return path, report


@pytest.fixture(scope="module")
def found(mixed: tuple[Path, BuildReport]) -> Branches:
    dataset = read_dataset(mixed[0])
    return branches(dataset.mission, optima_of(dataset))


def optima_of(dataset: TrajectoryDataset) -> dict[int, Trajectory]:
    return {int(c): dataset.trajectory(int(c)) for c in np.flatnonzero(dataset.solved.ravel())}


def test_the_case_of_the_other_branch_is_named(
    mixed: tuple[Path, BuildReport], found: Branches
) -> None:
    (branch,) = found.astray
    assert branch.cases == found.cases == (0,)
    assert np.degrees(branch.bank_at_entry) == pytest.approx([-18.9, -18.9], abs=0.2)
    assert np.degrees(found.main_bank_at_entry) == pytest.approx([12.2, 19.0], abs=0.2)
    assert branch.cost_ratio == pytest.approx(0.47, abs=0.01)
    assert sorted(found.parted) == [(0, 1), (0, 2)]
    assert found.worst_pair in found.parted
    assert found.worst_flown == pytest.approx(52.6e3, rel=0.02)
    smooth = coherence(read_dataset(mixed[0]))  # two points an axis: nothing to difference
    assert (smooth.triples, smooth.outliers) == (0, ())
    assert np.isnan(smooth.roughness).all()


def test_a_branch_that_enters_alike_is_another_all_the_same(
    mixed: tuple[Path, BuildReport], retrograde: Mission
) -> None:
    """It turns later, and costs half as much; without case 0 it has no second neighbour."""
    optima, grid = optima_of(read_dataset(mixed[0])), Grid.from_mission(retrograde)
    del optima[0]
    here = retrograde.with_parameters(grid.point(1))
    other = ampi.solve(here, guess=bank(-20.0))
    assert other.states[6, 0] == pytest.approx(optima[1].states[6, 0], abs=np.radians(1.0))
    assert other.cost < 0.5 * optima[1].cost
    assert branches(retrograde, optima).cases == ()
    optima[1] = other
    banks = np.full((4, 4), np.nan)
    for case, optimum in optima.items():
        banks[case] = stations(optimum.states)
    assert branches(retrograde, optima).cases == tuple(suspects(grid, banks)) == (1,)


def test_the_build_says_so(mixed: tuple[Path, BuildReport], small_database: Path) -> None:
    path, report = mixed
    assert report.suspects == (0,)
    (doubt,) = report.doubts
    assert doubt.startswith("1 case may lie on another branch than the rest")
    assert doubt.endswith(f"ampi audit {path} --repair")
    smooth = read_dataset(small_database)
    assert suspects(Grid.from_mission(smooth.mission), stations(smooth.states)) == []


def test_a_repair_brings_all_onto_the_branch_that_exists_everywhere(
    mixed: tuple[Path, BuildReport], tmp_path: Path
) -> None:
    """Not onto the nominal one: it does not exist in case 0. The one that does costs half as much."""
    path = tmp_path / "mended.h5"
    shutil.copy(mixed[0], path)
    before = read_dataset(path)
    done = repair(path, n_jobs=1)
    assert [(type(one), one.case, one.replaced) for one in done] == [
        (Move, case, True) for case in (1, 2, 3)
    ]
    after = read_dataset(path)
    assert np.all(after.states[..., 6, 0] < np.radians(-15.0))
    assert after.cost.sum() < 0.6 * before.cost.sum()
    assert np.array_equal(after.states[0, 0], before.states[0, 0])
    measured = branches(after.mission, optima_of(after))
    assert measured.cases == ()
    assert measured.worst_flown < 2e3
    assert suspects(Grid.from_mission(after.mission), stations(after.states)) == []
    whole = path.read_bytes()
    assert repair(path, n_jobs=1) == ()
    assert path.read_bytes() == whole


def test_audit_and_report_say_it_in_words_and_in_numbers(
    mixed: tuple[Path, BuildReport], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, command = str(mixed[0]), CliRunner()
    monkeypatch.setattr(
        importlib.import_module("database.audit.audit"), "error_map", lambda *a, **k: ()
    )  # solves
    audited = command.invoke(app, ["audit", path, "--probes", "0", "-j", "1"])
    words = " ".join(audited.stdout.split())
    assert "coherence: unknown, no axis has three points in a row with a solution" in words
    assert "another branch: case 0; bank at entry -18.9 deg, of the rest 12.2 … 19.0 deg" in words
    assert "--repair" in words
    options = ["--probes", "0", "-j", "1", "--json"]
    numbers = json.loads(command.invoke(app, ["audit", path, *options]).stdout)
    assert numbers["coherence"]["roughness"] == [None] * 4
    assert numbers["branches"]["astray"][0]["cases"] == [0]
    for exhibits in ("campaign_exhibits", "database_exhibits"):  # the figures are not the point
        monkeypatch.setattr(importlib.import_module("ampi.report.html"), exhibits, lambda *a: ())
    flights, page = str(tmp_path / "f.h5"), tmp_path / "report.html"
    flown = command.invoke(
        app, ["fly", path, "-n", "4", "--modes", "ampi", "-j", "1", "--output", flights]
    )
    assert flown.exit_code == 0
    assert command.invoke(app, ["report", path, flights, "--output", str(page)]).exit_code == 0
    assert "1 case may lie on another branch than the rest" in page.read_text(encoding="utf-8")


@pytest.fixture
def line(small_mission: Mission) -> Grid:
    """Four points of speed, unevenly far from each other."""
    others, _, _ = small_mission.toml.partition("[grid]")
    return Grid.from_mission(
        parse_mission(f"{others}[grid]\nspeed_m_per_s = [-70.0, 0.0, 35.0, 140.0]\n")
    )


@pytest.mark.parametrize(
    ("degrees", "named"),
    [
        ([-40.0, 30.0, 65.0, 170.0], []),  # steep, and straight
        ([10.0, 10.0, 12.0, 80.0], [3]),  # nothing leads there
        ([10.0, 12.0, -24.0, -25.0], [2, 3]),
        ([np.nan, 10.0, 12.0, 13.0], []),  # unsolved
        ([10.0, 12.0, np.nan, -25.0], []),  # nobody knows
        ([170.0, 178.0, -178.0, -174.0], []),  # four degrees apart
        ([10.0, 12.0, 372.0, 14.0], []),  # a turn more
    ],
)
def test_a_jump_of_the_bank_angle_at_entry_is_suspected(
    line: Grid, degrees: list[float], named: list[int]
) -> None:
    at_entry = np.radians(degrees)[:, None]
    assert suspects(line, at_entry) == named
    assert suspects(line, at_entry * [0.0, 0.0, 1.0, 0.0]) == named  # or later


def test_who_is_astray(small_mission: Mission) -> None:
    grid, solved = Grid.from_mission(small_mission), np.ones(9, dtype=bool)
    assert astray(grid, solved, np.empty((0, 2), dtype=int)) == []
    corner = np.array([[1, 2], [2, 5]])
    assert astray(grid, solved, corner) == [[2]]
    half = np.array([[0, 1], [3, 4], [6, 7]])
    assert astray(grid, solved, half) == [[0, 3, 6]]
    assert astray(grid, solved, half[:1]) == [[0]]  # a fold: the two hang together round its end
    holes = solved.copy()
    holes[[3, 4, 5]] = False  # what failures cut off is on no known branch
    assert astray(grid, holes, np.array([[7, 8]])) == [[8]]
    assert astray(grid, solved, np.concatenate([corner, half])) == [[0, 3, 6], [2]]
    equal = np.array([[0, 1], [1, 4], [2, 5], [3, 6], [4, 7], [5, 8]])
    assert 4 not in [case for group in astray(grid, solved, equal) for case in group]


@pytest.mark.parametrize(("step", "named"), [(19.9, []), (20.1, [0])])
def test_twenty_degrees_are_a_jump(small_mission: Mission, step: float, named: list[int]) -> None:
    """On an axis of two points, where no line leads anywhere; the nominal case is never the one."""
    others, _, _ = small_mission.toml.partition("[grid]")
    grid = Grid.from_mission(parse_mission(f"{others}[grid]\nspeed_m_per_s = [-70.0, 0.0]\n"))
    assert suspects(grid, np.radians([[10.0], [10.0 + step]])) == named


@pytest.mark.parametrize(("share", "unlike"), [(0.45, 2), (0.6, 0)])
def test_half_the_cost_is_unlike(small_database: Path, share: float, unlike: int) -> None:
    """A corner's cost, with its flight as it is: flown halfway it is joined all the same."""
    dataset = read_dataset(small_database)
    optima = optima_of(dataset)
    optima[0] = dataclasses.replace(optima[0], cost=share * optima[0].cost)
    measured = branches(dataset.mission, optima)
    assert (measured.unlike, measured.parted) == (unlike, ())


def turned(optimum: Trajectory, degrees: float) -> Trajectory:
    states = optimum.states.copy()
    states[6] += np.radians(degrees)
    return dataclasses.replace(optimum, states=states)


def test_two_sheets_that_meet_are_parted_where_they_are_unlike(
    small_database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Round the grid in steps of 12 degrees, and a step of 84 from the last case to the first."""
    dataset = read_dataset(small_database)
    ring = [0, 1, 2, 5, 8, 7, 6, 3]
    optimum = dataset.trajectory(0)  # the same one, turned
    optima = {case: turned(optimum, 12.0 * k) for k, case in enumerate(ring)}
    monkeypatch.setattr(
        database.audit.branches, "_position_error", lambda m, p, f: np.full(len(f), 2e4)
    )
    monkeypatch.setattr(database.audit.branches, "continued", lambda *arguments: None)
    found = branches(dataset.mission, optima)
    assert (found.unlike, found.parted) == (1, ((0, 3),))
    assert found.cases == (0,)  # the farther one from the hypercentre
    monkeypatch.setattr(
        database.audit.branches, "continued", lambda a, b, goal, optimum: optima[goal]
    )
    assert branches(dataset.mission, optima).parted == ()


def test_one_flight_into_the_ground_leaves_the_others_their_errors(small_database: Path) -> None:
    """The integrator steps all of them together, and stops where it finds no step for one."""
    dataset = read_dataset(small_database)
    good, grid = dataset.trajectory(0), Grid.from_mission(dataset.mission)
    states = good.states.copy()
    states[6] = np.pi  # lift downwards
    flights = [good, dataclasses.replace(good, states=states, final_time=900.0)]
    error = _position_error(dataset.mission, grid.points()[[0, 0]], flights)
    assert error[0] < 10.0
    assert error[1] == np.inf


def test_no_more_pairs_are_followed_than_it_takes(
    small_database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between two branches three pairs at most, each from both ends; one arrival is proof enough."""
    dataset = read_dataset(small_database)
    optima = {case: turned(dataset.trajectory(1), 40.0 * (case % 3 == 0)) for case in range(9)}
    followed = []
    monkeypatch.setattr(
        database.audit.branches, "_position_error", lambda m, p, f: np.full(len(f), 2e4)
    )

    def ends(campaign: object, case: int, goal: int, optimum: Trajectory) -> None:
        followed.append((case, goal))

    monkeypatch.setattr(database.audit.branches, "continued", ends)
    monkeypatch.setattr(
        database.audit.branches, "SETTINGS", dataclasses.replace(SETTINGS, followed=2)
    )
    found = branches(dataset.mission, optima)
    assert found.cases == (0, 3, 6)
    assert sorted(found.parted) == [(0, 1), (3, 4), (6, 7)]
    assert len(followed) == 4
    followed.clear()

    def elsewhere(campaign: object, case: int, goal: int, optimum: Trajectory) -> Trajectory:
        followed.append((case, goal))
        return optimum  # followed without a jump, to what does not stand there

    monkeypatch.setattr(database.audit.branches, "continued", elsewhere)
    assert branches(dataset.mission, optima).cases == (0, 3, 6)
    assert len(followed) == 2


def test_two_optima_are_the_same_by_bank_angle_and_cost(small_database: Path) -> None:
    one = read_dataset(small_database).trajectory(0)
    assert same_optimum(one, one)
    turned = one.states.copy()
    turned[6] += 2.0 * np.pi
    assert same_optimum(one, dataclasses.replace(one, states=turned))
    turned[6] += 1.01 * SETTINGS.bank
    assert not same_optimum(one, dataclasses.replace(one, states=turned))
    for gap, same in ((0.049, True), (0.051, False)):
        cheaper = dataclasses.replace(one, cost=one.cost * (1.0 - gap))
        assert same_optimum(one, cheaper) is same
    free = dataclasses.replace(one, cost=0.0)
    assert same_optimum(free, free)


def test_halfway_is_between_two_flights_whatever_turn_they_are_on(small_database: Path) -> None:
    dataset = read_dataset(small_database)
    one, other = dataset.trajectory(0), dataset.trajectory(1)
    turned = other.states.copy()
    turned[[1, 5, 6]] -= 2.0 * np.pi
    middle = halfway(one, dataclasses.replace(other, states=turned))
    assert middle.states == pytest.approx(0.5 * (one.states + other.states), abs=1e-9)
    assert middle.final_time == 0.5 * (one.final_time + other.final_time)


def test_a_smooth_family_holds_together_and_nothing_is_solved(
    small_database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unwanted(*arguments: object) -> None:
        raise AssertionError("expected no solve of a family without unlike neighbours")

    monkeypatch.setattr(database.audit.branches, "continued", unwanted)
    dataset = read_dataset(small_database)
    measured = branches(dataset.mission, optima_of(dataset))
    assert (measured.pairs, measured.unlike, measured.flown, measured.astray) == (12, 0, 12, ())
    assert 1e3 < measured.worst_flown < SETTINGS.flown
    status = dataset.status.copy()
    status.ravel()[[1, 3]] = 7
    holes = dataclasses.replace(dataset, status=status)
    assert branches(holes.mission, optima_of(holes)).pairs == 6
