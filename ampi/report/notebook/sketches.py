"""The small figures beside the sheets, as SVG without a ground: light enough for every cell."""

from __future__ import annotations

import io
from functools import singledispatch
from itertools import product
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.onboard.reference import Reference
from ampi.physics.angles import on_turn_of
from ampi.physics.planet import bearing, destination, great_circle_distance
from ampi.physics.state import ANGLE_OF_ATTACK, BANK
from ampi.report.figures.flown import draw_end_points
from ampi.report.figures.ground_track import TrackBundle, draw_ground_tracks
from ampi.report.figures.misses import share_within
from ampi.report.figures.style import INK, LIMIT_COLOUR, TARGET_COLOUR, house_style, new_figure
from ampi.report.quantities import ALTITUDE, BANK_ANGLE, KILO, SPEED
from ampi.simulation.estimates.bootstrap import Estimate
from ampi.simulation.estimates.paired import PairedDifference
from ampi.simulation.flights import Flights
from ampi.simulation.statistics import Verdict
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

# of paper → of a page, light or dark: that of its text, and a red that is seen on both
INKS = {INK: "currentColor", TARGET_COLOUR: "currentColor", LIMIT_COLOUR: "#E0565B"}
COLOUR = "#2E8BC0"  # seen on white and on black
SIZE = (5.2, 2.5)  # inches
CURVE_POINTS, TRACK_POINTS = 200, 40
# text stays text: lighter than its outlines, and can be searched; grids are seen on any ground
SETTINGS = {"svg.fonttype": "none", "grid.color": "#808080", "grid.alpha": 0.3, "font.size": 9.0}


@singledispatch
def draw(value: Any) -> Figure:
    """The figure of a value of any class that shows itself."""
    raise TypeError(f"value: expected one that shows itself, got {type(value).__name__}")


def sketch_of(value: Any) -> str:
    """The figure of a value as the text of an SVG file."""
    buffer = io.StringIO()
    figure = house_style(_drawn)(value)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ampi"}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    return buffer.getvalue()


def _drawn(value: Any) -> Figure:
    with rc_context(SETTINGS):
        return draw(value)


@draw.register
def _of_mission(mission: Mission) -> Figure:
    """Great circles from the entry points to the target: no flight, but where it goes."""
    entry, target = mission.entry, mission.target
    moved = {p.number.path: p.axis for p in mission.parameters}
    axes_ = [
        moved.get(("entry", name), np.array([getattr(entry, name)]))
        for name in ("longitude", "latitude")
    ]
    starts = np.array(list(product(*axes_)))
    tracks = np.array([_great_circle(lon, lat, target) for lon, lat in starts])
    figure = new_figure(SIZE[0], 2.8)
    bundle = TrackBundle(tracks[:, 0], tracks[:, 1], tracks[:, :, -1], COLOUR, "o", 0.8, 1.0)
    draw_ground_tracks(figure.subplots(), mission, [bundle])
    return figure


def _great_circle(longitude: float, latitude: float, target: Any) -> Array:
    """Longitude and latitude (2, k; rad) from a point to the target, on the point's own turn."""
    away = great_circle_distance(longitude, latitude, target.longitude, target.latitude, 1.0)
    azimuth = bearing(longitude, latitude, target.longitude, target.latitude)
    track = destination(longitude, latitude, azimuth, np.linspace(0.0, float(away), TRACK_POINTS))
    return np.array([on_turn_of(track[0], longitude), track[1]])


@draw.register
def _of_trajectory(optimum: Trajectory) -> Figure:
    times = np.linspace(0.0, optimum.final_time, CURVE_POINTS)
    figure, (left, right) = _two_panels(times, optimum.at(times)[0])
    nodes = optimum.states
    left.plot(SPEED.shown(nodes[3]), ALTITUDE.shown(nodes[0]), "o", color=COLOUR, markersize=2.5)
    for angle in nodes[BANK:]:
        right.plot(optimum.times, BANK_ANGLE.shown(angle), "o", color=COLOUR, markersize=2.5)
    return figure


@draw.register
def _of_reference(reference: Reference) -> Figure:
    return _two_panels(reference.times, reference.layout.flight_states(reference.rows))[0]


def _two_panels(times: Array, states: Array) -> tuple[Figure, tuple[Axes, Axes]]:
    """Altitude over speed, and bank angle over time; with it the angle of attack, if it is steered."""
    figure = new_figure(*SIZE)
    left, right = figure.subplots(1, 2)
    left.plot(SPEED.shown(states[3]), ALTITUDE.shown(states[0]), color=COLOUR)
    left.set(xlabel=SPEED.label, ylabel=ALTITUDE.label)
    left.invert_xaxis()  # as it is flown
    right.plot(times, BANK_ANGLE.shown(states[BANK]), color=COLOUR)
    right.set(xlabel="Time (s)", ylabel=BANK_ANGLE.label)
    for angle in states[ANGLE_OF_ATTACK:]:
        right.plot(times, BANK_ANGLE.shown(angle), color=COLOUR, linestyle="--")
        right.set_ylabel("Bank angle, – – α (deg)")
    return figure, (left, right)


@draw.register
def _of_flights(flights: Flights) -> Figure:
    figure = new_figure(*SIZE)
    left, right = figure.subplots(1, 2)
    draw_end_points(left, flights, COLOUR)
    distances, share = share_within(flights, CURVE_POINTS)
    right.step(KILO * distances, 100.0 * share, color=COLOUR, where="post")
    right.set(xscale="log", ylim=(0.0, 102.0), xlabel="Miss (km)", ylabel="Flights within it (%)")
    return figure


@draw.register
def _of_verdict(verdict: Verdict) -> Figure:
    shares = {
        r: Estimate(f.percent, 100.0 * f.low, 100.0 * f.high) for r, f in verdict.within.items()
    }
    figure, axes = _whiskers(shares, "Flights within it, with 95 % interval (%)")
    axes.set_xlim(-2.0, 102.0)
    return figure


@draw.register
def _of_difference(difference: PairedDifference) -> Figure:
    shares = {
        radius: Estimate(*(100.0 * x for x in vars(share.difference).values()))
        for radius, share in difference.within.items()
    }
    figure, axes = _whiskers(shares, "Difference of the shares within it (% points)")
    axes.axvline(0.0, color=INK, linewidth=1.0)
    return figure


def _whiskers(shares: dict[float, Estimate], label: str) -> tuple[Figure, Axes]:
    """A point with its interval for each radius (m), the least on top."""
    figure = new_figure(SIZE[0], 0.9 + 0.32 * len(shares))
    axes = figure.subplots()
    for row, one in enumerate(shares.values()):
        axes.plot([one.low, one.high], [row, row], color=COLOUR, linewidth=2.0)
        axes.plot(one.value, row, "o", color=COLOUR, markersize=5)
    axes.set_yticks(range(len(shares)), [f"{radius * KILO:g} km" for radius in shares])
    axes.set(ylim=(len(shares) - 0.5, -0.5), xlabel=label)
    return figure, axes
