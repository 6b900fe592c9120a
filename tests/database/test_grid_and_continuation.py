"""The grid of Eq. (9) and the order in which it is solved."""

from __future__ import annotations

import numpy as np
import pytest

from ampi.missions.loading import load_mission, parse_mission
from ampi.missions.mission import Mission
from database.plan.continuation import layers
from database.plan.grid import Grid


def test_shefex3_grid_is_the_hexeract_of_eq_9() -> None:
    grid = Grid.from_mission(load_mission("shefex3"))
    assert grid.shape == (3,) * 6
    assert grid.size == 729
    assert grid.centre == (1,) * 6
    np.testing.assert_allclose(
        [axis[2] - axis[1] for axis in grid.axes],
        [250.0, *np.radians([0.5, 0.5]), 70.0, *np.radians([0.5, 0.5])],
    )


def test_layers_hold_every_case_once_and_neighbours_come_earlier() -> None:
    grid = Grid.from_mission(load_mission("shefex3"))
    done: set[int] = set()
    plan = layers(grid)
    assert [len(layer) for layer in plan] == [1, 12, 60, 160, 240, 192, 64]
    for layer in plan:
        for planned in layer:
            assert set(planned.neighbours) <= done
            here = np.array(np.unravel_index(planned.case, grid.shape))
            for neighbour in planned.neighbours:
                there = np.array(np.unravel_index(neighbour, grid.shape))
                assert np.abs(here - there).sum() == 1
        done |= {planned.case for planned in layer}
    assert done == set(range(grid.size))


def test_points_are_in_c_order() -> None:
    grid = Grid.from_mission(load_mission("shefex3"))
    full = np.stack(np.meshgrid(*grid.axes, indexing="ij"), axis=-1).reshape(-1, 6)
    for case in (0, 1, 364, 728):
        np.testing.assert_array_equal(grid.point(case), full[case])


def test_a_mission_that_disperses_nothing_has_no_grid() -> None:
    text = load_mission("shefex3").toml
    mission = parse_mission(text[: text.index("[grid]")] + "[grid]\nspeed_m_per_s = [0.0]\n")
    with pytest.raises(ValueError, match=r"shefex3: expected a \[grid\] with at least one axis of"):
        Grid.from_mission(mission)


def test_an_uneven_grid_of_any_parameters() -> None:
    text = load_mission("shefex3").toml
    grid = Grid.from_mission(
        parse_mission(
            text[: text.index("[grid]")]
            + "[grid]\nvehicle.mass_kg = [-10, -1, 0, 2]\nspeed_m_per_s = [0.0, 5.0]\n"
            + "azimuth_deg = [0.0]\n"
        )
    )
    assert grid.names == ("speed", "vehicle.mass")
    assert grid.units == ("m/s", "kg")
    assert grid.shape == (2, 4)
    assert grid.centre == (0, 2)
    assert [grid.point(case)[1] for case in range(4)] == [490.0, 499.0, 500.0, 502.0]
    np.testing.assert_array_equal(grid.points(), [grid.point(case) for case in range(8)])
    assert [len(layer) for layer in layers(grid)] == [1, 3, 3, 1]


def test_the_cases_beside_one_differ_by_one_step_of_one_axis(small_mission: Mission) -> None:
    grid = Grid.from_mission(small_mission)
    place = {case: np.unravel_index(case, grid.shape) for case in range(grid.size)}
    for case in range(grid.size):
        steps = {c: np.abs(np.subtract(place[c], place[case])).sum() for c in place}
        assert sorted(grid.beside(case)) == [c for c, count in steps.items() if count == 1]
