"""What flights say without their mission: where they end, how they descend, bank and use their limits.

For one campaign, and for some side by side, names → flights; `ampi.report.figures.campaign` draws those
of a mission, against its target and its limits.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ampi.report.figures.campaign import back_to_front, campaign_keys, with_widths
from ampi.report.figures.footprint import (
    SMALLEST_WINDOW,
    draw_footprints,
    footprint_ellipse,
    span,
)
from ampi.report.figures.panels import (
    FIGURE_WIDTH,
    draw_bundle,
    draw_limits,
    limit_key,
    line_key,
    marker_key,
    panel_grid,
    place_legend,
)
from ampi.report.figures.scheme_style import style_of
from ampi.report.figures.style import INK, LIMIT_COLOUR, TARGET_COLOUR, house_style, new_figure
from ampi.report.quantities import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    BANK_ANGLE,
    CROSSRANGE,
    DOWNRANGE,
    KILO,
    SPEED,
    TIME,
)
from ampi.report.scheme_groups import words
from ampi.simulation.flights import Flights

Array = NDArray[np.float64]

ROOM = 1.2  # of a window, over what it is to hold
MOST_POINTS = 400  # of a sketch: as many tell where thousands lie


@house_style
def end_points(campaigns: Mapping[str, Flights]) -> Figure:
    """End points across and along the nominal track: with the radii judged, and with all ellipses."""
    shown = back_to_front(campaigns)
    first = next(iter(shown.values()))
    spans = [span(e) for f in shown.values() if (e := footprint_ellipse(f)) is not None]
    tolerance = first.position_tolerance
    radii = first.radii.tolist() if np.isfinite(tolerance) else []
    halves = {"Radii judged": max(radii) * KILO} if radii else {}
    halves["95 % ellipses"] = max(spans, default=SMALLEST_WINDOW)
    figure = new_figure(FIGURE_WIDTH, 4.9)
    panels = figure.subplots(1, len(halves), squeeze=False)[0]
    for axes, (title, size) in zip(panels, halves.items(), strict=True):
        half = max(ROOM * size, SMALLEST_WINDOW)
        beyond = draw_footprints(axes, shown, radii, tolerance, half)
        axes.set_title(f"{title}; {beyond} end points outside" if beyond else title)
    keys = [marker_key(k, style_of(f).marker, style_of(f).colour) for k, f in shown.items()]
    keys.append(marker_key("target", "*", TARGET_COLOUR))
    if radii:
        reach = f"tolerance, {tolerance * KILO:g} km"
        keys.append(line_key(reach, LIMIT_COLOUR, dashed=True, width=1.2))
    place_legend(figure, keys)
    return figure


def draw_end_points(axes: Axes, flights: Flights, colour: str) -> None:
    """Of a sketch: the first end points, the ellipse of all, and the tolerance where it is in sight."""
    ended = np.flatnonzero(flights.reached)[:MOST_POINTS]
    across, along = flights.across[ended], flights.along[ended]
    axes.plot(
        CROSSRANGE.shown(across), DOWNRANGE.shown(along), ".", color=colour, markersize=3, alpha=0.6
    )
    ellipse = footprint_ellipse(flights)
    if ellipse is not None:
        edge = ellipse.outline(61)
        axes.plot(CROSSRANGE.shown(edge[0]), DOWNRANGE.shown(edge[1]), color=colour)
    if np.isfinite(flights.position_tolerance):
        turn = np.linspace(0.0, 2.0 * np.pi, 61)
        x, y = flights.position_tolerance * KILO * np.array([np.cos(turn), np.sin(turn)])
        axes.plot(x, y, color=LIMIT_COLOUR, linewidth=1.0, linestyle=(0, (5, 3)))
    axes.plot(0.0, 0.0, "*", color=INK, markersize=6)
    half = ROOM * (flights.position_tolerance * KILO if ellipse is None else span(ellipse))
    half = max(half, SMALLEST_WINDOW) if np.isfinite(half) else SMALLEST_WINDOW
    axes.set(xlabel=CROSSRANGE.label, ylabel=DOWNRANGE.label, aspect="equal")
    axes.set(xlim=(-half, half), ylim=(-half, half))
    axes.locator_params(nbins=5)


@house_style
def descents(campaigns: Mapping[str, Flights]) -> Figure:
    """Altitude over speed and over time of every flight."""
    shown = back_to_front(campaigns)
    figure = new_figure(FIGURE_WIDTH, 4.0)
    left, right = figure.subplots(1, 2, sharey=True)
    for flights, colour, width in with_widths(shown):
        altitude = ALTITUDE.shown(flights.states[:, 0])
        draw_bundle(left, SPEED.shown(flights.states[:, 3]), altitude, colour, width=width)
        draw_bundle(right, flights.times, altitude, colour, width=width)
    left.invert_xaxis()  # as it is flown
    left.set(xlabel=SPEED.label, ylabel=ALTITUDE.label)
    right.set(xlabel=TIME.label)
    place_legend(figure, campaign_keys(shown))
    return figure


@house_style
def bank_angles(campaigns: Mapping[str, Flights]) -> Figure:
    """Bank angle over time of every flight, and the change of the angle of attack where one flew it.

    Of a vehicle that steers its angle of attack, that angle itself.
    """
    shown = back_to_front(campaigns)
    changed = any(np.nanmax(np.abs(f.angle_of_attack), initial=0.0) > 0.0 for f in shown.values())
    is_steered = any("angle_of_attack_rate" in f.limits for f in shown.values())
    angle = ANGLE_OF_ATTACK.label if is_steered else "Change of the angle of attack (deg)"
    labels = [BANK_ANGLE.label, angle][: 1 + changed]
    figure, panels = panel_grid(labels, 1)
    for flights, colour, width in with_widths(shown):
        rows = (flights.states[:, 6], flights.angle_of_attack[()])
        for axes, row in zip(panels, rows, strict=False):
            draw_bundle(axes, flights.times, BANK_ANGLE.shown(row), colour, width=width)
    place_legend(figure, campaign_keys(shown))
    return figure


@house_style
def limits_used(campaigns: Mapping[str, Flights]) -> Figure:
    """The use of each limit over time, 1 where it is reached."""
    shown = back_to_front(campaigns)
    limits = next(iter(shown.values())).limits
    figure, panels = panel_grid([f"{words(limit).capitalize()}, use (–)" for limit in limits], 2)
    for flights, colour, width in with_widths(shown):
        use = flights.path[()]
        for i, axes in enumerate(panels):
            draw_bundle(axes, flights.times, use[:, i], colour, width=width)
    for axes in panels:
        draw_limits(axes, [1.0])
    place_legend(figure, [*campaign_keys(shown), limit_key()])
    return figure
