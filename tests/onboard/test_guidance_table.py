"""The table is checked whole on the ground, and locked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ampi.onboard.table import GuidanceTable

TableMaker = Callable[..., GuidanceTable]


def unlocked(table: GuidanceTable, name: str) -> Any:
    """A writable copy of one array of the table."""
    return getattr(table, name).copy()


# --- laws -----------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=30)
@given(sizes=st.lists(st.integers(1, 4), min_size=6, max_size=6), data=st.data())
def test_corners_and_nominal_are_subtables(
    make_table: TableMaker, sizes: list[int], data: st.DataObject
) -> None:
    axes = tuple(10.0 * i + np.cumsum(np.arange(1.0, n + 1.0)) for i, n in enumerate(sizes))
    centre = tuple(data.draw(st.integers(0, n - 1)) for n in sizes)
    table = make_table(axes, centre)
    ends = np.ix_(*[sorted({0, n - 1}) for n in sizes])
    corners = table.corners()
    assert np.array_equal(corners.values, table.values[ends])
    assert np.array_equal(corners.final_time, table.final_time[ends])
    for got, axis in zip(corners.axes, axes, strict=True):
        assert got.tolist() == sorted({axis[0], axis[-1]})
    nominal = table.nominal()
    assert nominal.final_time.shape == (1,) * 6
    assert np.array_equal(nominal.values.reshape(len(table.layout), -1), table.values[centre])
    assert nominal.final_time.item() == table.final_time[centre]
    assert [a.item() for a in nominal.axes] == [a[i] for a, i in zip(axes, centre, strict=True)]
    for other in (corners, nominal):
        assert other.conversion is table.conversion
        assert other.high_density_time is table.high_density_time


def test_corners_of_corners_and_nominal_of_nominal_change_nothing(table: GuidanceTable) -> None:
    for once in (table.corners(), table.nominal()):
        twice = once.corners() if once.values.size > table.nominal().values.size else once.nominal()
        assert np.array_equal(twice.values, once.values)
        for a, b in zip(twice.axes, once.axes, strict=True):
            assert np.array_equal(a, b)


@pytest.mark.parametrize("name", ["values", "final_time", "conversion"])
def test_arrays_are_read_only(table: GuidanceTable, name: str) -> None:
    for part in (table, table.corners(), table.nominal()):
        with pytest.raises(ValueError, match="read-only"):
            getattr(part, name)[...] = 0.0
        for axis in part.axes:
            with pytest.raises(ValueError, match="read-only"):
                axis[...] = 0.0


# --- refusals -------------------------------------------------------------------------------------


def test_a_hole_is_refused_and_counted(table: GuidanceTable) -> None:
    final_time = unlocked(table, "final_time")
    final_time[0, 0, 0, 0, 0, 0] = np.nan
    final_time[1, 0, 2, 0, 0, 0] = np.inf
    with pytest.raises(ValueError, match=r"2 of 729 cases have no solution.*Re-run the build"):
        replace(table, final_time=final_time)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_nodal_value_that_is_not_finite_is_refused(table: GuidanceTable, value: float) -> None:
    values = unlocked(table, "values")
    values[2, 1, 0, 1, 2, 0, 9, 3] = value
    with pytest.raises(ValueError, match="a table with holes cannot fly"):
        replace(table, values=values)


@pytest.mark.parametrize(
    ("name", "cut", "message"),
    [
        ("values", np.s_[:2], r"values has shape \(2, 3, .*expected \(3, 3, "),
        ("values", np.s_[..., :14, :], r"values has shape \(.* 14, .*expected \(.* 15, "),
        ("values", np.s_[..., :-1], r"values has shape"),
        ("final_time", np.s_[:, :2], r"final_time has shape \(3, 2, .*expected \(3, 3, "),
        ("conversion", np.s_[:-1], r"values has shape|segments have 11 nodes, expected 10"),
        ("conversion", np.s_[:, :-1], r"high_density_time has shape"),
    ],
)
def test_a_wrong_shape_is_named(table: GuidanceTable, name: str, cut: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"guidance table: {message}"):
        replace(table, **{name: getattr(table, name)[cut].copy()})


@pytest.mark.parametrize("points", [[0.0, 1.0, 1.0], [0.0, 2.0, 1.0], [2.0, 1.0, 0.0]])
def test_an_axis_that_does_not_increase_is_refused(
    table: GuidanceTable, points: list[float]
) -> None:
    with pytest.raises(ValueError, match="every axis must increase strictly"):
        replace(table, axes=(*table.axes[:5], np.array(points)))


@pytest.mark.parametrize("change", [1e-8, -1e-8, 1.0])
def test_matrix_columns_that_do_not_sum_to_one_are_refused(
    table: GuidanceTable, change: float
) -> None:
    conversion = unlocked(table, "conversion")
    conversion[2, 17] += change
    with pytest.raises(ValueError, match="columns of the LD→HD matrix must sum to one"):
        replace(table, conversion=conversion)


@pytest.mark.parametrize("which", [0, 1])
def test_high_density_times_are_read_only(table: GuidanceTable, which: int) -> None:
    with pytest.raises(ValueError, match="read-only"):
        table.high_density_time[which][...] = 0.0


@pytest.mark.parametrize("name", ["axes", "conversion", "high_density_time"])
def test_not_a_number_is_refused_everywhere(table: GuidanceTable, name: str) -> None:
    value = getattr(table, name)
    if name == "conversion":
        value = value.copy()
        value[1, 1] = np.nan
    else:
        value = (value[0].copy(), *value[1:])
        value[0][1] = np.nan
    with pytest.raises(ValueError, match="must be finite"):
        replace(table, **{name: value})


def test_both_parts_of_the_high_density_times_are_checked(table: GuidanceTable) -> None:
    fixed, free = table.high_density_time
    with pytest.raises(ValueError, match="high_density_time"):
        replace(table, high_density_time=(fixed, free[:-1]))


def test_a_hole_in_the_values_alone_is_counted(table: GuidanceTable) -> None:
    values = table.values.copy()
    values[(0,) * len(table.axes)][3, 2] = np.nan
    with pytest.raises(ValueError, match=r"1 of \d+ cases have no solution"):
        replace(table, values=values)


@pytest.mark.parametrize("centre", [(1,) * 5, (1,) * 7, (3, 1, 1, 1, 1, 1), (-1, 1, 1, 1, 1, 1)])
def test_a_centre_beside_the_grid_is_refused(table: GuidanceTable, centre: tuple[int, ...]) -> None:
    with pytest.raises(
        ValueError, match=r"centre: expected a grid index within \(3, 3, 3, 3, 3, 3"
    ):
        replace(table, centre=centre)


@pytest.mark.parametrize("circular", [(6,), (-1,), (0, 7)])
def test_a_circular_axis_that_is_none_is_refused(
    table: GuidanceTable, circular: tuple[int, ...]
) -> None:
    with pytest.raises(ValueError, match="circular: expected numbers of axes, 0 to 5, got"):
        replace(table, circular=circular)


@pytest.mark.parametrize("final_time", [0.0, -10.0, 15.0])
def test_times_that_do_not_increase_are_refused(table: GuidanceTable, final_time: float) -> None:
    """They are divided by; in this table 20 s are flown before the time that depends on t_f."""
    times = unlocked(table, "final_time")
    times[0, 1, 0, 2, 0, 0] = final_time
    with pytest.raises(ValueError, match="final times must be positive, and the times"):
        replace(table, final_time=times)
