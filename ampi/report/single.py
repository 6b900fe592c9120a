"""One entry: the reference that guidance made for it, or one optimum of the offline side."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode, Reference
from ampi.report.ground_track import TrackBundle, draw_ground_tracks, track_keys
from ampi.report.look import MODE_LOOKS, house_style, new_figure
from ampi.report.panels import (
    FIGURE_WIDTH,
    PANEL_HEIGHT,
    draw_quantity_limits,
    limit_key,
    line_key,
    marker_key,
    place_legend,
)
from ampi.report.quantities import (
    ALTITUDE,
    AZIMUTH,
    BANK_ANGLE,
    BANK_RATE,
    FLIGHT_PATH_ANGLE,
    SPEED,
    TIME,
)
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

_STATE_ROWS = {ALTITUDE: 0, SPEED: 3, FLIGHT_PATH_ANGLE: 4, AZIMUTH: 5, BANK_ANGLE: 6}
_PANELS = (*_STATE_ROWS, BANK_RATE)
_COLOUR = MODE_LOOKS[Mode.AMPI].colour
CURVE_POINTS = 800


@house_style
def reference_figure(mission: Mission, reference: Reference) -> Figure:
    """States and bank rate of one guidance reference, and its ground track."""
    figure, panels, track = _frame(mission)
    _draw_curve(panels, reference.times, reference.states, reference.bank_rate, "-")
    draw_ground_tracks(track, mission, [_track(reference.states)])
    place_legend(figure, [line_key("reference", _COLOUR), limit_key(), *track_keys()])
    return figure


@house_style
def trajectory_figure(mission: Mission, trajectory: Trajectory) -> Figure:
    """States and bank rate of one optimum: its nodes, and its polynomials between them."""
    figure, panels, track = _frame(mission)
    times = np.linspace(0.0, trajectory.final_time, CURVE_POINTS)
    states, bank_rate = trajectory.at(times)
    _draw_curve(panels, times, states, bank_rate, "-")
    _draw_curve(panels, trajectory.times, trajectory.states, trajectory.bank_rate, "o")
    draw_ground_tracks(track, mission, [_track(states)])
    keys = [line_key("polynomials", _COLOUR), marker_key("nodes", "o", _COLOUR)]
    place_legend(figure, [*keys, limit_key(), *track_keys()])
    return figure


def _frame(mission: Mission) -> tuple[Figure, list[Axes], Axes]:
    """Six panels over time with the control limits, and a wide one for the ground track."""
    figure = new_figure(FIGURE_WIDTH, 4.6 * PANEL_HEIGHT)
    mosaic: dict[str, Axes] = figure.subplot_mosaic(
        [["p0", "p1", "p2"], ["p3", "p4", "p5"], ["track"] * 3], height_ratios=[1.0, 1.0, 1.7]
    )
    panels = [mosaic[f"p{i}"] for i in range(len(_PANELS))]
    limits = {BANK_ANGLE: mission.limits.bank_angle, BANK_RATE: mission.limits.bank_rate}
    for axes, quantity in zip(panels, _PANELS, strict=True):
        axes.set(xlabel=TIME.label, ylabel=quantity.label)
        if quantity in limits:
            draw_quantity_limits(axes, quantity, [-limits[quantity], limits[quantity]])
    return figure, panels, mosaic["track"]


def _draw_curve(panels: list[Axes], times: Array, states: Array, rate: Array, form: str) -> None:
    for axes, quantity in zip(panels, _PANELS, strict=True):
        row = rate if quantity is BANK_RATE else states[_STATE_ROWS[quantity]]
        axes.plot(times, quantity.shown(row), form, color=_COLOUR, linewidth=1.6, markersize=3)


def _track(states: Array) -> TrackBundle:
    return TrackBundle(
        longitude=states[1:2],
        latitude=states[2:3],
        final=states[1:3, -1][None],
        colour=_COLOUR,
        marker="o",
        width=1.8,
        alpha=1.0,
    )
