"""Ground tracks on a map, with a window on the target in kilometres beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.physics.angles import TURN, on_turn_of
from ampi.physics.planet import bearing, destination, great_circle_distance
from ampi.report.figures.panels import (
    FIGURE_WIDTH,
    draw_bundle,
    line_key,
    marker_key,
    number_on_one_turn,
)
from ampi.report.figures.style import INK, LIMIT_COLOUR, TARGET_COLOUR, new_figure
from ampi.report.quantities import EAST, LATITUDE, LONGITUDE, NORTH

Array = NDArray[np.float64]
Points = tuple[Array, Array]

SMALLEST_WINDOW = 50.0  # m, half-width
POLAR = float(np.radians(80.0))  # latitude beyond which meridians are no map's verticals


@dataclass(frozen=True, eq=False)
class TrackBundle:
    """Longitudes and latitudes (n, k; rad) of n tracks that end in their last finite point."""

    longitude: Array
    latitude: Array
    final: Array  # (n, 2), rad: where each track ends; NaN if it does not
    colour: str
    marker: str
    width: float = 0.5
    alpha: float = 0.3

    def final_offsets(self, mission: Mission) -> Array:
        """Finite end points (≤ n, 2) east and north of the target (m), on its tangent plane."""
        offsets = tangent_plane(mission, self.final[:, 0], self.final[:, 1])
        return offsets[np.isfinite(offsets).all(axis=1)]


def tangent_plane(mission: Mission, longitude: Array, latitude: Array) -> Array:
    """Offsets east and north of the target (m), true in distance and bearing, on a last axis."""
    target = mission.target.longitude, mission.target.latitude
    radius = mission.flight_model.planet.equatorial_radius
    away = great_circle_distance(*target, longitude, latitude, radius)
    azimuth = bearing(*target, longitude, latitude)
    return np.stack([away * np.sin(azimuth), away * np.cos(azimuth)], axis=-1)


def target_longitude(mission: Mission, ends: Array) -> float:
    """The target's longitude (rad) on the turn of the tracks that end at `ends` (n,)."""
    ends = ends[np.isfinite(ends)]
    near = np.median(ends) if len(ends) else mission.entry.longitude
    return float(on_turn_of(mission.target.longitude, near))


def map_and_window() -> tuple[Figure, Axes, Axes]:
    """A figure with a panel for the map and one for the window: an inset would hide tracks."""
    figure = new_figure(FIGURE_WIDTH, 4.6)
    chart, window = figure.subplots(1, 2, width_ratios=(2.3, 1.0))
    return figure, chart, window


def draw_ground_tracks(axes: Axes, mission: Mission, bundles: list[TrackBundle]) -> None:
    """Tracks, entry points, no-fly zones and target, true to shape at the middle of the map.

    In longitude and latitude (deg), or, where a track comes near a pole, in kilometres from the target.
    """
    latitudes = np.concatenate([b.latitude.ravel() for b in bundles])
    middle = float(0.5 * (np.nanmin(latitudes) + np.nanmax(latitudes)))
    if np.nanmax(np.abs(latitudes)) > POLAR:
        place = plane_around_target(mission)
        axes.set(xlabel=EAST.label, ylabel=NORTH.label)
        axes.set_aspect("equal", adjustable="datalim")
    else:
        place = in_degrees
        axes.set(xlabel=LONGITUDE.label, ylabel=LATITUDE.label)
        axes.set_aspect(1.0 / np.cos(middle), adjustable="datalim")
        number_on_one_turn(axes.xaxis)
    for b in bundles:
        x, y = place(b.longitude, b.latitude)
        draw_bundle(axes, x, y, b.colour, width=b.width, alpha=b.alpha)
        axes.plot(x[:, 0], y[:, 0], ".", color=INK, markersize=3.5, zorder=3)
    ends = np.concatenate([b.final[:, 0] for b in bundles])
    target = target_longitude(mission, ends)
    for x, y in zone_edges(mission, float(np.nanmean(bundles[0].longitude)), place):
        axes.plot(x, y, color=LIMIT_COLOUR, linewidth=1.2, linestyle=(0, (5, 3)))
    x, y = place(np.array([target]), np.array([mission.target.latitude]))
    axes.plot(x, y, "*", color=TARGET_COLOUR, markersize=11, zorder=4)


def draw_target_window(
    axes: Axes, mission: Mission, bundles: list[TrackBundle], *, percentile: float = 100.0
) -> None:
    """The ground around the target that holds `percentile` of the end points of every bundle."""
    offsets = [b.final_offsets(mission) for b in bundles]
    distances = [np.linalg.norm(o, axis=1) for o in offsets]
    reach = max((float(np.percentile(d, percentile)) for d in distances if len(d)), default=0.0)
    half = max(1.2 * reach, SMALLEST_WINDOW) * EAST.per_si
    for b, offset in zip(bundles, offsets, strict=True):
        east, north = plane_around_target(mission)(b.longitude, b.latitude)
        draw_bundle(axes, east, north, b.colour, width=b.width, alpha=b.alpha)
        east, north = EAST.shown(offset[:, 0]), NORTH.shown(offset[:, 1])
        axes.plot(east, north, b.marker, color=b.colour, markersize=2.5, alpha=0.7, zorder=3)
    axes.plot(0.0, 0.0, "*", color=TARGET_COLOUR, fillstyle="none", markersize=10, zorder=4)
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set(xlabel=EAST.label, ylabel=NORTH.label)
    axes.locator_params(nbins=5)
    edge = half / EAST.per_si
    beyond = sum(int(np.count_nonzero(np.abs(o).max(axis=1) > edge)) for o in offsets if len(o))
    ended = sum(map(len, offsets))
    axes.set_title(f"{beyond} of {ended} ends outside" if beyond else "At the target")


def track_keys(mission: Mission) -> list[Line2D]:
    """Legend entries of entry points, target and zones."""
    keys = [marker_key("entry point", "."), marker_key("target", "*", TARGET_COLOUR)]
    zone = line_key("no-fly zone", LIMIT_COLOUR, dashed=True, width=1.2)
    return [*keys, zone] if mission.no_fly_zone else keys


def in_degrees(longitude: Array, latitude: Array) -> Points:
    """A chart of longitude over latitude."""
    return LONGITUDE.shown(longitude), LATITUDE.shown(latitude)


def plane_around_target(mission: Mission) -> Callable[[Array, Array], Points]:
    """A chart of kilometres north over kilometres east of the target."""

    def place(longitude: Array, latitude: Array) -> Points:
        offsets = tangent_plane(mission, longitude, latitude)
        return EAST.shown(offsets[..., 0]), NORTH.shown(offsets[..., 1])

    return place


def zone_edges(
    mission: Mission, near: float, place: Callable[[Array, Array], Points]
) -> list[Points]:
    """Edges of the no-fly zones, on the turn of longitude `near` (rad)."""
    radius = mission.flight_model.planet.equatorial_radius
    around = np.linspace(0.0, TURN, 181)
    return [
        place(
            *destination(
                on_turn_of(zone.longitude, near), zone.latitude, around, zone.radius / radius
            )
        )
        for zone in mission.no_fly_zone
    ]
