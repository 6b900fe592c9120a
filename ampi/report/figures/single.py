"""One entry: the reference that guidance made for it, one flight, or one optimum."""

from __future__ import annotations

from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.onboard.reference import Mode, Reference
from ampi.physics.state import BANK
from ampi.report.figures.ground_track import TrackBundle, draw_ground_tracks, track_keys
from ampi.report.figures.panels import (
    FIGURE_WIDTH,
    PANEL_HEIGHT,
    draw_angle_bounds,
    draw_quantity_limits,
    limit_key,
    line_key,
    loads,
    marker_key,
    place_legend,
)
from ampi.report.figures.style import INK, LIMIT_COLOUR, MODE_STYLES, house_style, new_figure
from ampi.report.quantities import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    ANGLE_OF_ATTACK_RATE,
    AZIMUTH,
    BANK_ANGLE,
    BANK_RATE,
    FLIGHT_PATH_ANGLE,
    KILO,
    SPEED,
    TIME,
    Quantity,
)
from ampi.scp.problem.shortfall import outcome_sentence
from ampi.simulation.flights import Flights
from ampi.simulation.plant import FlightStatus
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

_STATE_ROWS = {ALTITUDE: 0, SPEED: 3, FLIGHT_PATH_ANGLE: 4, AZIMUTH: 5, BANK_ANGLE: 6}
_ANGLE_ROW = {ANGLE_OF_ATTACK: 7}  # where it is a control
_COLOUR = MODE_STYLES[Mode.AMPI].colour
_COLUMNS = 3
REFERENCE = MODE_STYLES[Mode.NOMINAL].colour
CURVE_POINTS = 800
TITLE_WIDTH = 100  # characters


@house_style
def reference_figure(mission: Mission, reference: Reference) -> Figure:
    """States, rates of what is steered and loads of one guidance reference, and its ground track.

    `mission` is the one at the parameters of this entry: its loads and its target are drawn.
    """
    figure, panels, track = _frame(mission)
    outside = [p.name for p, c in zip(mission.parameters, reference.clipped, strict=True) if c]
    where = f"outside the hypercube in {', '.join(outside)}: boundary trajectory"
    _title(figure, f"{mission.title}: {where if outside else 'reference'}", not outside)
    states = reference.layout.flight_states(reference.rows)
    _draw_curves(panels, mission, reference.times, states, _rates(mission, reference), "-")
    _draw_limits(panels, mission, reference.times, states)
    draw_ground_tracks(track, mission, [_track(states)])
    place_legend(figure, [line_key("reference", _COLOUR), limit_key(), *track_keys(mission)])
    return figure


@house_style
def trajectory_figure(mission: Mission, trajectory: Trajectory) -> Figure:
    """States, rates of what is steered and loads of one optimum, and what the solver says of it.

    Its nodes, and its polynomials between them.
    """
    figure, panels, track = _frame(mission)
    status = trajectory.status
    _title(
        figure,
        f"{mission.title}: {status.name}. {outcome_sentence(mission, trajectory)}",
        status.ok,
    )
    times = np.linspace(0.0, trajectory.final_time, CURVE_POINTS)
    states, _ = trajectory.at(times)
    _draw_curves(panels, mission, times, states, trajectory.controls_at(times), "-")
    nodes = trajectory.times, trajectory.states, trajectory.controls
    _draw_curves(panels, mission, *nodes, "o")
    _draw_limits(panels, mission, times, states)
    draw_ground_tracks(track, mission, [_track(states)])
    keys = [line_key("polynomials", _COLOUR), marker_key("nodes", "o", _COLOUR)]
    place_legend(figure, [*keys, limit_key(), *track_keys(mission)])
    return figure


@house_style
def flight_figure(mission: Mission, flights: Flights, name: str) -> Figure:
    """One flight, a campaign of one: what was flown, and the reference that it was to follow."""
    figure, panels, track = _frame(mission)
    status, passed = FlightStatus(int(flights.status[0])), bool(flights.passed[0])
    miss = f"{flights.miss[0] * KILO:.3g} km from the target"
    _title(figure, f"{mission.title}, {name}: {miss}. {status.sentence}", passed)
    states, references = flights.states[0], flights.reference_states[0]
    flown = np.isfinite(states[0])
    times, states, references = flights.times[flown], states[:, flown], references[:, flown]
    rates = [flights.bank_rate[0][flown]]
    if mission.angle_of_attack is not None:  # the command is the angle itself
        angle = flights.angle_of_attack[0][flown]
        states = np.vstack([states, angle])
        references = np.vstack([references, np.full(len(times), np.nan)])
        rates.append(np.gradient(angle, times))
    unknown = np.full((len(rates), len(times)), np.nan)
    _draw_curves(panels, mission, times, references, unknown, "--", REFERENCE)
    _draw_curves(panels, mission, times, states, np.stack(rates), "-")
    _draw_limits(panels, mission, times, states)
    draw_ground_tracks(track, mission, [_track(references, REFERENCE), _track(states)])
    keys = [line_key("flown", _COLOUR), line_key("reference", REFERENCE, dashed=True)]
    place_legend(figure, [*keys, limit_key(), *track_keys(mission)])
    return figure


