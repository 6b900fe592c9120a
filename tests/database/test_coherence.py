"""Second differences over the grid: laws on synthetic families, then a case of the other branch."""

from __future__ import annotations

import dataclasses
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import ampi
import database
from ampi.dataset import DIGEST, TrajectoryDataset, partial_folder, read_dataset
from ampi.loading import load_guidance
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.physics.state import CIRCULAR_STATES
from ampi.tracker_design.riccati_gains import GainSettings
from database.audit.coherence import (
    RESOLUTION,
    THRESHOLD,
    case_roughness,
    chord_misses,
    coherence,
    family_rows,
    family_scale,
)
from database.building import KnownOptimum
from database.factory.stand_in import neighbour_moved
from database.plan.grid import Grid
from database.records.campaign import BuildError
from database.repair import repair

Array = NDArray[np.float64]

steps = st.lists(st.floats(0.1, 3.0), min_size=2, max_size=5)


@settings(deadline=None, max_examples=50)
@given(steps=steps, a=st.floats(-5, 5), b=st.floats(-5, 5), c=st.floats(-5, 5))
def test_a_parabola_misses_its_chord_by_the_divided_difference(
    steps: list[float], a: float, b: float, c: float
) -> None:
    """Eq. (1) on uneven axes: f[a, b, c] of a + b p + c p² is c."""
    p = np.cumsum([0.7, *steps])
    miss = chord_misses(p, (a + b * p + c * p * p)[:, None, None])[:, 0]
    expected = np.abs(c) * (p[1:-1] - p[:-2]) * (p[2:] - p[1:-1])
    assert miss == pytest.approx(expected, abs=1e-10)


def synthetic(dataset: TrajectoryDataset, seed: int = 5) -> TrajectoryDataset:
    """A smooth family over the dataset's own grid, curved in every direction, its angles by radians."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, n) for n in dataset.shape], indexing="ij"))
    shape = dataset.states.shape[-2:]
    states = np.zeros(dataset.states.shape)
    for one in grid:
        states += one[..., None, None] * rng.standard_normal(shape)
        states += (one**2)[..., None, None] * rng.uniform(0.5, 1.0, shape)
    states[..., list(CIRCULAR_STATES), :] *= 0.1
    return dataclasses.replace(dataset, states=states)


@pytest.mark.parametrize("case", range(9))
def test_one_jump_is_blamed_on_the_case_that_jumped(small_database: Path, case: int) -> None:
    smooth = synthetic(read_dataset(small_database))
    assert coherence(smooth).outliers == ()
    states = smooth.states.copy()
    states.reshape(9, 7, -1)[case, 3] += 200.0
    jumped = dataclasses.replace(smooth, states=states)
    found = coherence(jumped)
    assert [o.case for o in found.outliers] == [case]
    index = found.outliers[0].index
    again = case_roughness(jumped.axes, family_rows(jumped), index, found)
    assert again == pytest.approx(found.outliers[0].roughness)


@pytest.mark.parametrize("jump", [None, 1, 5])  # the middle would spoil three triples of five
def test_an_uneven_axis_accuses_nobody_but_the_case_that_jumped(
    small_database: Path, small_mission: Mission, jump: int | None
) -> None:
    """A parabola misses wide chords by more: Eq. (2a) expects it. 18 to 58 on the scale of Eq. (2)."""
    offsets = [-150.0, -5.0, -2.5, 0.0, 2.5, 5.0, 150.0]
    text = small_mission.toml[: small_mission.toml.index("[grid]")]
    mission = parse_mission(f"{text}[grid]\nspeed_m_per_s = {offsets}\n")
    small = read_dataset(small_database)
    p = np.array(offsets)
    states = p[:, None, None] ** 2 * np.ones(small.states.shape[-2:])
    states[:, list(CIRCULAR_STATES)] *= 1e-5
    if jump is not None:
        states[jump, 3] += 1e4
    family = dataclasses.replace(
        small,
        mission=mission,
        axes=mission.grid_axes,
        states=states,
        final_time=600.0 + p,
        status=np.zeros(len(p), dtype=int),
        peak=np.zeros((len(p), small.peak.shape[-1])),
    )
    found = coherence(family)
    assert bool(found.outliers) is (jump is not None)
    if jump is None:
        assert found.worst.max() == pytest.approx(1.0)
    else:
        assert abs(found.outliers[0].case - jump) <= 1  # a single line: the blame is a guess


def test_what_convergence_leaves_is_no_roughness(small_database: Path) -> None:
    """A parameter without effect: its optima differ by the last digits of the solver, at random."""
    dataset = read_dataset(small_database)
    noise = 1.0 + 1e-7 * np.random.default_rng(3).standard_normal(dataset.states.shape)
    noise[1, 1] = 1.0 + 1e-5 * (noise[1, 1] - 1.0)
    states = np.broadcast_to(dataset.states[1, 1], dataset.states.shape) * noise
    found = coherence(
        dataclasses.replace(dataset, states=states, final_time=np.full((3, 3), 600.0))
    )
    assert found.worst.max() < 1.0


def test_a_failed_case_takes_no_part(small_database: Path) -> None:
    smooth = synthetic(read_dataset(small_database))
    states = smooth.states.copy()
    states[0, 0] = np.nan
    found = coherence(dataclasses.replace(smooth, states=states))
    assert found.outliers == ()
    assert np.argwhere(np.isnan(found.roughness)).tolist() == [[0, 0]]


def test_the_scale_of_a_family_is_the_median_and_1_4826_mad_of_its_misses() -> None:
    """Eq. (2), and what convergence leaves of each row's range at least."""
    misses = np.array([1.0, 2.0, 3.0, 5.0, 100.0])[:, None, None] * [1.0, 2.0]
    rows = np.zeros((4, 2, 3))
    assert family_scale([misses[:, 0], 0.5 * misses[:, 0]], rows) == pytest.approx(
        [3.0 + 1.4826 * 2.0, 6.0 + 1.4826 * 4.0]
    )
    rows[0, 1] = 2e6
    assert family_scale([misses[:, 0]], rows) == pytest.approx(
        [3.0 + 1.4826 * 2.0, RESOLUTION * 2e6]
    )


