"""What drag-tracking laws share: the look-up by energy, the lateral logic, bank angle to bank rate.

A drag profile D(E) over the energy fixes the range that is left, for without lateral motion

    dR = V cos γ dt = −cos γ dE/D,   E = V²/2 − μ/r,   dE/dt = −D V,                 (1)

whatever the time: a flight that is late on its profile is on its profile. Before the air is felt E is
constant and tells nothing: a steep entry meets the air half a minute after the entry interface, and one
that is 1 % slow would be looked up there from the first second on. There the look-up goes by time. What
(1) leaves out, the planet's rotation and J2, is the same for a flight and its reference.

The bank angle's magnitude is for drag; its sign is the reference's, unless the heading has left

    χ = ψ − ψ_ref + y / max(s, s₀),   |χ| ≤ deadband,                                 (2)

with y the distance to the right of the reference and s its range to go: χ is the angle by which the rest
of the reference, flown from here, would have to be turned to end where it does. Then the sign is the one
that turns back, until half of the deadband is reached.

Bank is slow: in thin air the answer takes a minute. The drag itself answers the angle of attack at once,

    δα = −e / (∂ ln D/∂α),   e = ln D − ln D_ref,                                     (3)

of the drag D that the vehicle would have without δα: so the drag, and with it the range, is near the
reference's while the bank brings e back, and δα with it. A smaller angle takes away lift about as it
takes away drag: it goes only as far as the bank angle leaves lift to spare, or the flight would sink
into the drag that it avoids.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ampi.onboard.row_layout import DRAG_TRACKING, N_STATES, RowLayout
from ampi.tracking.law import Told
from ampi.tracking.linear_quadratic import wrapped

Array = NDArray[np.float64]

ALTITUDE, LONGITUDE, LATITUDE, SPEED, FLIGHT_PATH_ANGLE, AZIMUTH, BANK = range(N_STATES)
LOG_DRAG, LIFT_TO_DRAG, SCALE_HEIGHT, DRAG_SLOPE, RANGE_TO_GO = (
    DRAG_TRACKING.index(name)
    for name in ("log_drag", "lift_to_drag", "drag_scale_height", "drag_slope", "range_to_go")
)
DEGREE = float(np.pi / 180.0)
LEAST_SLOPE = 0.1  # 1/rad: an angle of attack that changes the drag less is left alone
BEFORE_AIR = -1e9  # J/kg: below −E of whatever enters; times are counted from it
DISTINCT = 1e-6  # s or J/kg between points of a reference, lest two are the same


@dataclass(frozen=True, kw_only=True)
class LateralLogic:
    """When the bank angle leaves the sign of the reference's, Eq. (2), and how it turns."""

    deadband: float = 0.5 * DEGREE  # rad of χ
    least_range: float = 100e3  # m: s₀, where a miss is no longer turned into a heading
    # slow beside any actuator: a turn that counts on the whole acceleration overshoots behind a lag
    turning: float = 0.2  # 1/s: bank rate over the bank angle that is missing
    braking: float = 0.3 * DEGREE  # rad/s², with which a turn ends

    def side(self, at: Array, state: Array, radius: float, turning: Array) -> Array:
        """Sign (n,) of the bank angle; `turning` (n,), the one that turns back or 0, is kept."""
        error = self.heading_error(at, state, radius)
        size = np.abs(error)
        begins = size > self.deadband
        goes_on = (turning * error < 0.0) & (size > 0.5 * self.deadband)
        turning[:] = np.where(begins, -np.sign(error), np.where(goes_on, turning, 0.0))
        return np.where(turning != 0.0, turning, np.where(at[BANK] < 0.0, -1.0, 1.0))

    def heading_error(self, at: Array, state: Array, radius: float) -> Array:
        """χ (n,) of Eq. (2), rad; positive where the flight is to turn left."""
        east = wrapped(state[LONGITUDE] - at[LONGITUDE]) * np.cos(at[LATITUDE])
        north = state[LATITUDE] - at[LATITUDE]
        right = radius * (east * np.cos(at[AZIMUTH]) - north * np.sin(at[AZIMUTH]))
        to_go = np.maximum(at[RANGE_TO_GO], self.least_range)
        return wrapped(state[AZIMUTH] - at[AZIMUTH]) + right / to_go

    def bank_rate(self, wanted: Array, wanted_rate: Array, bank: Array) -> Array:
        """Bank rate (rad/s) towards a bank angle that moves: its rate, and what ends in it braking."""
        missing = wanted - bank
        size = np.abs(missing)
        approach = np.minimum(self.turning * size, np.sqrt(2.0 * self.braking * size))
        return wanted_rate + np.copysign(approach, missing)


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """Drag and lift, as sensed where they are, else the reference's."""

    drag: Array  # m/s²
    lift: Array  # m/s²
    known: NDArray[np.bool_]

    @classmethod
    def of(cls, at: Array, told: Told) -> Sensed:
        """From the accelerometer (3, n)."""
        along, up, right = told.sensed
        drag, lift = -along, np.sqrt(up * up + right * right)
        known = (drag > 0.0) & (drag < np.inf) & (lift < np.inf)
        reference = np.exp(at[LOG_DRAG])
        return cls(
            drag=np.where(known, drag, reference),
            lift=np.where(known, lift, reference * np.abs(at[LIFT_TO_DRAG])),
            known=known,
        )