def _title(figure: Figure, text: str, good: bool) -> None:
    title = figure.suptitle(fill(text, TITLE_WIDTH), fontsize=10)
    title.set(color=INK if good else LIMIT_COLOUR, parse_math=False)


def _rates(mission: Mission, reference: Reference) -> Array:
    """(m, n) of a reference; a table holds the bank's, the other is that of its polynomials."""
    rows, angle = [reference.bank_rate], reference.layout.angle_of_attack
    if angle is not None:
        mesh, final_time = mission.pseudospectral_mesh, reference.final_time
        slope = mesh.derivative(final_time) @ reference.nodal[angle]
        rows.append(mesh.conversion(reference.times, final_time) @ slope)
    return np.stack(rows)


def _state_rows(mission: Mission) -> dict[Quantity, int]:
    return _STATE_ROWS if mission.angle_of_attack is None else {**_STATE_ROWS, **_ANGLE_ROW}


def _quantities(mission: Mission) -> list[Quantity]:
    states = _state_rows(mission)
    rates = (BANK_RATE, ANGLE_OF_ATTACK_RATE)[: 1 + len(states) - len(_STATE_ROWS)]
    return [*states, *rates, *(load.quantity for load in loads(mission))]


def _frame(mission: Mission) -> tuple[Figure, list[Axes], Axes]:
    """A panel over time for each quantity, and a wide one for the ground track."""
    quantities = _quantities(mission)
    rows = -(-len(quantities) // _COLUMNS)
    figure = new_figure(FIGURE_WIDTH, (rows + 2.2) * PANEL_HEIGHT)
    names = [f"p{i}" if i < len(quantities) else "." for i in range(rows * _COLUMNS)]
    mosaic: dict[str, Axes] = figure.subplot_mosaic(
        [*np.reshape(names, (rows, _COLUMNS)).tolist(), ["track"] * _COLUMNS],
        height_ratios=[*[1.0] * rows, 1.7],
    )
    panels = [mosaic[f"p{i}"] for i in range(len(quantities))]
    for axes, quantity in zip(panels, quantities, strict=True):
        axes.set(xlabel=TIME.label, ylabel=quantity.label)
    return figure, panels, mosaic["track"]


def _draw_curves(
    panels: list[Axes],
    mission: Mission,
    times: Array,
    states: Array,
    rates: Array,
    form: str,
    colour: str = _COLOUR,
) -> None:
    limits = PathLimits.of(mission)
    use = limits.path(mission.flight_model, states, times)
    rows = [
        *(states[row] for row in _state_rows(mission).values()),
        *rates[: mission.n_states - BANK],
        *(load.value(use[load.index], limits) for load in loads(mission)),
    ]
    for axes, quantity, row in zip(panels, _quantities(mission), rows, strict=True):
        axes.plot(times, quantity.shown(row), form, color=colour, linewidth=1.6, markersize=3)


def _draw_limits(panels: list[Axes], mission: Mission, times: Array, states: Array) -> None:
    """Those of the angle of attack may be curves along a flight."""
    limits, angle = mission.limits, mission.angle_of_attack
    levels = {
        BANK_ANGLE: (-limits.bank_angle, limits.bank_angle),
        BANK_RATE: (-limits.bank_rate, limits.bank_rate),
        **{load.quantity: (load.limit,) for load in loads(mission)},
    }
    if angle is not None:
        levels[ANGLE_OF_ATTACK_RATE] = (-angle.rate, angle.rate)
    for axes, quantity in zip(panels, _quantities(mission), strict=True):
        draw_quantity_limits(axes, quantity, levels.get(quantity, ()))
        if quantity is ANGLE_OF_ATTACK:
            draw_angle_bounds(axes, mission, times, states)


def _track(states: Array, colour: str = _COLOUR) -> TrackBundle:
    return TrackBundle(
        longitude=states[1:2],
        latitude=states[2:3],
        final=states[1:3, -1][None],
        colour=colour,
        marker="o",
        width=1.8,
        alpha=1.0,
    )
