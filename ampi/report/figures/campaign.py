"""Monte-Carlo campaigns over time and over ground, after Sagliano et al. 2016, Figs. 11–14 and 19.

States, errors, controls and tracks compare two modes, nominal tracking and AMPI, as the paper does;
more bundles in a panel hide each other. If either is missing, all campaigns are drawn.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.onboard.reference import Mode
from ampi.physics.angles import wrapped
from ampi.physics.state import BANK, CIRCULAR_STATES, LATITUDE, LONGITUDE, SPEED
from ampi.report.figures.ground_track import (
    TrackBundle,
    draw_ground_tracks,
    draw_target_window,
    map_and_window,
    target_longitude,
    track_keys,
)
from ampi.report.figures.panels import (
    control_limits,
    draw_bundle,
    draw_quantity_limits,
    limit_key,
    line_key,
    loads,
    panel_grid,
    place_legend,
)
from ampi.report.figures.scheme_style import style_of
from ampi.report.figures.style import INK, house_style
from ampi.report.quantities import CONTROL_QUANTITIES, ENTRY_QUANTITIES
from ampi.report.scheme_groups import is_corrected
from ampi.simulation.flights import Flights

Array = NDArray[np.float64]

_BACK_TO_FRONT = (
    Mode.NOMINAL,
    Mode.NEAREST,
    Mode.MPI,
    Mode.CUBIC,
    Mode.HERMITE,
    Mode.SECOND_DIFFERENCES,
    Mode.QUADRATIC,
    Mode.AMPI,
)
WINDOW_PERCENTILE = 99.0  # of the end points in the window on the target; footprints show the rest
WIDTHS = (
    2.6,
    1.9,
    1.2,
    0.5,
)  # of curves, back to front: a mode that coincides with another is its rim


def back_to_front(campaigns: Mapping[str, Flights]) -> dict[str, Flights]:
    """Campaigns in drawing order: the widest scatter first, AMPI on top, corrected last."""

    def place(item: tuple[str, Flights]) -> tuple[int, bool]:
        return _BACK_TO_FRONT.index(item[1].mode), is_corrected(item[1])

    return dict(sorted(campaigns.items(), key=place))


def compared(campaigns: Mapping[str, Flights]) -> dict[str, Flights]:
    """Nominal tracking and AMPI if both were flown, else everything."""
    pair = {k: f for k, f in campaigns.items() if f.mode in (Mode.NOMINAL, Mode.AMPI)}
    both = {f.mode for f in pair.values()} == {Mode.NOMINAL, Mode.AMPI}
    return back_to_front(pair if both else campaigns)


def with_widths(campaigns: Mapping[str, Flights]) -> list[tuple[Flights, str, float]]:
    """Each campaign in drawing order with its colour and the width of its curves."""
    widths = WIDTHS[-len(campaigns) :]
    widths = (WIDTHS[0],) * (len(campaigns) - len(widths)) + widths
    return [
        (flights, style_of(flights).colour, width)
        for flights, width in zip(campaigns.values(), widths, strict=True)
    ]


def campaign_keys(campaigns: Mapping[str, Flights], *, with_ends: bool = False) -> list[Line2D]:
    """Legend entries of the campaigns drawn as lines, with the marker of their ends on demand."""
    keys = []
    for name, flights in campaigns.items():
        style = style_of(flights)
        key = line_key(f"{name} ({flights.n} flights)", style.colour)
        key.set_marker(style.marker if with_ends else "none")
        keys.append(key)
    return keys


@house_style
def campaign_states(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """The six states of every flight, with the target's values [Fig. 11]."""
    shown = compared(campaigns)
    figure, panels = panel_grid([q.label for q in ENTRY_QUANTITIES], 2)
    for flights, colour, width in with_widths(shown):
        times, states = _flown(flights)
        for i, (axes, quantity) in enumerate(zip(panels, ENTRY_QUANTITIES, strict=True)):
            draw_bundle(axes, times, quantity.shown(states[:, i]), colour, width=width)
    target = mission.target
    ends = np.concatenate([flights.final_states[:, 1] for flights in shown.values()])
    wanted = (target.altitude, target_longitude(mission, ends), target.latitude, target.speed)
    for axes, quantity, value in zip(panels, ENTRY_QUANTITIES, wanted, strict=False):
        axes.axhline(value * quantity.per_si, color=INK, linewidth=0.9, linestyle=":")
    target_key = Line2D([], [], color=INK, linewidth=0.9, linestyle=":", label="target")
    place_legend(figure, [*campaign_keys(shown), target_key])
    return figure