@dataclass(frozen=True, kw_only=True)
class DragReference:
    """The look-up along a drag profile; what the laws add is `command`."""

    layout: ClassVar[RowLayout] = DRAG_TRACKING

    gravitational_parameter: float  # m³/s², of the planet
    radius: float  # m, from which altitudes count
    modulates: bool = False  # whether the angle of attack answers the drag, Eq. (3)
    felt_drag: float = 0.5  # m/s²: above it (0.05 g) the air is felt
    lateral: LateralLogic = LateralLogic()

    def along(self, times: Array, rows: Array) -> Array | None:
        """Times before the air is felt, then energies lost, (n, m); strictly increasing."""
        drag = np.exp(rows[..., LOG_DRAG])
        felt = np.maximum.accumulate(drag > self.felt_drag, axis=1)
        lost = -self._energy(rows[..., ALTITUDE], rows[..., SPEED])
        raw = np.where(felt, lost, BEFORE_AIR + times)
        increasing: Array = np.maximum.accumulate(raw, axis=1)
        return increasing + DISTINCT * np.arange(raw.shape[1])

    def now(self, clock: Any, told: Told) -> Any:
        """The clock or the energy lost; a drag that is not known counts as felt."""
        lost = -self._energy(told.state[ALTITUDE], told.state[SPEED])
        return np.where(-told.sensed[0] <= self.felt_drag, BEFORE_AIR + clock, lost)

    def size(self, at: Array, sensed: Sensed, cosine: Array) -> Array:
        """Bank angle (n,) without sign of this cosine; the reference's until the air is felt."""
        own, felt = np.abs(at[BANK]), sensed.drag > self.felt_drag
        cosine = np.minimum(np.maximum(cosine, -1.0), 1.0)
        return np.where(felt & np.isfinite(cosine), np.arccos(cosine), own)

    def error(self, at: Array, sensed: Sensed, change: Array) -> Array:
        """e of Eq. (3), (n,); `change` is the last δα. 0 where the drag is not known."""
        off = np.log(sensed.drag / np.exp(at[LOG_DRAG])) - at[DRAG_SLOPE] * change
        return np.where(sensed.known, off, 0.0)

    def modulation(self, at: Array, sensed: Sensed, error: Array, cosine: Array) -> Array:
        """δα (n,), rad, of Eq. (3), beside a bank angle of this `cosine`."""
        if not self.modulates:
            return np.zeros_like(error)
        slope = at[DRAG_SLOPE]
        steep = np.maximum(slope, LEAST_SLOPE)
        acts = (sensed.drag > self.felt_drag) & (slope >= LEAST_SLOPE) & np.isfinite(cosine)
        wanted = np.maximum(-error, -np.maximum(1.0 - cosine, 0.0)) / steep
        return np.where(acts, wanted, 0.0)

    def steered(self, at: Array, told: Told, size: Array, turning: Array) -> Array:
        """Bank rate (rad/s) towards a bank angle of this `size`, on the side of the lateral logic."""
        side = self.lateral.side(at, told.state, self.radius, turning)
        own = np.where(at[BANK] < 0.0, -1.0, 1.0)
        reference_rate = at[self.layout.bank_rate]
        rate = self.lateral.bank_rate(side * size, side * own * reference_rate, told.state[BANK])
        return np.where(np.isfinite(rate), rate, reference_rate)

    def _energy(self, altitude: Array, speed: Array) -> Array:
        """E of Eq. (1), J/kg."""
        return 0.5 * speed * speed - self.gravitational_parameter / (self.radius + altitude)
