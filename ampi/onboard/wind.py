"""Wind, horizontal motion of the air over the ground: the equations of ampi/physics/wind.py.

What flies stands by itself; a test holds both together.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class Track(NamedTuple):
    """Direction of the velocity over the ground."""

    sin_fpa: Any
    cos_fpa: Any
    sin_azi: Any
    cos_azi: Any

    @classmethod
    def of(cls, path_angle: Any, azimuth: Any) -> Track:
        """That of two angles (rad)."""
        return cls(np.sin(path_angle), np.cos(path_angle), np.sin(azimuth), np.cos(azimuth))


class AirVelocity(NamedTuple):
    """Velocity through the air in the axes of the track, Eq. (1) there (m/s)."""

    forward: Any
    up: Any
    right: Any
    horizontal: Any
    speed: Any
    track: Track

    @classmethod
    def of(cls, speed: Any, track: Track, winds: tuple[Any, Any]) -> AirVelocity:
        """That at a `speed` over the ground along `track` in `winds` towards east and north (m/s)."""
        east, north = winds
        forward = speed * track.cos_fpa - north * track.cos_azi - east * track.sin_azi
        up = speed * track.sin_fpa
        right = north * track.sin_azi - east * track.cos_azi
        level = forward * forward + right * right
        return cls(forward, up, right, np.sqrt(level), np.sqrt(level + up * up), track)

    def along_the_track(self, drag: Any, lift_up: Any, lift_right: Any) -> tuple[Any, Any, Any]:
        """Eqs. (2), (3) there of D, L cos σ and L sin σ (m/s²): along, up and right."""
        against = (drag + lift_up * self.up / self.horizontal) / self.speed
        across = lift_right / self.horizontal
        forward = -against * self.forward - across * self.right
        upward = (lift_up * self.horizontal - drag * self.up) / self.speed
        return (
            forward * self.track.cos_fpa + upward * self.track.sin_fpa,
            upward * self.track.cos_fpa - forward * self.track.sin_fpa,
            across * self.forward - against * self.right,
        )
