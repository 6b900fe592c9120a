"""Where the flights end: footprint and histograms, after Sagliano et al. 2016, Figs. 15–18."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.report.figures.campaign import back_to_front
from ampi.report.figures.panels import FIGURE_WIDTH, line_key, marker_key, place_legend
from ampi.report.figures.scheme_style import style_of
from ampi.report.figures.style import (
    INK,
    LIMIT_COLOUR,
    TARGET_COLOUR,
    house_style,
    new_figure,
)
from ampi.report.published import is_of_the_paper
from ampi.report.quantities import CROSSRANGE, DOWNRANGE, KILO
from ampi.simulation.estimates.ellipses import Ellipse, covariance_ellipse
from ampi.simulation.flights import Flights
from ampi.simulation.statistics import TABLE_5_RADII

Array = NDArray[np.float64]

PAPER_RADII = (6.5e3, 13e3, 25e3)  # m, Section V.A
MARKER_SIZES = (8.0, 6.5, 5.0, 3.5)  # back to front
TITLE_WIDTH = 36  # characters over a panel
LABEL_ROOM = 0.15  # of a panel's half-width, between the labels of two circles
BINS = 50
SMALLEST_SHARE = 0.01  # of the smallest median: lesser errors are counted in the first bin
SMALLEST_WINDOW = 0.05  # km, half-width


def circles(mission: Mission) -> tuple[float, ...]:
    """Radii (m) of the circles around the target: of the paper for its mission, else the mission's."""
    return TABLE_5_RADII if is_of_the_paper(mission) else mission.target.judged_radii


