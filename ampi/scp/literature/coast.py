"""The part of an entry that some methods fly instead of optimising.

Zhou 2021, Section 4.1: the initial descent is integrated with zero bank angle until the flight-path
angle is zero; planning begins there. Over energy (Liu 2015) the equations are singular where there is
no drag: the flight down to a sensible drag is integrated at a constant bank angle, which has nothing
to act on there. An angle of attack that is a control keeps its first value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import ALTITUDE, BANK, FLIGHT_PATH_ANGLE, SPEED
from ampi.physics.vehicle import air_loads
from ampi.propagation.adaptive_step import Accuracy, IntegrationError, Stop, integrate
from ampi.scp.guess import held_angle
from ampi.scp.literature.collocation import line_mesh
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]
Event = Callable[[float, Array], float]  # of time and state; crosses zero upwards

LONGEST = 1500.0  # s
ACCURACY = Accuracy(relative=1e-10)
NODES = 24
JUMP = 0.01  # s, in which the bank angle may change at the handover


@dataclass(frozen=True, eq=False)
class Coast:
    """Flight at constant angles from the entry interface; the last node is the handover."""

    times: Array  # (k,), s
    states: Array  # (7 or 8, k), SI, rad

    @property
    def handover(self) -> Array:
        """(h, θ, φ, V, γ, ψ) where planning begins."""
        return np.asarray(self.states[:BANK, -1])

    def before(self, flight: Trajectory) -> Trajectory:
        """The whole entry: this coast, then `flight`; between nodes on straight lines."""
        times = np.concatenate([self.times[:-1], self.times[-1] + flight.times])
        states = np.hstack([self.states[:, :-1], flight.states])
        bank_rate, *others = (np.gradient(angle, times) for angle in states[BANK:])
        return replace(
            flight,
            mesh=line_mesh(times / times[-1]),
            states=states,
            bank_rate=bank_rate,
            final_time=float(times[-1]),
            angle_of_attack_rate=others[0] if others else None,
        )


def guessed_angle(mission: Mission, state: Array) -> list[float]:
    """Angle of attack (rad) of the guess at a state; of a schedule there is none."""
    own = None if mission.guess is None else mission.guess.angle_of_attack
    held = held_angle(mission, own)
    return [] if held is None else [held(state)]


def until_level(mission: Mission) -> Coast | None:
    """Zero bank angle until γ = 0, Zhou 2021, Section 4.1; None if the flight never levels."""
    return _fly(mission, 0.0, lambda t, x: float(x[FLIGHT_PATH_ANGLE]))


def until_drag(mission: Mission, drag: float, bank_angle: float) -> Coast | None:
    """Constant `bank_angle` (rad) until the drag reaches `drag` (m/s²); None if it never does."""
    model = mission.flight_model

    def short(t: float, x: Array) -> float:
        return (
            float(air_loads(model.vehicle, model.atmosphere, x[ALTITUDE], x[SPEED], t).drag) - drag
        )

    return _fly(mission, bank_angle, short)


def _fly(mission: Mission, bank_angle: float, reached: Event) -> Coast | None:
    model = mission.flight_model
    start = np.append(mission.entry_state, bank_angle)
    given = mission.entry.angle_of_attack
    start = np.append(start, guessed_angle(mission, start) if given is None else given)
    if reached(0.0, start) >= 0.0:
        return Coast(np.zeros(1), start[:, None])

    def rates(t: float, x: Array) -> Array:
        return np.array(equations_of_motion(model, x, 0.0, t))

    handover, ground = Stop(reached, direction=1.0), Stop(lambda t, x: float(x[ALTITUDE]))
    try:
        flight = integrate(rates, (0.0, LONGEST), start, ACCURACY, stops=[handover, ground])
    except IntegrationError:
        return None
    if flight.stop is not handover or flight.at is None:
        return None
    times = np.append(np.linspace(0.0, flight.end - JUMP, NODES - 1), flight.end)
    return Coast(times, flight.at(times))
