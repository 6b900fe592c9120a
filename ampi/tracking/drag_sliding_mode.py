"""Drag tracking by a sliding mode with a disturbance observer.

The error e = ln D − ln D_ref is taken at equal energy, of the drag that the vehicle would have on its
schedule of the angle of attack. At equal energy V dV = −g dh, so that with H the scale height of the
drag at equal speed

    e = −δh/H_E,   1/H_E = 1/H + 2 g/V²,                                                         (1)

and, as dh/dE = −sin γ/D for the flight and for its reference,

    ė = −V (sin γ − (D/D_ref) sin γ_ref)/H_E,                                                    (2)
    ë = −(cos γ/H_E) (L cos σ − L_ref cos σ_ref) + d.                                            (3)

The drag has relative degree two in the lift upwards. e is sensed, ė navigated: the sensed drag is as
rough as the air. With the surface s = ė + λ e the lift that is asked,

    L cos σ = L_ref cos σ_ref + (H_E/cos γ) (d + λ ė + k s + ρ s/(|s| + φ)),                     (4)

makes ṡ = −k s − ρ s/(|s| + φ): the sliding mode, its sign function made smooth for the bank angle's
rate. λ, k and ρ are proportional to D_ref, constant over the speed that is lost instead of over time:
where the air is thin nothing can be had at once. d, in ṡ = λ ė − (cos γ/H_E)(…) + d, comes from an
extended state observer of (s, d). What (3) leaves out grows with e, and is no constant: d is bounded by
what a coefficient of lift may be off. On its reference, in a model that is true, the law asks for the
reference's bank angle.

References
----------
Sagliano, Mooij, Theil (2017), J. Guidance, Control, and Dynamics 40(3): the structure, an observer and
a sliding mode on the drag dynamics over energy, here of lower order. Han (2009), IEEE Trans. Ind.
Electron. 56(3), for extended state observers. Morrison (1969), "Introduction to Sequential Smoothing
and Prediction", Chapter 9: discrete gains of fading memory, stable at any cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ampi.tracking.drag_reference import (
    ALTITUDE,
    BANK,
    FLIGHT_PATH_ANGLE,
    LIFT_TO_DRAG,
    LOG_DRAG,
    SCALE_HEIGHT,
    SPEED,
    DragReference,
    Sensed,
)
from ampi.tracking.law import Told

Array = NDArray[np.float64]

TURNING, SURFACE, DISTURBANCE = range(3)  # rows of the memory


@dataclass(frozen=True, kw_only=True)
class DragSlidingMode(DragReference):
    """Eqs. (1) to (4). Gains were found on tuning draws of SHEFEX-3, worlds entry and everything."""

    name: ClassVar[str] = "drag_sliding_mode"
    senses: ClassVar[bool] = True

    surface: float = 1e-3  # s/m, λ/D_ref
    reaching: float = 4e-3  # s/m, k/D_ref
    switching: float = 1e-5  # 1/m, ρ/D_ref
    boundary: float = 5e-3  # 1/s, φ
    bandwidth: float = 0.5  # 1/s, of the observer
    most_disturbance: float = 0.02  # of the lift: what d may stand for

    def memory(self, n: int) -> Array:
        """The side that turns back, and (s, d) of the observer: zero."""
        return np.zeros((3, n))

    def command(self, at: Array, told: Told, memory: Array) -> tuple[Array, Array]:
        """Bank rate by Eq. (4) and the lateral logic, and δα of `DragReference`."""
        sensed, state = Sensed.of(at, told), told.state
        drag, error = np.exp(at[LOG_DRAG]), self.error(at, sensed, told.change)
        inverse = self._inverse_scale_height(at, state)
        climb = np.sin(state[FLIGHT_PATH_ANGLE]) - sensed.drag / drag * np.sin(
            at[FLIGHT_PATH_ANGLE]
        )
        rate = -inverse * state[SPEED] * climb  # Eq. (2)
        authority = inverse * np.cos(state[FLIGHT_PATH_ANGLE])
        vertical = drag * at[LIFT_TO_DRAG] * np.cos(at[BANK])
        above = sensed.lift * np.cos(state[BANK]) - vertical

        s = rate + self.surface * drag * error
        known = self.surface * drag * rate - authority * above
        acting = (sensed.drag > self.felt_drag) & np.isfinite(s + known)
        most = self.most_disturbance * sensed.lift * authority
        self._observe(memory, s, known, told.step)
        d = np.minimum(np.maximum(memory[DISTURBANCE], -most), most)
        memory[DISTURBANCE] = np.where(acting, d, 0.0)
        memory[SURFACE] = np.where(acting, memory[SURFACE], 0.0)

        reaching = self.reaching * s + self.switching * s / (np.abs(s) + self.boundary)
        asked = memory[DISTURBANCE] + drag * (self.surface * rate + reaching)
        cosine = (vertical + asked / authority) / sensed.lift  # Eq. (4)
        angle = self.modulation(at, sensed, error, np.where(acting, cosine, np.nan))
        return self.steered(at, told, self.size(at, sensed, cosine), memory[TURNING]), angle

    def _inverse_scale_height(self, at: Array, state: Array) -> Array:
        """1/H_E of Eq. (1), 1/m."""
        gravity = self.gravitational_parameter / (self.radius + state[ALTITUDE]) ** 2
        inverse: Array = 1.0 / at[SCALE_HEIGHT] + 2.0 * gravity / state[SPEED] ** 2
        return inverse

    def _observe(self, memory: Array, s: Array, known: Array, step: float) -> None:
        """(s, d) one step on, with ṡ = `known` + d, then towards the present `s`."""
        forgotten = -np.expm1(-self.bandwidth * step)
        ahead = memory[SURFACE] + step * (known + memory[DISTURBANCE])
        off = s - ahead
        memory[SURFACE] = ahead + forgotten * (2.0 - forgotten) * off
        memory[DISTURBANCE] += forgotten**2 / step * off
