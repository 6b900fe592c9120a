"""Wind: horizontal motion of the air over the ground, and what it does to lift and drag.

With the wind w = (w_E, w_N) the vehicle moves through the air at a = V − w. In the axes of its track,
horizontal forward, up and horizontal right,

    a = (f, v, s),  f = V cos γ − w_N cos ψ − w_E sin ψ,  v = V sin γ,  s = w_N sin ψ − w_E cos ψ. (1)

Drag acts against a. Lift acts across it, banked by σ about a from the vertical plane that holds a: with
A = |a| and H = √(f² + s²) the two directions across are

    right_a = (−s, 0, f) / H,     up_a = right_a × a / A = (−v f, H², −v s) / (H A),

so that −D a/A + L (cos σ up_a + sin σ right_a) has the components

    F = −p f − r s,     U = (L cos σ H − D v) / A,     S = −p s + r f,
    p = (D + L cos σ v / H) / A,     r = L sin σ / H.                                                (2)

Turned by γ about the right, along the velocity over the ground and across it in the vertical plane:

    along = F cos γ + U sin γ,     up = U cos γ − F sin γ,     right = S.                            (3)

In still air f = V cos γ, s = 0 and A = V, and (3) is (−D, L cos σ, L sin σ).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ampi.physics.state import ALTITUDE, AZIMUTH, FLIGHT_PATH_ANGLE, SPEED


class Wind(Protocol):
    """Velocity of the air over the ground, as plain ufunc expressions."""

    def components(self, altitude: Any) -> tuple[Any, Any]:
        """(w_E, w_N) (m/s), towards east and north, at geometric `altitude` (m)."""
        ...


class Track(NamedTuple):
    """Direction of the velocity over the ground."""

    sin_fpa: Any
    cos_fpa: Any
    sin_azi: Any
    cos_azi: Any

    @classmethod
    def of(cls, state: Any) -> Track:
        """That of a state."""
        fpa, azimuth = state[FLIGHT_PATH_ANGLE], state[AZIMUTH]
        return cls(np.sin(fpa), np.cos(fpa), np.sin(azimuth), np.cos(azimuth))


@dataclass(frozen=True)
class AirVelocity:
    """Velocity through the air in the axes of the track, Eq. (1) (m/s)."""

    forward: Any
    up: Any
    right: Any
    horizontal: Any  # H
    speed: Any  # A

    @classmethod
    def of(cls, wind: Wind, state: Any, track: Track) -> AirVelocity:
        """That of a state."""
        east, north = wind.components(state[ALTITUDE])
        forward = state[SPEED] * track.cos_fpa - north * track.cos_azi - east * track.sin_azi
        up = state[SPEED] * track.sin_fpa
        right = north * track.sin_azi - east * track.cos_azi
        horizontal = forward * forward + right * right
        return cls(forward, up, right, np.sqrt(horizontal), np.sqrt(horizontal + up * up))

    def along_the_track(
        self, drag: Any, lift_up: Any, lift_right: Any, track: Track
    ) -> tuple[Any, Any, Any]:
        """Eqs. (2), (3) of D, L cos σ and L sin σ (m/s²)."""
        against = (drag + lift_up * self.up / self.horizontal) / self.speed
        across = lift_right / self.horizontal
        forward = -against * self.forward - across * self.right
        upward = (lift_up * self.horizontal - drag * self.up) / self.speed
        return (
            forward * track.cos_fpa + upward * track.sin_fpa,
            upward * track.cos_fpa - forward * track.sin_fpa,
            across * self.forward - against * self.right,
        )