@house_style
def campaign_footprint(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """End points around the target at three scales, with 95 % ellipses [Fig. 15]."""
    shown = back_to_front(campaigns)
    ellipses = {name: e for name, f in shown.items() if (e := footprint_ellipse(f)) is not None}
    spans = {name: span(ellipse) for name, ellipse in ellipses.items()}
    radii = circles(mission) if not mission.target.place_is_free else ()
    scales = {}
    if radii:
        label = "Circles of Table 5" if is_of_the_paper(mission) else "Radii of the mission"
        scales[label] = 1.15 * max(radii) * KILO
    if spans:
        last = list(spans)[-1]  # AMPI's, if it was flown
        scales["All 95 % ellipses"] = 1.2 * max(spans.values())
        scales[f"95 % ellipse of {last}"] = 1.2 * spans[last]
    scales = scales or {"End points": SMALLEST_WINDOW}
    figure = new_figure(10.4, 4.4)
    panels = figure.subplots(1, len(scales), squeeze=False)[0]
    for axes, (title, half) in zip(panels, scales.items(), strict=True):
        half = max(half, SMALLEST_WINDOW)
        beyond = draw_footprints(axes, shown, radii, mission.target.position_tolerance, half)
        cut = [name for name, own in spans.items() if own > half]
        lines = [title]
        lines += [f"{beyond} end point{'s' if beyond > 1 else ''} outside"] if beyond else []
        lines += wrap(f"ellipses cut off: {', '.join(cut)}", TITLE_WIDTH) if cut else []
        axes.set_title("\n".join(lines), parse_math=False)
    keys = [marker_key(name, style_of(f).marker, style_of(f).colour) for name, f in shown.items()]
    keys.append(marker_key("target", "*", TARGET_COLOUR))
    if not mission.target.place_is_free:
        reach = mission.target.position_tolerance * KILO
        keys.append(line_key(f"tolerance, {reach:g} km", LIMIT_COLOUR, dashed=True, width=1.2))
    place_legend(figure, keys)
    return figure


@house_style
def campaign_histograms(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """Final altitude error, final speed error and range to go, on logarithmic axes [Figs. 16–18].

    The errors of the modes lie decades apart; linear bins would put all but one mode into one bar.
    """
    shown = back_to_front(campaigns)
    target = mission.target
    figure = new_figure(FIGURE_WIDTH, 7.8)
    altitude, speed, miss = figure.subplots(3, 1)
    _draw_histogram(altitude, shown, {k: f.altitude_error[f.reached] for k, f in shown.items()})
    altitude.set_xlabel(
        f"Final altitude error, absolute; tolerance {target.altitude_tolerance:g} (m)"
    )
    _draw_histogram(speed, shown, {k: f.speed_error[f.reached] for k, f in shown.items()})
    speed.set_xlabel(f"Final speed error, absolute; tolerance {target.speed_tolerance:g} (m/s)")
    _draw_histogram(miss, shown, {k: f.miss[f.reached] * KILO for k, f in shown.items()})
    miss.set_xlabel("Range to go (km)")
    keys = [_outline_key(name, f) for name, f in shown.items()]
    if not target.place_is_free:
        paper = is_of_the_paper(mission)
        radii = PAPER_RADII if paper else target.judged_radii
        for radius in radii:
            miss.axvline(radius * KILO, color=INK, linewidth=1.0, linestyle=(0, (5, 3)))
        text = ", ".join(f"{radius * KILO:g}" for radius in radii)
        whose = "paper's radii" if paper else "radii of the mission"
        keys.append(line_key(f"{whose}: {text} km", INK, dashed=True, width=1.0))
    place_legend(figure, keys)
    return figure


def _outline_key(name: str, flights: Flights) -> Line2D:
    style = style_of(flights)
    return Line2D([], [], color=style.colour, linewidth=1.8, linestyle=style.dashes, label=name)


def footprint_ellipse(flights: Flights) -> Ellipse | None:
    """95 % covariance ellipse of the end points, or None if too few flights ended."""
    return covariance_ellipse(*np.where(flights.reached, (flights.across, flights.along), np.nan))


def _edge(ellipse: Ellipse, colour: str) -> Polygon:
    across, along = ellipse.outline()
    return Polygon(
        np.column_stack([CROSSRANGE.shown(across), DOWNRANGE.shown(along)]),
        fill=False,
        linewidth=1.8,
        edgecolor=colour,
        zorder=3,
        path_effects=[withStroke(linewidth=4.0, foreground="white")],
    )


def span(ellipse: Ellipse) -> float:
    """Half-width (km) of a square around the target that holds `ellipse`."""
    return KILO * float(np.max(np.abs(ellipse.outline())))


def draw_footprints(
    axes: Axes,
    shown: Mapping[str, Flights],
    radii: Sequence[float],
    tolerance: float,
    half: float,
) -> int:
    """Points, ellipses and circles in a square of half-width `half` (km); how many points it lacks.

    `radii` and the position's `tolerance`: m; no radii, no circles.
    """
    beyond = 0
    sizes = MARKER_SIZES[-len(shown) :]
    sizes = (MARKER_SIZES[0],) * (len(shown) - len(sizes)) + sizes
    for flights, size in zip(shown.values(), sizes, strict=True):
        style, good = style_of(flights), flights.reached
        across, along = CROSSRANGE.shown(flights.across[good]), DOWNRANGE.shown(flights.along[good])
        seen = (np.abs(across) <= half) & (np.abs(along) <= half)
        beyond += int(np.count_nonzero(~seen))
        axes.plot(
            across[seen],
            along[seen],
            style.marker,
            color=style.colour,
            markersize=size,
            alpha=0.5,
            fillstyle="none",  # coincident modes stand around each other
        )
        ellipse = footprint_ellipse(flights)
        if ellipse is not None:
            axes.add_patch(_edge(ellipse, style.colour))
    labelled = 0.0
    for radius in sorted({*radii, tolerance}) if radii else ():
        size = radius * KILO
        edge = Circle((0.0, 0.0), size, fill=False, color=INK, linewidth=0.9)
        if radius == tolerance:
            edge.set(color=LIMIT_COLOUR, linewidth=1.2, linestyle=(0, (5, 3)))
        if size <= half:
            axes.add_patch(edge)
        if size <= half and size - labelled > LABEL_ROOM * half:
            axes.annotate(f"{size:g} km", (0.0, size), ha="center", va="bottom", fontsize=8.5)
            labelled = size
    axes.plot(0.0, 0.0, "*", color=TARGET_COLOUR, fillstyle="none", markersize=9, zorder=4)
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set(xlabel=CROSSRANGE.label, ylabel=DOWNRANGE.label)
    axes.locator_params(nbins=6)
    return beyond


def _draw_histogram(axes: Axes, shown: Mapping[str, Flights], errors: Mapping[str, Array]) -> None:
    sizes = {name: np.abs(error) for name, error in errors.items()}
    edges = logarithmic_bins(list(sizes.values())).tolist()
    for name, size in sizes.items():
        style = style_of(shown[name])
        inside = np.clip(size, edges[0], edges[-1])
        axes.hist(inside, edges, histtype="stepfilled", color=style.colour, alpha=0.25)
        axes.hist(
            inside,
            edges,
            histtype="step",
            color=style.colour,
            linewidth=1.8,
            linestyle=style.dashes,
        )
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