@pytest.mark.parametrize(("share", "named"), [(0.99, 0), (1.01, 1)])
def test_a_case_stands_out_above_the_threshold(
    small_database: Path, share: float, named: int
) -> None:
    """Speeds that miss every chord by 1 m/s, which is s then; a corner's by a share of the threshold."""
    smooth = synthetic(read_dataset(small_database))
    states = smooth.states.copy()
    states[..., 3, :] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])[..., None]
    states[0, 0, 3] += 2.0 * (1.0 + share * THRESHOLD)
    found = coherence(dataclasses.replace(smooth, states=states))
    assert found.scale[3] == pytest.approx(1.0)
    assert found.roughness[0, 0] == pytest.approx(share * THRESHOLD)
    assert len(found.outliers) == named


@pytest.mark.parametrize(("use", "limit"), [(0.9996, "load_factor"), (0.9994, None)])
def test_a_limit_acts_from_0_9995_on(small_database: Path, use: float, limit: str | None) -> None:
    smooth = synthetic(read_dataset(small_database))
    states, peak = smooth.states.copy(), np.full_like(smooth.peak, 0.5)
    states[0, 2, 3] += 200.0
    peak[0, 2, 2] = use
    (outlier,) = coherence(dataclasses.replace(smooth, states=states, peak=peak)).outliers
    assert (outlier.index, outlier.limit) == ((0, 2), limit)


def test_a_turn_more_is_the_same_angle(small_database: Path) -> None:
    """Of longitude, azimuth and bank angle of one case, and nothing else."""
    dataset = read_dataset(small_database)
    states = dataset.states.copy()
    states[1, 2, list(CIRCULAR_STATES)] += 2.0 * np.pi
    assert CIRCULAR_STATES == (1, 5, 6)
    before, after = coherence(dataset), coherence(dataclasses.replace(dataset, states=states))
    assert after.worst == pytest.approx(before.worst, rel=1e-6)
    assert after.outliers == ()


def test_what_no_triple_measures_is_unknown(small_database: Path) -> None:
    """Never 0, which is as smooth as can be: two points, or every triple of a case hidden."""
    dataset = read_dataset(small_database)
    states, final_time = dataset.states.copy(), dataset.final_time.copy()
    states[1, :], final_time[1, :] = np.nan, np.nan
    states[:, 1], final_time[:, 1] = np.nan, np.nan
    hidden = coherence(dataclasses.replace(dataset, states=states, final_time=final_time))
    assert hidden.triples == 0
    assert np.isnan(hidden.roughness).all()
    assert np.isnan(hidden.worst).all()
    states[:, 0], final_time[:, 0] = dataset.states[:, 0], dataset.final_time[:, 0]
    one_line = coherence(dataclasses.replace(dataset, states=states, final_time=final_time))
    assert one_line.triples == 1
    assert np.isfinite(one_line.roughness).tolist() == [[True, False, False]] * 3


def test_the_family_of_the_mission_is_smooth(small_database: Path) -> None:
    found = coherence(read_dataset(small_database))
    assert found.triples == 6
    assert found.worst.max() < 0.2 * THRESHOLD
    assert found.outliers == ()


