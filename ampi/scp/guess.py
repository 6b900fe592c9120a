"""Initial guesses: the flight at a constant bank angle, or another trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.planet import great_circle_distance
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

LONGEST_FLIGHT = 6000.0  # s


@dataclass(frozen=True)
class ConstantBank:
    """Fly at one bank angle (rad) from the entry state down to the target speed."""

    bank_angle: float


@dataclass(frozen=True)
class NodalGuess:
    """States (n, 7; SI) and bank rate (n; rad/s) at the mesh nodes, final time (s)."""

    states: Array
    bank_rate: Array
    final_time: float


def constant_bank_guess(mission: Mission, guess: ConstantBank) -> NodalGuess | None:
    """The constant-bank flight sampled at the nodes; None if it never slows to the target speed."""
    model = mission.flight_model

    def rates(t: float, x: Array) -> Array:
        return np.array(equations_of_motion(model, x, 0.0, t))

    def slow(t: float, x: Array) -> float:
        return float(x[3] - mission.target.speed)

    def ground(t: float, x: Array) -> float:
        return float(x[0])

    slow.terminal = ground.terminal = True  # type: ignore[attr-defined]
    start = np.append(mission.entry_state, guess.bank_angle)
    flight = solve_ivp(
        rates,
        (0.0, LONGEST_FLIGHT),
        start,
        events=(slow, ground),
        rtol=1e-7,
        atol=1e-9,
        dense_output=True,
    )
    last_phase_start = max((p.end for p in mission.mesh.phase if p.end is not None), default=0.0)
    if flight.status != 1 or flight.t[-1] <= 1.05 * last_phase_start or flight.sol is None:
        return None
    mesh = mission.pseudospectral_mesh
    times = mesh.times(float(flight.t[-1]))
    return NodalGuess(flight.sol(times).T, np.zeros(mesh.n_nodes), float(flight.t[-1]))


def best_constant_bank(mission: Mission, candidates: int = 9) -> ConstantBank | None:
    """The constant bank angle whose flight ends nearest to the target, of a few within the limit."""
    limit = 0.9 * mission.limits.bank_angle
    nearest: tuple[float, ConstantBank] | None = None
    for bank_angle in np.linspace(-limit, limit, candidates):
        guess = constant_bank_guess(mission, ConstantBank(float(bank_angle)))
        if guess is None:
            continue
        final = guess.states[-1]
        miss = great_circle_distance(
            final[1], final[2], mission.target.longitude, mission.target.latitude, 1.0
        )
        if nearest is None or miss < nearest[0]:
            nearest = (float(miss), ConstantBank(float(bank_angle)))
    return None if nearest is None else nearest[1]


def default_guess(mission: Mission) -> ConstantBank | None:
    """The mission's own constant bank angle, else the best one."""
    if mission.guess is not None:
        return ConstantBank(mission.guess.bank_angle)
    return best_constant_bank(mission)


def from_trajectory(trajectory: Trajectory, mission: Mission) -> NodalGuess:
    """A trajectory as guess, resampled if it was solved on another mesh."""
    mesh = mission.pseudospectral_mesh
    if trajectory.mesh == mesh:
        states, rate = trajectory.states, trajectory.bank_rate
    else:
        times = mesh.times(trajectory.final_time)
        states, rate = trajectory.at(np.minimum(times, trajectory.final_time))
    return NodalGuess(states.T.copy(), rate.copy(), trajectory.final_time)


def nodal_guess(mission: Mission, guess: ConstantBank | Trajectory) -> NodalGuess | None:
    """Any guess at the nodes of the mission's mesh; None if it cannot be flown."""
    if isinstance(guess, Trajectory):
        return from_trajectory(guess, mission)
    return constant_bank_guess(mission, guess)
