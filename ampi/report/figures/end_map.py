"""Where flights end, on a map around the target, at distances along great circles.

End points lie at their miss from the target, along and across the nominal track, so that points,
ellipses and circles are measured alike wherever the target of a flight was.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.physics.angles import TURN, on_turn_of
from ampi.physics.planet import bearing, destination
from ampi.physics.state import LATITUDE as LATITUDE_ROW
from ampi.physics.state import LONGITUDE as LONGITUDE_ROW
from ampi.report.figures.campaign import compared
from ampi.report.figures.ground_track import POLAR, in_degrees, plane_around_target
from ampi.report.figures.panels import line_key, marker_key, number_on_one_turn, place_legend
from ampi.report.figures.scheme_style import style_of, styles
from ampi.report.figures.style import INK, TARGET_COLOUR, house_style
from ampi.report.figures.world_panels import is_lowest, world_panels
from ampi.report.quantities import EAST, KILO, LATITUDE, LONGITUDE, NORTH
from ampi.report.scheme_groups import by_world, first_law
from ampi.simulation.estimates.ellipses import (
    Ellipse,
    Place,
    containing_ellipse,
    covariance_ellipse,
)
from ampi.simulation.flights import Flights

Array = NDArray[np.float64]

ROOM = 1.12  # of the window, over what it is to hold
CONTAINING_DASHES = (0.0, (4.0, 2.0))


def shown(campaigns: Mapping[str, Flights]) -> dict[str, dict[str, Flights]]:
    """World → what its panel shows: nominal tracking and AMPI by the first law."""
    return {world: compared(first_law(own)) for world, own in by_world(campaigns).items()}


@house_style
def end_map(mission: Mission, campaigns: Mapping[str, Flights]) -> Figure:
    """A panel per world, each at its own scale, with the circles of the mission's radii."""
    worlds = shown(campaigns)
    figure, panels = world_panels(list(worlds), 3.4)
    for number, (axes, flown) in enumerate(zip(panels, worlds.values(), strict=True)):
        _draw(axes, mission, flown)
        if not is_lowest(panels, number):
            axes.set_xlabel("")
    drawn = styles(f for flown in worlds.values() for f in flown.values())
    keys = [marker_key(name, style.marker, style.colour) for name, style in drawn.items()]
    ellipse, containing = line_key("95 % covariance ellipse", INK, width=1.6), line_key("", INK)
    containing.set(linestyle=CONTAINING_DASHES, linewidth=1.6, label="holds 95 % of all flights")
    text = ", ".join(f"{radius * KILO:g}" for radius in mission.target.judged_radii)
    radii = line_key(f"{text} km", "#888888", width=0.8)
    keys += [marker_key("target", "*", TARGET_COLOUR), ellipse, containing, radii]
    place_legend(figure, keys)
    return figure


def place_of(mission: Mission, flights: Flights) -> Place:
    """The mission's target, and the azimuth of the nominal track over it, as the misses have it.

    A miss is `along` and `across` that azimuth, and its bearing is known; the longest tells it best.
    """
    target, family = mission.target, mission.family(flights.parameters)
    radius = mission.flight_model.planet.equatorial_radius
    size = np.where(np.isfinite(flights.miss), flights.miss, -1.0)
    i = int(np.argmax(size))
    azimuth = 0.0
    if size[i] > 0.0:
        longitude, latitude = family.target("longitude")[i], family.target("latitude")[i]
        end = flights.final_states[i, [LONGITUDE_ROW, LATITUDE_ROW]]
        off = np.arctan2(flights.across[i], flights.along[i])
        azimuth = float(bearing(longitude, latitude, *end) - off)
    return Place(target.longitude, target.latitude, azimuth, radius)


