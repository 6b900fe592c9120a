"""The multilinear continuation of a case: exact without mixed differences, absent without neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission, load_mission
from ampi.trajectory import Status, Trajectory
from database.plan.grid import Grid
from database.plan.prediction import corners, predicted


@pytest.fixture(scope="module")
def mission() -> Mission:
    return load_mission("shefex3")


def planted(mission: Mission, grid: Grid, value: float) -> Trajectory:
    mesh = mission.pseudospectral_mesh
    return Trajectory(
        mesh, np.full((7, mesh.n_nodes), value), np.zeros(mesh.n_nodes), value, 0.0, Status.SOLVED
    )


def family(grid: Grid, case: int, bilinear: float) -> float:
    p: NDArray[np.float64] = (grid.point(case) - grid.point(grid.size // 2)) / np.ptp(
        np.array(grid.axes), axis=1
    )
    return float(3.0 + p.sum() + np.sum(p**3) + bilinear * p[0] * p[1] * p[2] * p[3])


def test_sums_of_functions_of_one_axis_are_continued_exactly(mission: Mission) -> None:
    grid = Grid.from_mission(mission)
    for case in (0, grid.size - 1, 5, 100):
        found = predicted(grid, case, lambda c: planted(mission, grid, family(grid, c, 0.0)))
        assert found is not None
        assert found.final_time == pytest.approx(family(grid, case, 0.0), abs=1e-12)


def test_terms_sum_to_one_and_lie_nearer_to_the_centre(mission: Mission) -> None:
    grid = Grid.from_mission(mission)
    centre = np.array(grid.centre)
    for case in range(0, grid.size, 7):
        terms = corners(grid, case)
        far = np.abs(np.array(np.unravel_index(case, grid.shape)) - centre).sum()
        if terms:
            assert sum(sign for sign, _ in terms) == 1.0
        for _, corner in terms:
            assert np.abs(np.array(np.unravel_index(corner, grid.shape)) - centre).sum() < far


def test_a_missing_term_means_no_prediction(mission: Mission) -> None:
    grid = Grid.from_mission(mission)
    assert predicted(grid, 0, lambda case: None) is None
    assert predicted(grid, grid.size // 2, lambda case: pytest.fail("asked")) is None
