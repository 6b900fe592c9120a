"""How far from the target flights end: the share within a distance, on one logarithmic axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from ampi.report.figures.campaign import back_to_front
from ampi.report.figures.panels import line_key, place_legend
from ampi.report.figures.scheme_style import style_of, styles
from ampi.report.figures.style import INK, house_style
from ampi.report.figures.world_panels import is_leftmost, is_lowest, world_panels
from ampi.report.quantities import KILO
from ampi.report.scheme_groups import by_world, words
from ampi.report.schemes_table import RADII
from ampi.simulation.flights import Flights

Array = NDArray[np.float64]
Dashes = str | tuple[float, tuple[float, ...]]

NEAREST, FARTHEST = 10.0, 1e6  # m, ends of the axis
MOST_CORNERS = 1000  # of a staircase that is drawn with all
LAW_DASHES: tuple[Dashes, ...] = (
    "-",
    (0.0, (5.0, 1.5)),
    (0.0, (1.2, 1.2)),
    (0.0, (6.0, 1.5, 1.0, 1.5)),
)


@house_style
def miss_distributions(campaigns: Mapping[str, Flights]) -> Figure:
    """A curve per campaign and a panel per world; a flight that did not arrive lifts no curve."""
    worlds = by_world(campaigns)
    dashes = law_dashes(campaigns)
    figure, panels = world_panels(list(worlds), 3.4, share=True)
    for number, (axes, flown) in enumerate(zip(panels, worlds.values(), strict=True)):
        for radius in RADII:
            axes.axvline(radius * KILO, color="#BBBBBB", linewidth=0.8, zorder=1)
        for flights in back_to_front(flown).values():
            distance, share = distribution(flights)
            if flights.n > MOST_CORNERS:
                distance, share = share_within(flights)
            axes.plot(
                distance * KILO,
                100.0 * share,
                color=style_of(flights).colour,
                linestyle=dashes[flights.law],
                linewidth=1.8,
                drawstyle="steps-post",
            )
        axes.set(xscale="log", xlim=(NEAREST * KILO, FARTHEST * KILO), ylim=(0.0, 102.0))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        if is_lowest(panels, number):
            axes.set_xlabel("Distance from the target (km)")
        if is_leftmost(panels, number):
            axes.set_ylabel("Flights within it (%)")
    place_legend(figure, _keys(campaigns, dashes))
    return figure


def distribution(flights: Flights) -> tuple[Array, Array]:
    """Distances (m) and the shares (0 … 1) of flights no farther, corners of a staircase."""
    miss = np.sort(flights.miss[flights.reached])
    near = np.count_nonzero(miss <= NEAREST)
    shown = miss[(miss > NEAREST) & (miss <= FARTHEST)]
    share = (near + np.arange(len(shown) + 1)) / flights.n
    return np.r_[NEAREST, shown, FARTHEST], np.r_[share, share[-1]]


def share_within(flights: Flights, points: int = 500) -> tuple[Array, Array]:
    """The same at distances (m) in steps of one ratio: of many flights the eye sees no more corners."""
    distances = np.geomspace(NEAREST, FARTHEST, points)
    miss = np.sort(flights.miss[flights.reached])
    return distances, np.searchsorted(miss, distances, side="right") / flights.n


def law_dashes(campaigns: Mapping[str, Flights]) -> dict[str, Dashes]:
    """Law → line style, in the order in which laws come."""
    laws = dict.fromkeys(flights.law for flights in campaigns.values())
    return {law: LAW_DASHES[i % len(LAW_DASHES)] for i, law in enumerate(laws)}


def _keys(campaigns: Mapping[str, Flights], dashes: Mapping[str, Dashes]) -> list[Line2D]:
    drawn = styles(back_to_front(campaigns).values())
    keys = [line_key(name, style.colour) for name, style in drawn.items()]
    for law, dash in dashes.items() if len(dashes) > 1 else ():
        keys.append(Line2D([], [], color=INK, linewidth=1.8, linestyle=dash, label=words(law)))
    text = ", ".join(f"{radius * KILO:g}" for radius in RADII)
    return [*keys, line_key(f"{text} km", "#BBBBBB", width=0.8)]