@house_style
def campaign_tracking_errors(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """Flown minus reference, state by state: what feedback is left to remove [Fig. 12]."""
    shown = compared(campaigns)
    figure, panels = panel_grid([q.error_label() for q in ENTRY_QUANTITIES], 2)
    for flights, colour, width in with_widths(shown):
        errors = flights.states[()] - flights.reference_states[()]
        errors[:, list(CIRCULAR_STATES)] = wrapped(errors[:, list(CIRCULAR_STATES)])
        for i, (axes, quantity) in enumerate(zip(panels, ENTRY_QUANTITIES, strict=True)):
            draw_bundle(axes, flights.times, quantity.shown(errors[:, i]), colour, width=width)
    place_legend(figure, campaign_keys(shown))
    return figure


@house_style
def campaign_controls(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """Angle of attack, bank angle and bank rate, one column per mode, with limits [Fig. 13]."""
    shown = compared(campaigns)
    labels = [q.label for q in CONTROL_QUANTITIES for _ in shown]
    figure, panels = panel_grid(labels, len(shown))
    for column, (name, flights) in enumerate(shown.items()):
        model = mission.family(flights.parameters).flight_model(trailing=1)
        alive = np.where(np.isfinite(flights.states[:, SPEED]), 1.0, np.nan)
        planned = 0.0  # of a vehicle that steers it, the command is the angle itself
        if mission.angle_of_attack is None:
            states = np.moveaxis(flights.states[()], 1, 0)
            planned = model.angle_of_attack(states, flights.times)
        values = (
            planned * alive + flights.angle_of_attack[()],
            flights.states[:, BANK],
            flights.bank_rate[()],
        )
        panels[column].set_title(name, parse_math=False)
        limits = control_limits(mission)
        column_panels = panels[column :: len(shown)]
        for axes, quantity, value, levels in zip(
            column_panels, CONTROL_QUANTITIES, values, limits, strict=True
        ):
            colour = style_of(flights).colour
            draw_bundle(axes, flights.times, quantity.shown(value), colour)
            draw_quantity_limits(axes, quantity, levels)
    place_legend(figure, [*campaign_keys(shown), limit_key()])
    return figure


@house_style
def campaign_ground_tracks(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """Ground tracks of every flight, with a window on the target [Fig. 14]."""
    shown = compared(campaigns)
    bundles = [_tracks(flights, width) for flights, _, width in with_widths(shown)]
    figure, chart, window = map_and_window()
    draw_ground_tracks(chart, mission, bundles)
    draw_target_window(window, mission, bundles, percentile=WINDOW_PERCENTILE)
    place_legend(figure, [*campaign_keys(shown, with_ends=True), *track_keys(mission)])
    return figure


@house_style
def campaign_constraints(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """The loads on the path of every flight, with their limits [Fig. 19]."""
    shown, drawn = compared(campaigns), loads(mission)
    figure, panels = panel_grid([load.quantity.label for load in drawn], 1)
    for flights, colour, width in with_widths(shown):
        limits = mission.family(flights.parameters).path_limits(trailing=1)
        for axes, load in zip(panels, drawn, strict=True):
            values = load.value(flights.path[:, flights.limits.index(load.name)], limits)
            shown_values = load.quantity.shown(values)
            draw_bundle(axes, flights.times, shown_values, colour, width=width)
    for axes, load in zip(panels, drawn, strict=True):
        draw_quantity_limits(axes, load.quantity, [load.limit])
    place_legend(figure, [*campaign_keys(shown), limit_key()])
    return figure


def _flown(flights: Flights) -> tuple[Array, Array]:
    """Times (n, k+1) and states (n, 7, k+1): the recorded points and the end of each flight."""
    recorded = np.broadcast_to(flights.times, (flights.n, len(flights.times)))
    times = np.concatenate([recorded, flights.final_time[:, None]], axis=1)
    return times, np.concatenate([flights.states[()], flights.final_states[:, :, None]], axis=2)


def _tracks(flights: Flights, width: float) -> TrackBundle:
    _, states = _flown(flights)
    style = style_of(flights)
    return TrackBundle(
        longitude=states[:, LONGITUDE],
        latitude=states[:, LATITUDE],
        final=flights.final_states[:, 1:3],
        colour=style.colour,
        marker=style.marker,
        width=width,
    )