def test_a_case_bent_by_a_limit_is_named_with_it_and_kept(
    small_mission: Mission, tmp_path: Path
) -> None:
    """One optimum for every limit that does not act: where it begins to, no line is straight."""
    others, _, _ = small_mission.toml.partition("[grid]")
    axis = "[grid]\nlimits.heat_flux_MW_per_m2 = [-1.8, -1.7, -1.6, -1.5, 0.0, 1.0, 2.0]\n"
    path = tmp_path / "limited.h5"
    assert database.build(parse_mission(others + axis), path).solved == 7
    before = path.read_bytes()
    (outlier,) = coherence(read_dataset(path)).outliers
    assert (outlier.case, outlier.limit) == (0, "heat_flux")
    (done,) = repair(path)
    assert not done.replaced
    assert path.read_bytes() == before


@pytest.fixture(scope="module")
def planted(
    small_mission: Mission, small_database: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The small database with one corner on the branch of −30 degrees of bank."""
    dataset, grid = read_dataset(small_database), Grid.from_mission(small_mission)
    known = {case: KnownOptimum.of(dataset, case) for case in range(9)}
    other = ampi.solve(
        small_mission.with_parameters(grid.point(2)), guess=ampi.ConstantBank(np.radians(-30.0))
    )
    assert other.status.ok
    assert np.sign(other.states[6, 0]) != np.sign(dataset.states[0, 2, 6, 0])
    known[2] = KnownOptimum(other, "planted")
    path = tmp_path_factory.mktemp("planted") / "planted.h5"
    report = database.build(
        small_mission,
        path,
        n_jobs=1,
        known=known,
        time_limit=30.0,
        gains=GainSettings(horizontal_miss=1500.0),
    )
    assert report.resumed == 9
    return path


def test_a_repair_that_is_killed_leaves_the_file_and_begins_anew(
    planted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.h5"
    shutil.copy(planted, path)

    def killed(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("database.building.write_database", killed)
        with pytest.raises(KeyboardInterrupt):
            repair(path, n_jobs=1)
    assert path.read_bytes() == planted.read_bytes()
    load_guidance(path)
    with pytest.raises(
        ValueError, match=r"solved by ampi\.scp\.solve\.solve, got database\.factory\.stand_in"
    ):
        repair(path, solver=neighbour_moved)
    (done,) = repair(path, n_jobs=1)
    assert done.replaced
    before, after = read_dataset(planted).attributes, read_dataset(path).attributes
    differing = {name for name in before if str(after[name]) != str(before[name])}
    assert differing == {DIGEST, "known_sha256"}
    assert [p.name for p in tmp_path.iterdir()] == ["a.h5"]


@pytest.mark.parametrize(("share", "replaced"), [(0.95, False), (0.85, True)])
def test_a_tenth_smoother_is_another_optimum(
    planted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float, replaced: bool
) -> None:
    path = tmp_path / "a.h5"
    shutil.copy(planted, path)
    (outlier,) = coherence(read_dataset(path)).outliers
    module = sys.modules["database.repair"]
    monkeypatch.setattr(module, "case_roughness", lambda *arguments: share * outlier.roughness)
    monkeypatch.setattr(module, "_gathered", lambda *arguments: ())  # this one alone
    (done,) = repair(path, n_jobs=1)
    assert done.replaced is replaced
    assert (path.read_bytes() != planted.read_bytes()) is replaced


def test_a_case_of_the_other_branch_is_named_and_solved_again(
    planted: Path, small_database: Path
) -> None:
    before, good = read_dataset(planted), read_dataset(small_database)
    assert before.message[0, 2] == b"planted"
    assert [(o.index, o.limit) for o in coherence(before).outliers] == [((0, 2), None)]
    (done,) = repair(planted, n_jobs=1)
    assert done.replaced
    assert done.outlier.roughness > THRESHOLD > 1.0 > done.roughness
    after = read_dataset(planted)
    assert coherence(after).outliers == ()
    assert after.message[0, 2].startswith(b"re-solved from case ")
    assert after.cost[0, 2] == pytest.approx(good.cost[0, 2], rel=1e-6)
    assert np.abs(after.states[0, 2] - good.states[0, 2])[6].max() < np.radians(0.01)
    others = np.arange(9) != 2
    for name in ("states", "bank_rate", "final_time", "cost", "iterations", "message"):
        kept, were = (getattr(d, name).reshape(9, -1)[others] for d in (after, before))
        assert np.array_equal(kept, were), name
    assert load_guidance(planted).reference(after.mission.nominal_parameters).inside
    untouched = planted.read_bytes()
    partial_folder(planted).mkdir()
    with pytest.raises(BuildError, match="expected no unfinished build beside the file, got"):
        repair(planted, n_jobs=1)
    partial_folder(planted).rmdir()
    assert repair(planted, n_jobs=1) == ()
    assert planted.read_bytes() == untouched
