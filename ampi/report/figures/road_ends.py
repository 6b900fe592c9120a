"""Where flights end by several roads: one map whose distances from the target are logarithmic.

Roads differ by decades: on a linear map those that land are one point, or those that do not are outside.
Bearings are true; a point at less than the least distance is drawn at the target.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from ampi.report.figures.panels import marker_key
from ampi.report.figures.style import INK, TARGET_COLOUR, house_style, new_figure
from ampi.simulation.flights import Flights

Array = NDArray[np.float64]

STYLES = (("#E69F00", "s"), ("#0072B2", "o"), ("#CC79A7", "D"), ("#009E73", "^"))  # of roads
WIDTH = 8.4  # inches
LEAST = 10.0  # m: at the target on the logarithmic map
CIRCLES = {100.0: "100 m", 1e3: "1 km", 1e4: "10 km", 1e5: "100 km"}
NEAR = 500.0  # m, half-width of the linear map
ROOM = 1.04  # of a map, over its widest circle
NEAR_CIRCLES = {100.0: "100 m", 250.0: "250 m", 500.0: "500 m"}
LABEL_BEARING = float(np.radians(45.0))  # of the circles' labels


@house_style
def road_ends(campaigns: Mapping[str, Flights]) -> Figure:
    """End points by road (name → flights), along and across the nominal track: afar, and close by."""
    figure = new_figure(WIDTH, 5.05)
    afar, near = figure.subplots(1, 2)
    for (colour, marker), flights in zip(STYLES, campaigns.values(), strict=False):
        good = flights.reached
        across, along = flights.across[good], flights.along[good]
        x, y = logarithmic(across, along)
        style = {"color": colour, "markersize": 3.0, "alpha": 0.7, "fillstyle": "none"}
        afar.plot(x, y, marker, **style)
        close = np.maximum(np.abs(across), np.abs(along)) <= ROOM * NEAR
        near.plot(across[close], along[close], marker, **style)
    farthest = max((_farthest(flights) for flights in campaigns.values()), default=LEAST)
    _draw_circles(afar, {np.log10(r / LEAST): label for r, label in CIRCLES.items()})
    _draw_circles(near, NEAR_CIRCLES)
    half = ROOM * max(np.log10(farthest / LEAST), np.log10(max(CIRCLES) / LEAST))
    afar.set(xlim=(-half, half), ylim=(-half, half), xticks=[], yticks=[])
    near.set(xlim=(-ROOM * NEAR, ROOM * NEAR), ylim=(-ROOM * NEAR, ROOM * NEAR))
    afar.set(title="Logarithmic distance from the target", xlabel="Across the track (decades)")
    afar.set_ylabel("Along the track (decades)")
    near.set(title="Close by", xlabel="Across the track (m)", ylabel="Along the track (m)")
    for axes in (afar, near):
        axes.set_aspect("equal")
        axes.plot(0.0, 0.0, "*", color=TARGET_COLOUR, markersize=10, zorder=4)
    keys = [marker_key(name, m, c) for (c, m), name in zip(STYLES, campaigns, strict=False)]
    keys.append(marker_key("target", "*", TARGET_COLOUR))
    legend = figure.legend(handles=keys, loc="outside lower center", ncols=3)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return figure


def logarithmic(across: Array, along: Array) -> tuple[Array, Array]:
    """Offsets whose size is the decades of (across, along), m, over the least distance."""
    away = np.hypot(across, along)
    scale = np.log10(np.maximum(away, LEAST) / LEAST) / np.maximum(away, LEAST)
    return across * scale, along * scale


def _farthest(flights: Flights) -> float:
    return float(np.max(flights.miss[flights.reached], initial=LEAST))


def _draw_circles(axes: Axes, radii: Mapping[float, str]) -> None:
    axes.grid(visible=False)
    for radius, label in radii.items():
        axes.add_patch(Circle((0.0, 0.0), radius, fill=False, color="#888888", linewidth=0.8))
        at = radius * np.cos(LABEL_BEARING), radius * np.sin(LABEL_BEARING)
        text = axes.annotate(label, at, ha="center", va="center", fontsize=8.0, color=INK)
        text.set_path_effects([withStroke(linewidth=2.5, foreground="white")])
        text.set_zorder(5)
