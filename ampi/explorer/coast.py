"""Coast lines in a window of longitude and latitude: Natural Earth's land, cut at the window's edges.

Each ring is cut by one edge after the other (Sutherland & Hodgman 1974); what it leaves along an edge is
the edge, so that land stays land where the window cuts it. A window may lie on any turn of longitude.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SLIVER = 1e-6  # square degrees: what runs along the edges to and fro is none
EDGES = (("west", 0, 1), ("east", 0, -1), ("south", 1, 1), ("north", 1, -1))
SOUTH_POLE = -90.0  # around which Antarctica's ring runs, and no other
TURNS = (-360.0, 0.0, 360.0)  # degrees, that a ring may be away from the window


def land(window: Mapping[str, float]) -> list[Array]:
    """Rings (k, 2) of land, degrees of longitude and latitude, inside a window.

    `window` has west, east, south and north (deg), west < east.
    """
    found = []
    for ring in _rings():
        for turn in TURNS:
            moved = ring + np.array([turn, 0.0])
            low, high = moved.min(axis=0), moved.max(axis=0)
            if (
                low[0] < window["east"]
                and high[0] > window["west"]
                and low[1] < window["north"]
                and high[1] > window["south"]
            ):
                found.append(clipped(moved, window))
    return [ring for ring in found if len(ring) and _area(ring) > SLIVER]


def clipped(ring: Array, window: Mapping[str, float]) -> Array:
    """A polygon (k, 2), its first point not repeated, cut at the four edges of a window."""
    for name, axis, side in EDGES:
        if len(ring):
            ring = _cut(ring, axis, window[name], side)
    return ring


def _cut(ring: Array, axis: int, bound: float, side: int) -> Array:
    """What of a polygon lies on the inner side of an edge."""
    found, beyond = [], side * (ring[:, axis] - bound)
    for k in range(len(ring)):
        before, here = beyond[k - 1], beyond[k]
        if before * here < 0.0:
            share = before / (before - here)
            crossing = ring[k - 1] + share * (ring[k] - ring[k - 1])
            crossing[axis] = bound
            found.append(crossing)
        if here >= 0.0:
            found.append(ring[k])
    return np.array(found).reshape(-1, 2)


def _area(ring: Array) -> float:
    (x, y), (u, v) = ring.T, np.roll(ring, -1, axis=0).T
    return 0.5 * abs(float(np.sum(x * v - u * y)))


@cache
def _rings() -> tuple[Array, ...]:
    text = files(__package__).joinpath("natural_earth_land.json").read_text("utf-8")
    rings = [np.array(ring).reshape(-1, 2) for ring in json.loads(text)["rings"]]
    return tuple(_on_one_turn(0.01 * np.cumsum(ring, axis=0)) for ring in rings)


def _on_one_turn(ring: Array) -> Array:
    """Without the jump at 180° and the repeated point; a ring around the pole is closed along it."""
    ring[:, 0] = np.unwrap(ring[:, 0], period=360.0)
    if abs(ring[-1, 0] - ring[0, 0]) < 180.0:
        return ring[:-1]
    return np.concatenate([ring, [[ring[-1, 0], SOUTH_POLE], [ring[0, 0], SOUTH_POLE]]])
