"""The flight as the air sees it: a table of optima in still air serves in air that moves.

Seen from air that moves with the wind w alike everywhere, a flight is one in still air, and the target
drifts by −w: so velocities are taken through the air, and positions moved on by the drift until the
end. The flight ends at a speed over the ground; with the wind from behind that is later in the air, by
Δt = w∥/a, a the deceleration there, and it flies V_f Δt farther. A wind high above the target is not
that below: the drift expected of it fades.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.flight_model import ALTITUDE, AZIMUTH, LATITUDE, LONGITUDE, PATH_ANGLE, SPEED
from ampi.onboard.plausibility import on_turn_of
from ampi.onboard.table import GuidanceTable

Array = NDArray[np.float64]

LAST = 5.0  # s before the end, over which the deceleration there is taken


@dataclass(frozen=True)
class StillAir:
    """Numbers of the end of the nominal optimum, and of the planet (SI)."""

    radius: float
    altitude: float
    speed: float
    deceleration: float
    fade: float  # m

    @classmethod
    def of(cls, table: GuidanceTable, radius: float, fade: float) -> StillAir:
        """From the nominal optimum of a table."""
        final = table.final_time[table.centre]
        nodes = np.repeat(table.values[table.centre].T[None], 2, axis=0)
        ends = table.segments.at(np.full(2, final), nodes, np.array([final - LAST, final]))
        before, end = ends[SPEED].tolist()
        return cls(radius, float(ends[ALTITUDE, 1]), end, (before - end) / LAST, fade)

    def seen(self, navigated: Array, east: Array, north: Array, to_go: Array) -> Array:
        """Navigation (8, n) as seen from air that moves east and north (m/s), `to_go` s to the end."""
        speed, path, azimuth = navigated[[SPEED, PATH_ANGLE, AZIMUTH]]
        level = speed * np.cos(path)
        up, over_ground = speed * np.sin(path), (level * np.sin(azimuth), level * np.cos(azimuth))
        eastwards, northwards = over_ground[0] - east, over_ground[1] - north
        level = np.sqrt(eastwards * eastwards + northwards * northwards)
        above = np.maximum(navigated[ALTITUDE] - self.altitude, 0.0)
        drift = np.exp(-above / self.fade)
        behind = east * np.sin(azimuth) + north * np.cos(azimuth)
        farther = drift * self.speed * behind / self.deceleration
        found = navigated.copy()
        found[SPEED], found[PATH_ANGLE] = np.sqrt(level * level + up * up), np.arctan2(up, level)
        found[AZIMUTH] = azimuth + on_turn_of(np.arctan2(eastwards, northwards) - azimuth, 0.0)
        latitude = navigated[LATITUDE]
        moved_east = drift * east * to_go + farther * np.sin(azimuth)
        moved_north = drift * north * to_go + farther * np.cos(azimuth)
        found[LONGITUDE] += moved_east / (self.radius * np.cos(latitude))
        found[LATITUDE] += moved_north / self.radius
        return found