def _draw(axes: Axes, mission: Mission, flown: Mapping[str, Flights]) -> None:
    target = place_of(mission, next(iter(flown.values())))
    chart = _chart(axes, mission, target)
    ends = {k: np.where(f.reached, (f.across, f.along), np.nan) for k, f in flown.items()}
    ellipses = {k: (covariance_ellipse(*e), containing_ellipse(*e)) for k, e in ends.items()}
    half = ROOM * max(
        min(mission.target.judged_radii),
        *(_reach(one) for pair in ellipses.values() for one in pair if one is not None),
        0.0,
    )
    beyond = 0
    for name, flights in flown.items():
        style, (across, along) = style_of(flights), ends[name]
        inside = np.hypot(across, along) <= half
        beyond += int(np.count_nonzero(~inside))
        x, y = chart(*_on_map(across[inside], along[inside], target))
        axes.plot(
            x, y, style.marker, color=style.colour, markersize=3.5, alpha=0.5, fillstyle="none"
        )
        for ellipse, dashes in zip(ellipses[name], ("-", CONTAINING_DASHES), strict=True):
            if ellipse is not None:
                edge = chart(*ellipse.on_map(target))
                axes.plot(*edge, color=style.colour, linestyle=dashes, linewidth=1.6, zorder=3)
    _circles(axes, mission, target, chart, half)
    axes.plot(
        *chart(np.array([target.longitude]), np.array([target.latitude])),
        "*",
        color=TARGET_COLOUR,
        fillstyle="none",
        markersize=10,
        zorder=4,
    )
    if beyond:
        axes.set_title(
            f"{axes.get_title()}\n{beyond} flight{'s' if beyond > 1 else ''} outside",
            parse_math=False,
        )


def _chart(
    axes: Axes, mission: Mission, target: Place
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Degrees, true to shape at the target; near a pole kilometres from the target."""
    if abs(target.latitude) > POLAR:
        axes.set(xlabel=EAST.label, ylabel=NORTH.label, aspect="equal")
        return plane_around_target(mission)
    axes.set(xlabel=LONGITUDE.label, ylabel=LATITUDE.label, aspect=1.0 / np.cos(target.latitude))
    number_on_one_turn(axes.xaxis)

    def chart(longitude: Array, latitude: Array) -> tuple[Array, Array]:
        return in_degrees(on_turn_of(longitude, target.longitude), latitude)

    return chart


def _on_map(across: Array, along: Array, target: Place) -> tuple[Array, Array]:
    """Longitude and latitude (rad) of misses (m)."""
    azimuth, angle = target.azimuth + np.arctan2(across, along), np.hypot(across, along)
    return destination(target.longitude, target.latitude, azimuth, angle / target.radius)


def _reach(ellipse: Ellipse) -> float:
    """Distance (m) of its farthest point from the target."""
    return float(np.max(np.hypot(*ellipse.outline())))


def _circles(
    axes: Axes,
    mission: Mission,
    target: Place,
    chart: Callable[[Array, Array], tuple[Array, Array]],
    half: float,
) -> None:
    """Circles of the mission's radii that fit, and a window of `half` (m) around the target."""
    around = np.linspace(0.0, TURN, 181)

    def edge(radius: float) -> tuple[Array, Array]:
        place = destination(target.longitude, target.latitude, around, radius / target.radius)
        return chart(*place)

    last = 0.0
    for radius in mission.target.judged_radii:
        if radius > half:
            continue
        x, y = edge(radius)
        axes.plot(x, y, color="#888888", linewidth=0.8, zorder=2)
        if radius - last > 0.15 * half:  # else its label would lie on the last one
            axes.annotate(
                f"{radius * KILO:g} km",
                (x[0], y[0]),
                ha="center",
                va="bottom",
                fontsize=8.0,
                zorder=5,
            ).set_path_effects([withStroke(linewidth=2.5, foreground="white")])
            last = radius
    x, y = edge(half)
    axes.set(xlim=(x.min(), x.max()), ylim=(y.min(), y.max()))
    axes.locator_params(nbins=4)
