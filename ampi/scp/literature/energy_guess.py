"""The guess over energy: Liu, Shen, Lu 2015, Remark 6, kept within the altitude bounds.

Remark 6 draws straight lines over energy. Its altitude lies up to 10 km below the path limits of the
X-33, where the drag is four times what it can be, and the first linearised flights do not reach the
target. The bounds are known beforehand (Liu Eq. 14), so the altitude is lifted above them, and the
great circle to the target is travelled as that altitude implies.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.physics.angles import on_turn_of
from ampi.physics.planet import bearing
from ampi.physics.state import ALTITUDE, SPEED
from ampi.scp.literature.coast import Coast
from ampi.scp.literature.energy_domain import EnergyDomain

Array = NDArray[np.float64]

CLEARANCE = 2e3  # m, [X] above the path limits
SLOPE = np.radians(-0.1)  # Remark 6, flight-path angle


def lifted_lines(form: EnergyDomain, level: Coast, s: Array) -> Array:
    """States (n, 5), SI and rad, at the energies s (n,); `level` is the flight until it levels."""
    altitude = _altitude(form, level, s)
    travelled = form.ground_range(s, altitude)
    longitude, latitude, azimuth = _great_circle(form, travelled / travelled[-1])
    states = np.column_stack([altitude, longitude, latitude, np.full(len(s), SLOPE), azimuth])
    states[0] = form.entry * form.state_scale
    return states


def _altitude(form: EnergyDomain, level: Coast, s: Array) -> Array:
    """Zero bank until level, a straight line to the target, both within the bounds (n,), m."""
    flown = form.energy(level.states[ALTITUDE], level.states[SPEED]) - form.first_energy
    last = form.mission.target.altitude
    descent = np.interp(s, flown, level.states[ALTITUDE])
    glide = np.interp(s, [flown[-1], s[-1]], [level.states[ALTITUDE, -1], last])
    altitude = np.where(s < flown[-1], descent, glide)
    altitude = np.maximum(altitude, form.altitude_floors(s).max(axis=0) + CLEARANCE)
    ceiling = form.altitude_ceiling(s)
    altitude = altitude if ceiling is None else np.minimum(altitude, ceiling)
    return np.append(altitude[:-1], last)


def _great_circle(form: EnergyDomain, share: Array) -> tuple[Array, Array, Array]:
    """Longitude, latitude and azimuth (n,) at `share` of the way from the handover to the target."""
    target, first = form.mission.target, form.coast.handover
    ends = np.array([first[1:3], [target.longitude, target.latitude]])
    a, b = (np.array([np.cos(q) * np.cos(p), np.cos(q) * np.sin(p), np.sin(q)]) for p, q in ends)
    angle = np.arccos(a @ b)
    x, y, z = (
        np.outer(a, np.sin((1.0 - share) * angle)) + np.outer(b, np.sin(share * angle))
    ) / np.sin(angle)
    longitude, latitude = np.unwrap(np.arctan2(y, x)), np.arcsin(z)
    longitude += on_turn_of(longitude[0], ends[0, 0]) - longitude[0]
    azimuth = bearing(longitude[:-1], latitude[:-1], target.longitude, target.latitude)
    azimuth = np.unwrap(azimuth)
    azimuth += on_turn_of(azimuth[0], first[5]) - azimuth[0]
    return longitude, latitude, np.append(azimuth, azimuth[-1])
