"""The part of an entry that some methods fly instead of optimising.

Zhou 2021, Section 4.1: the initial descent is integrated with zero bank angle until the flight-path
angle is zero; planning begins there. Over energy (Liu 2015) the equations are singular where there is
no drag: the flight down to a sensible drag is integrated at a constant bank angle, which has nothing
to act on there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.vehicle import air_loads
from ampi.scp.literature.collocation import line_mesh
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

LONGEST = 1500.0  # s
NODES = 24
JUMP = 0.01  # s, in which the bank angle may change at the handover


@dataclass(frozen=True, eq=False)
class Coast:
    """Flight at a constant bank angle from the entry interface; the last node is the handover."""

    times: Array  # (k,), s
    states: Array  # (7, k), SI, rad

    @property
    def handover(self) -> Array:
        """(h, θ, φ, V, γ, ψ) where planning begins."""
        return np.asarray(self.states[:6, -1])

    def before(self, flight: Trajectory) -> Trajectory:
        """The whole entry: this coast, then `flight`; between nodes on straight lines."""
        times = np.concatenate([self.times[:-1], self.times[-1] + flight.times])
        states = np.hstack([self.states[:, :-1], flight.states])
        return replace(
            flight,
            mesh=line_mesh(times / times[-1]),
            states=states,
            bank_rate=np.gradient(states[6], times),
            final_time=float(times[-1]),
        )


def until_level(mission: Mission) -> Coast | None:
    """Zero bank angle until γ = 0, Zhou 2021, Section 4.1; None if the flight never levels."""
    return _fly(mission, 0.0, lambda t, x: float(x[4]))


def until_drag(mission: Mission, drag: float, bank_angle: float) -> Coast | None:
    """Constant `bank_angle` (rad) until the drag reaches `drag` (m/s²); None if it never does."""
    model = mission.flight_model

    def short(t: float, x: Array) -> float:
        return float(air_loads(model.vehicle, model.atmosphere, x[0], x[3], t).drag) - drag

    return _fly(mission, bank_angle, short)


def _fly(
    mission: Mission, bank_angle: float, event: Callable[[float, Array], float]
) -> Coast | None:
    model = mission.flight_model
    start = np.append(mission.entry_state, bank_angle)
    if event(0.0, start) >= 0.0:
        return Coast(np.zeros(1), start[:, None])

    def rates(t: float, x: Array) -> Array:
        return np.array(equations_of_motion(model, x, 0.0, t))

    def reached(t: float, x: Array) -> float:
        return event(t, x)

    reached.terminal, reached.direction = True, 1.0  # type: ignore[attr-defined]
    flight = solve_ivp(
        rates,
        (0.0, LONGEST),
        start,
        events=reached,
        rtol=1e-10,
        atol=1e-9,
        dense_output=True,
    )
    if flight.status != 1 or flight.sol is None:
        return None
    end = float(flight.t[-1])
    times = np.append(np.linspace(0.0, end - JUMP, NODES - 1), end)
    return Coast(times, flight.sol(times))
