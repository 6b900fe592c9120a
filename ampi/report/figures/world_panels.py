"""Panels of which each shows a world, those that differ from the model first."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ampi.report.figures.style import new_figure

ABREAST = 3  # panels, at the most
WIDTH = 10.4  # inches


def world_panels(
    worlds: Sequence[str], height: float, *, share: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure with a panel of `height` (inches) for each world, its name above; `share` both axes."""
    columns = columns_of(len(worlds))
    rows = -(-len(worlds) // columns)
    width = WIDTH if columns > 1 else 0.75 * WIDTH
    figure = new_figure(width, height * rows + 0.5)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=share, sharey=share).ravel()
    for axes in grid[len(worlds) :]:
        axes.remove()
    panels = list(grid[: len(worlds)])
    for axes, world in zip(panels, worlds, strict=True):
        axes.set_title(world, parse_math=False)
    for axes in panels[-columns:]:
        axes.tick_params(labelbottom=True)
    return figure, panels


def columns_of(number: int) -> int:
    """Panels side by side, so that rows are about as long: two and two, three and two."""
    rows = -(-number // ABREAST)
    return -(-number // rows)


def is_lowest(panels: Sequence[Axes], number: int) -> bool:
    """Whether no panel stands under this one."""
    return number + columns_of(len(panels)) >= len(panels)


def is_leftmost(panels: Sequence[Axes], number: int) -> bool:
    """Whether no panel stands to the left of this one."""
    return number % columns_of(len(panels)) == 0
