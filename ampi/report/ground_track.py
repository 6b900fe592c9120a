"""Ground tracks in longitude and latitude, with a window on the target in kilometres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.physics.angles import on_turn_of
from ampi.physics.planet import bearing, great_circle_distance
from ampi.report.look import INK, TARGET_COLOUR
from ampi.report.panels import draw_bundle, marker_key
from ampi.report.quantities import DEGREES, EAST, LATITUDE, LONGITUDE, NORTH

Array = NDArray[np.float64]

INSET_SIZE = (0.28, 0.42)  # fractions of the panel
SMALLEST_WINDOW = 50.0  # m, half-width


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


def draw_ground_tracks(axes: Axes, mission: Mission, bundles: list[TrackBundle]) -> None:
    """Tracks, entry points and target; degrees, true to shape at the mean latitude."""
    for b in bundles:
        longitude, latitude = LONGITUDE.shown(b.longitude), LATITUDE.shown(b.latitude)
        draw_bundle(axes, longitude, latitude, b.colour, width=b.width, alpha=b.alpha)
        axes.plot(longitude[:, 0], latitude[:, 0], ".", color=INK, markersize=3.5, zorder=3)
    ends = np.concatenate([b.final[:, 0] for b in bundles])
    target = (target_longitude(mission, ends) * DEGREES, mission.target.latitude * DEGREES)
    axes.plot(*target, "*", color=TARGET_COLOUR, markersize=11, zorder=4)
    axes.set(xlabel=LONGITUDE.label, ylabel=LATITUDE.label)
    middle = 0.5 * (mission.entry.latitude + mission.target.latitude)
    axes.set_aspect(1.0 / np.cos(middle), adjustable="datalim")


def draw_target_window(
    axes: Axes, mission: Mission, bundles: list[TrackBundle], *, percentile: float = 100.0
) -> None:
    """An inset around the target that holds `percentile` of the end points of every bundle."""
    offsets = [b.final_offsets(mission) for b in bundles]
    distances = [np.linalg.norm(o, axis=1) for o in offsets]
    reach = max((float(np.percentile(d, percentile)) for d in distances if len(d)), default=0.0)
    half = max(1.2 * reach, SMALLEST_WINDOW) * EAST.per_si
    inset = axes.inset_axes(_emptiest_corner(bundles))
    for b, offset in zip(bundles, offsets, strict=True):
        track = tangent_plane(mission, b.longitude, b.latitude)
        draw_bundle(inset, EAST.shown(track[..., 0]), NORTH.shown(track[..., 1]), b.colour)
        east, north = EAST.shown(offset[:, 0]), NORTH.shown(offset[:, 1])
        inset.plot(east, north, b.marker, color=b.colour, markersize=2.5, alpha=0.7, zorder=3)
    inset.plot(0.0, 0.0, "*", color=TARGET_COLOUR, markersize=10, zorder=4)
    inset.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    inset.set_xlabel(EAST.label, fontsize=8.5, labelpad=1)
    inset.set_ylabel(NORTH.label, fontsize=8.5, labelpad=1)
    inset.tick_params(labelsize=8)
    inset.locator_params(nbins=4)
    inset.spines[["top", "right"]].set_visible(True)


def track_keys() -> list[Line2D]:
    """Legend entries of entry points and target."""
    return [marker_key("entry point", "."), marker_key("target", "*", TARGET_COLOUR)]


def _emptiest_corner(bundles: list[TrackBundle]) -> tuple[float, float, float, float]:
    """Bounds of the inset in the corner of the panel that the tracks cross least."""
    points = np.concatenate(
        [np.stack([b.longitude.ravel(), b.latitude.ravel()], axis=1) * DEGREES for b in bundles]
    )
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    inside = (points - low) / np.where(high > low, high - low, 1.0)
    width, height = INSET_SIZE
    corners = [(x, y) for y in (0.16, 0.98 - height) for x in (0.08, 0.98 - width)]
    centres = np.array(corners) + 0.5 * np.array(INSET_SIZE)
    crossed = [np.count_nonzero(np.all(np.abs(inside - c) < 0.3, axis=1)) for c in centres]
    return (*corners[int(np.argmin(crossed))], width, height)
