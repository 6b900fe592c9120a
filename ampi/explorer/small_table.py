"""What of a table fits a page; the rest is left out, and said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.table import GuidanceTable

MOST_VALUES = 1_500_000  # of the table: some two megabytes of page


@dataclass(frozen=True, eq=False)
class SmallTable:
    """A table, or what of it fits a page."""

    table: GuidanceTable
    axes: list[int]  # numbers of the axes that are left
    left_out: list[str]  # a sentence each


def fitting(table: GuidanceTable, names: Sequence[str]) -> SmallTable:
    """What of a table fits: first of every axis its ends and the nominal value, then fewer axes.

    Raises
    ------
    ValueError
        If one optimum alone is too large.
    """
    columns = len(table.layout) * table.conversion.shape[0] + 1
    if columns > MOST_VALUES:
        raise ValueError(
            f"table: expected optima of up to {MOST_VALUES:,} numbers, got {columns:,}"
        )
    kept = [list(range(len(axis))) for axis in table.axes]
    left_out = []
    while prod(map(len, kept)) * columns > MOST_VALUES:
        longest = max(range(len(kept)), key=lambda i: len(kept[i]))
        centre = table.centre[longest]
        few = sorted({0, centre, len(table.axes[longest]) - 1})
        if len(kept[longest]) > len(few):
            left_out.append(f"{names[longest]}: {len(few)} of {len(kept[longest])} points")
            kept[longest] = few
            continue
        last = max(i for i, points in enumerate(kept) if len(points) > 1)
        kept[last] = [table.centre[last]]
        left_out = [text for text in left_out if not text.startswith(f"{names[last]}:")]
        left_out.append(f"{names[last]}: held at its nominal value")
    axes = [i for i, points in enumerate(kept) if len(points) > 1 or len(table.axes[i]) == 1]
    return (
        SmallTable(_cut(table, kept, axes), axes, left_out)
        if left_out
        else SmallTable(table, axes, [])
    )


def _cut(table: GuidanceTable, kept: list[list[int]], axes: list[int]) -> GuidanceTable:
    held = tuple(i for i in range(len(kept)) if i not in axes)

    def cut(values: NDArray[Any]) -> NDArray[Any]:
        own = values
        for axis, points in enumerate(kept):
            own = np.take(own, points, axis=axis)
        return own.squeeze(axis=held)

    return replace(
        table,
        axes=tuple(table.axes[i][kept[i]] for i in axes),
        values=cut(table.values),
        final_time=cut(table.final_time),
        centre=tuple(kept[i].index(table.centre[i]) for i in axes),
        solved=None if table.solved is None else cut(table.solved),
        circular=tuple(axes.index(i) for i in table.circular if i in axes),
        sensitivities=None,
    )
