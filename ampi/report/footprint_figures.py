"""Where the flights end: footprint and histograms, after Sagliano et al. 2016, Figs. 15–18."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.report.campaign_figures import back_to_front
from ampi.report.look import INK, MODE_LOOKS, TARGET_COLOUR, house_style, new_figure
from ampi.report.panels import FIGURE_WIDTH, line_key, marker_key, place_legend
from ampi.report.quantities import CROSSRANGE, DOWNRANGE, KILO
from ampi.simulation.monte_carlo import Flights
from ampi.simulation.statistics import ELLIPSE, TABLE_5_RADII

Array = NDArray[np.float64]

PAPER_RADII = (6.5e3, 13e3, 25e3)  # m, Section V.A
BINS = 50
SMALLEST_SHARE = 0.01  # of the smallest median: lesser errors are counted in the first bin
SMALLEST_WINDOW = 0.05  # km, half-width


@house_style
def campaign_footprint(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """End points around the target at three scales, with 95 % ellipses [Fig. 15]."""
    shown = back_to_front(campaigns)
    ellipses = [e for e in map(footprint_ellipse, shown.values()) if e is not None]
    figure = new_figure(10.4, 3.95)
    panels = figure.subplots(1, 3)
    rings = max(TABLE_5_RADII) * KILO
    spans = [_span(e) for e in ellipses] or [rings]  # the last is AMPI's, if it was flown
    scales = (1.15 * rings, 1.2 * max(spans), 1.2 * spans[-1])
    titles = ("Circles of Table 5", "All 95 % ellipses", f"95 % ellipse of {list(shown)[-1]}")
    for axes, half, title in zip(panels, scales, titles, strict=True):
        _draw_footprints(axes, shown, max(half, SMALLEST_WINDOW))
        axes.set_title(title)
    keys = [
        marker_key(name, MODE_LOOKS[f.mode].marker, MODE_LOOKS[f.mode].colour)
        for name, f in shown.items()
    ]
    place_legend(figure, [*keys, marker_key("target", "*", TARGET_COLOUR)])
    return figure


@house_style
def campaign_histograms(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """Final altitude error, final speed error and range to go, on logarithmic axes [Figs. 16–18].

    The errors of the modes lie decades apart; linear bins would put all but one mode into one bar.
    """
    shown = back_to_front(campaigns)
    figure = new_figure(FIGURE_WIDTH, 7.8)
    altitude, speed, miss = figure.subplots(3, 1)
    _draw_histogram(altitude, shown, {k: f.altitude_error[f.reached] for k, f in shown.items()})
    altitude.set_xlabel("Final altitude error, absolute (m)")
    _draw_histogram(speed, shown, {k: f.speed_error[f.reached] for k, f in shown.items()})
    speed.set_xlabel("Final speed error, absolute (m/s)")
    _draw_histogram(miss, shown, {k: f.miss[f.reached] * KILO for k, f in shown.items()})
    miss.set_xlabel("Range to go (km)")
    for radius in PAPER_RADII:
        miss.axvline(radius * KILO, color=INK, linewidth=1.0, linestyle=(0, (5, 3)))
    keys = [line_key(name, MODE_LOOKS[f.mode].colour) for name, f in shown.items()]
    radii = ", ".join(f"{radius * KILO:g}" for radius in PAPER_RADII)
    marks = Line2D(
        [], [], color=INK, linewidth=1.0, linestyle=(0, (5, 3)), label=f"paper's radii: {radii} km"
    )
    place_legend(figure, [*keys, marks])
    return figure


def footprint_ellipse(flights: Flights) -> Ellipse | None:
    """95 % covariance ellipse (km) of the end points, or None if fewer than three flights ended."""
    good = flights.reached
    if np.count_nonzero(good) < 3:
        return None
    points = np.stack([flights.across[good], flights.along[good]]) * KILO
    variances, directions = np.linalg.eigh(np.cov(points))
    minor, major = 2.0 * np.sqrt(ELLIPSE * np.maximum(variances, 0.0))
    centre = points.mean(axis=1)
    return Ellipse(
        (float(centre[0]), float(centre[1])),
        width=float(major),
        height=float(minor),
        angle=float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1]))),
        fill=False,
        linewidth=1.8,
        edgecolor=MODE_LOOKS[flights.mode].colour,
        zorder=3,
        path_effects=[withStroke(linewidth=4.0, foreground="white")],
    )


def _span(ellipse: Ellipse) -> float:
    """Half-width (km) of a square around the target that holds `ellipse`."""
    x, y = ellipse.center
    return max(abs(x), abs(y)) + 0.5 * max(ellipse.width, ellipse.height)


def _draw_footprints(axes: Axes, shown: Mapping[str, Flights], half: float) -> None:
    """Points, ellipses and circles in a square of half-width `half` (km) around the target."""
    for flights in shown.values():
        look, good = MODE_LOOKS[flights.mode], flights.reached
        across, along = CROSSRANGE.shown(flights.across[good]), DOWNRANGE.shown(flights.along[good])
        seen = (np.abs(across) <= half) & (np.abs(along) <= half)
        axes.plot(
            across[seen], along[seen], look.marker, color=look.colour, markersize=3, alpha=0.4
        )
        ellipse = footprint_ellipse(flights)
        if ellipse is not None:
            axes.add_patch(ellipse)
    for radius in TABLE_5_RADII:
        if radius * KILO <= half:
            axes.add_patch(Circle((0.0, 0.0), radius * KILO, fill=False, color=INK, linewidth=0.9))
            text = f"{radius * KILO:g} km"
            axes.annotate(text, (0.0, radius * KILO), ha="center", va="bottom", fontsize=8.5)
    axes.plot(0.0, 0.0, "*", color=TARGET_COLOUR, markersize=9, zorder=4)
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set(xlabel=CROSSRANGE.label, ylabel=DOWNRANGE.label)


def _draw_histogram(axes: Axes, shown: Mapping[str, Flights], errors: Mapping[str, Array]) -> None:
    sizes = {name: np.abs(error) for name, error in errors.items()}
    edges = logarithmic_bins(list(sizes.values())).tolist()
    for name, size in sizes.items():
        colour = MODE_LOOKS[shown[name].mode].colour
        inside = np.clip(size, edges[0], edges[-1])
        axes.hist(inside, edges, histtype="stepfilled", color=colour, alpha=0.25)
        axes.hist(inside, edges, histtype="step", color=colour, linewidth=1.6)
    axes.set(xscale="log", ylabel="Flights (count)")


def logarithmic_bins(sizes: list[Array]) -> Array:
    """Edges of bins of equal ratio over all positive `sizes`, cut far below the smallest median."""
    positive = [size[size > 0.0] for size in sizes if np.any(size > 0.0)]
    if not positive:
        return np.geomspace(1e-3, 1.0, BINS + 1)
    cut = SMALLEST_SHARE * min(float(np.median(size)) for size in positive)
    low = max(cut, min(float(size.min()) for size in positive))
    high = max(float(size.max()) for size in positive)
    return np.geomspace(low, max(high, 10.0 * low), BINS + 1)
