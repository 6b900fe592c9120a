"""Grids of panels over time, and bundles of many curves drawn as one collection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.path_limits import LimitKind, PathLimits
from ampi.report.figures.style import INK, LIMIT_COLOUR, new_figure
from ampi.report.quantities import (
    ANGLE_OF_ATTACK,
    DYNAMIC_PRESSURE,
    HEAT_FLUX,
    LONGITUDE,
    TIME,
    Quantity,
    load_factor,
    use_of,
)

Array = NDArray[np.float64]

PANEL_HEIGHT = 2.35  # inches
FIGURE_WIDTH = 9.2  # inches
KEY_WIDTH = 1.5  # inches, of a legend


def panel_grid(labels: Sequence[str], columns: int) -> tuple[Figure, list[Axes]]:
    """A figure with one panel over time per label, `columns` side by side."""
    rows = -(-len(labels) // columns)
    figure = new_figure(FIGURE_WIDTH, PANEL_HEIGHT * rows + 0.4)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
    for axes, label in zip(grid, labels, strict=False):
        axes.set_ylabel(label)
        if label == LONGITUDE.label:
            number_on_one_turn(axes.yaxis)
    for axes in grid[len(labels) :]:
        axes.remove()
    panels = list(grid[: len(labels)])
    for axes in panels[-columns:]:
        axes.set_xlabel(TIME.label)
        axes.tick_params(labelbottom=True)
    figure.align_ylabels(panels)
    return figure, panels


def number_on_one_turn(axis: Axis) -> None:
    """Longitudes on [−180, 180), though a track that crosses the date line goes on beyond."""

    def number(longitude: float, _: int) -> str:
        return f"{(longitude + 180.0) % 360.0 - 180.0:g}".replace("-", "−")

    axis.set_major_formatter(FuncFormatter(number))


def draw_bundle(
    axes: Axes, x: Array, y: Array, colour: str, *, width: float = 0.5, alpha: float = 0.3
) -> None:
    """Curves y (n, k) over x ((k,) or (n, k)) as one collection; NaN points are left out."""
    x = np.broadcast_to(x, y.shape)
    finite = np.isfinite(x) & np.isfinite(y)
    if not finite.any():
        return
    curves = [np.column_stack([a[f], b[f]]) for a, b, f in zip(x, y, finite, strict=True)]
    axes.add_collection(
        LineCollection(
            [c for c in curves if len(c) > 1], colors=colour, linewidths=width, alpha=alpha
        )
    )
    axes.update_datalim([(x[finite].min(), y[finite].min()), (x[finite].max(), y[finite].max())])
    axes.autoscale_view()


def draw_limits(axes: Axes, levels: Sequence[float]) -> None:
    """Dashed horizontal lines at `levels`, in the panel's unit, well inside what is drawn so far."""
    for level in levels:
        low, high = axes.get_ylim()
        room = 0.06 * (max(high, level) - min(low, level))
        axes.set_ylim(min(low, level - room), max(high, level + room))
        axes.axhline(level, color=LIMIT_COLOUR, linewidth=1.2, linestyle=(0, (5, 3)))


def control_limits(mission: Mission) -> tuple[tuple[float, ...], ...]:
    """Limits (SI, rad) of angle of attack, bank angle and bank rate.

    Of an angle of attack that follows a schedule there are none; bounds that are no numbers are curves
    (`draw_angle_bounds`).
    """
    limits, angle = mission.limits, PathLimits.of(mission).angle_of_attack
    fixed = angle is not None and angle.are_fixed
    return (
        (angle.lower[0], angle.upper[0]) if angle is not None and fixed else (),
        (-limits.bank_angle, limits.bank_angle),
        (-limits.bank_rate, limits.bank_rate),
    )


def draw_angle_bounds(axes: Axes, mission: Mission, times: Array, states: Array) -> None:
    """Bounds of the angle of attack along a flight (8, n), where it is a control."""
    angle = PathLimits.of(mission).angle_of_attack
    if angle is None:
        return
    for bound in angle.at_state(mission.flight_model, states):
        along = np.broadcast_to(ANGLE_OF_ATTACK.shown(bound), times.shape)
        axes.plot(times, along, color=LIMIT_COLOUR, linewidth=1.2, linestyle=(0, (5, 3)))


@dataclass(frozen=True)
class Load:
    """A limit on the path that is drawn over time."""

    name: str
    index: int  # among PathLimits.names
    quantity: Quantity
    limit: float  # SI

    def value(self, use: Any, limits: PathLimits) -> Array:
        """The load (SI) from the use of its limit, of a mission or of a family."""
        own = limits.loads[self.index] if self.index < len(limits.loads) else self.limit
        return np.asarray(use * own)


def loads(mission: Mission) -> tuple[Load, ...]:
    """Dynamic pressure, heat flux, load factor and a drag floor; no-fly zones stand on the map."""
    limits = mission.limits
    known = {
        "dynamic_pressure": (DYNAMIC_PRESSURE, limits.dynamic_pressure),
        "heat_flux": (HEAT_FLUX, limits.heat_flux),
        "load_factor": (
            load_factor(mission.flight_model.planet.load_factor_gravity),
            limits.load_factor,
        ),
    }
    drawn = (LimitKind.LOAD, LimitKind.DRAG_FLOOR)
    return tuple(
        Load(name, i, *known.get(name, (use_of(name), 1.0)))
        for i, (name, kind) in enumerate(PathLimits.of(mission).kinds.items())
        if kind in drawn
    )


def draw_quantity_limits(axes: Axes, quantity: Quantity, levels: Sequence[float]) -> None:
    """Dashed lines at `levels` (SI, rad) in a panel of `quantity`."""
    draw_limits(axes, [level * quantity.per_si for level in levels])


def line_key(label: str, colour: str, *, dashed: bool = False, width: float = 2.2) -> Line2D:
    """A legend entry for a bundle, drawn opaque."""
    style = (0, (5, 3)) if dashed else "-"
    return Line2D([], [], color=colour, linewidth=width, linestyle=style, label=label)


def limit_key() -> Line2D:
    """The legend entry of limits."""
    return line_key("limit", LIMIT_COLOUR, dashed=True, width=1.2)


def marker_key(label: str, marker: str, colour: str = INK) -> Line2D:
    """A legend entry for points."""
    return Line2D([], [], color=colour, marker=marker, linestyle="none", markersize=6, label=label)


def place_legend(figure: Figure, keys: Sequence[Line2D]) -> None:
    """One legend for all panels, under them: in rows of one length that fit the figure."""
    abreast = max(2, int(figure.get_figwidth() / KEY_WIDTH))
    columns = -(-len(keys) // -(-len(keys) // abreast))
    legend = figure.legend(handles=list(keys), loc="outside lower center", ncols=columns)
    for text in legend.get_texts():
        text.set_parse_math(False)  # a $ in a campaign's name is a dollar
