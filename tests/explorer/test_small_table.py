"""What of a table fits a page, how it is packed, and what is refused in a sentence."""

from __future__ import annotations

import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ampi.dataset import read_dataset
from ampi.explorer import small_table
from ampi.explorer.explorer import explore
from ampi.explorer.packed_table import PackedTable
from ampi.explorer.small_table import fitting
from ampi.loading import guidance_of
from ampi.onboard.table import GuidanceTable


def table_of(axes: int, points: int, database: Path) -> GuidanceTable:
    """A smooth table of many axes, with the nodes of a real one."""
    own = guidance_of(read_dataset(database), engine="numpy").table
    grid = (points,) * axes
    shift = np.indices(grid).sum(axis=0)
    line = np.linspace(0.0, 1.0, points)
    return replace(
        own,
        axes=(line,) * axes,
        values=own.values[0, 0] * (1.0 + 1e-3 * shift[..., None, None]),
        final_time=own.final_time[0, 0] * (1.0 + 1e-3 * shift),
        centre=(points // 2,) * axes,
        circular=(),
    )


def test_a_table_that_fits_is_left_alone(small_database: Path) -> None:
    table = table_of(2, 5, small_database)
    found = fitting(table, ["a", "b"])
    assert found.table is table
    assert (found.axes, found.left_out) == ([0, 1], [])


def test_points_go_first_then_axes_and_both_are_said(
    small_database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = table_of(4, 5, small_database)
    columns = len(table.layout) * table.conversion.shape[0] + 1
    monkeypatch.setattr(small_table, "MOST_VALUES", 30 * columns)
    found = fitting(table, list("abcd"))
    assert found.axes == [0, 1, 2]
    assert found.left_out == [
        "a: 3 of 5 points",
        "b: 3 of 5 points",
        "c: 3 of 5 points",
        "d: held at its nominal value",
    ]
    assert found.table.final_time.shape == (3, 3, 3)
    assert np.array_equal(found.table.final_time, table.final_time[::2, ::2, ::2, 2])
    assert np.array_equal(found.table.values, table.values[::2, ::2, ::2, 2])
    assert found.table.centre == (1, 1, 1)


def test_of_ten_parameters_the_first_ones_are_kept(
    small_database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = table_of(10, 2, small_database)
    monkeypatch.setattr(small_table, "MOST_VALUES", 2**8 * (table.values[(0,) * 10].size + 1))
    found = fitting(table, list("abcdefghij"))
    assert found.axes == list(range(8))
    assert found.left_out == [f"{name}: held at its nominal value" for name in "ji"]


def test_an_optimum_that_is_too_large_is_refused(
    small_database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(small_table, "MOST_VALUES", 10)
    with pytest.raises(ValueError, match=r"expected optima of up to 10 numbers, got [\d,]+"):
        explore(read_dataset(small_database))


def test_what_is_packed_comes_back(small_database: Path) -> None:
    """Summed up by numpy: within half a step of each row."""
    table = guidance_of(read_dataset(small_database), engine="numpy").table
    packed = PackedTable.of(table)
    planes = np.frombuffer(zlib.decompress(packed.planes, -15), "u1").reshape(4, -1).astype(int)
    zigzag = (planes << np.array([[0], [8], [16], [24]])).sum(axis=0)
    steps = ((zigzag >> 1) ^ -(zigzag & 1)).reshape(packed.shape)
    for axis in range(steps.ndim - 1):
        steps = steps.cumsum(axis=axis)
    rows, nodes = table.values.shape[-2:]
    nodal = steps[..., :-1].reshape(*packed.shape[:-1], nodes, rows)
    values = packed.least[:-1] + packed.step[:-1] * nodal
    assert np.all(np.abs(values - np.swapaxes(table.values, -1, -2)) <= 0.51 * packed.step[:-1])
    final_time = packed.least[-1] + packed.step[-1] * steps[..., -1]
    assert np.all(np.abs(final_time - table.final_time) <= 0.51 * packed.step[-1])
