"""The audit in two pictures: who stands out of the family, and where interpolation costs most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ampi.report.figures.panels import (
    FIGURE_WIDTH,
    draw_limits,
    limit_key,
    marker_key,
    place_legend,
)
from ampi.report.figures.style import DATABASE_COLOUR, INK, LIMIT_COLOUR, house_style, new_figure

Array = NDArray[np.float64]

CHOSEN_COLOUR = "#E69F00"
PANELS = {
    "altitude_m": "Altitude (m)",
    "speed_m_per_s": "Speed (m/s)",
    "bank_deg": "Bank angle (deg)",
    "final_time_s": "Final time (s)",
}
SMALLEST = 1e-5  # of the threshold: what is smoother is drawn here
FOOT = 0.04  # of the panel's height
MOST_NAMES = 12


@dataclass(frozen=True)
class CellBar:
    """One cell of one axis: its label, its errors by column, and whether a point pays most there."""

    parameter: str
    label: str
    errors: Mapping[str, float]
    chosen: bool


@house_style
def coherence_figure(roughness: Array, threshold: float, named: Mapping[int, str]) -> Figure:
    """Roughness of every case (c,), NaN where it is unknown; those of another branch by name."""
    figure = new_figure(FIGURE_WIDTH, 4.2)
    axes = figure.subplots()
    cases, shown = np.arange(len(roughness)), np.fmax(roughness, SMALLEST * threshold)
    known, outlying = np.isfinite(roughness), np.isin(cases, list(named))
    for chosen, marker, colour, size in (
        (known & ~outlying, "o", DATABASE_COLOUR, 3.5),
        (known & outlying, "D", LIMIT_COLOUR, 6.0),
    ):
        axes.plot(cases[chosen], shown[chosen], marker, color=colour, markersize=size)
    draw_limits(axes, [threshold])
    keys = [marker_key("optimum", "o", DATABASE_COLOUR), limit_key()]
    keys.append(marker_key("stands out", "D", LIMIT_COLOUR))
    if not known.all():  # at the foot of the panel, whatever its scale: no height would be true
        foot = axes.get_xaxis_transform()
        for chosen, colour in (
            (~known & ~outlying, DATABASE_COLOUR),
            (~known & outlying, LIMIT_COLOUR),
        ):
            axes.plot(cases[chosen], np.full(chosen.sum(), FOOT), "x", color=colour, transform=foot)
        keys.append(marker_key("unknown", "x", DATABASE_COLOUR))
    for case in sorted(named, key=lambda c: -np.nan_to_num(roughness[c]))[:MOST_NAMES]:
        right = case > 0.6 * len(roughness)
        axes.annotate(
            named[case],
            (case, shown[case] if known[case] else FOOT),
            xycoords="data" if known[case] else foot,
            xytext=(-8 if right else 8, 0),
            textcoords="offset points",
            ha="right" if right else "left",
            va="center",
            fontsize=8.5,
        )
    axes.set(yscale="log", xlabel="Case number", ylabel="Roughness (family scale = 1)")
    place_legend(figure, keys)
    return figure


@house_style
def error_map_figure(cells: Sequence[CellBar]) -> Figure:
    """Interpolation error in every cell of every axis, and the cell where one more point pays most."""
    figure = new_figure(FIGURE_WIDTH, max(4.0, 0.5 * len(cells) + 1.2))
    panels = figure.subplots(1, len(PANELS), sharey=True)
    place = np.arange(len(cells))[::-1]
    colours = [CHOSEN_COLOUR if cell.chosen else DATABASE_COLOUR for cell in cells]
    for axes, (column, label) in zip(panels, PANELS.items(), strict=True):
        axes.barh(place, [cell.errors[column] for cell in cells], color=colours, height=0.72)
        for y, cell in zip(place, cells, strict=True):
            if not np.isfinite(cell.errors[column]):  # no bar would look like no error
                axes.annotate(
                    "unknown", (0, y), (4, 0), textcoords="offset points", va="center", fontsize=8
                )
        axes.set(xlabel=label, ylim=(-0.6, len(cells) - 0.4))
        for above, below in zip(range(len(cells)), range(1, len(cells)), strict=False):
            if cells[above].parameter != cells[below].parameter:
                axes.axhline(place[below] + 0.5, color=INK, linewidth=0.5)
    panels[0].set_yticks(place, [f"{cell.parameter}\n{cell.label}" for cell in cells], fontsize=8)
    keys = [
        Line2D([], [], color=DATABASE_COLOUR, linewidth=6, label="error in the cell"),
        Line2D([], [], color=CHOSEN_COLOUR, linewidth=6, label="one more point pays most here"),
    ]
    place_legend(figure, keys)
    return figure
