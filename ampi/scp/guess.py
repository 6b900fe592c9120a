"""Initial guesses: the flight at one bank angle, turned over at a heading corridor, or a trajectory.

A target far away and to the side is out of the reach of any constant bank angle. Entry flights get
there by reversals: the bank angle keeps its size, and changes its sign where the azimuth leaves a
corridor about the bearing of the target (Harpold & Graves 1979, J. Astronaut. Sci. 27).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ampi.missions.mission import Mission
from ampi.physics.angles import on_turn_of, wrapped
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.planet import bearing, great_circle_distance
from ampi.physics.state import CIRCULAR_STATES
from ampi.pseudospectral.mesh import Mesh
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

LONGEST_FLIGHT = 6000.0  # s
ROLL_TIME = 20.0  # s: time constant of a reversal, slow enough for the polynomials of a mesh


@dataclass(frozen=True)
class ConstantBank:
    """Fly at one bank angle (rad, on any turn) from the entry state down to the target speed.

    With a heading corridor (rad) the sign of the bank angle turns over whenever the azimuth leaves
    bearing ± corridor.
    """

    bank_angle: float
    heading_corridor: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "bank_angle", float(on_turn_of(self.bank_angle, 0.0)))


@dataclass(frozen=True)
class NodalGuess:
    """States (n, 7; SI) and bank rate (n; rad/s) at the mesh nodes, final time (s)."""

    states: Array
    bank_rate: Array
    final_time: float
    target_multipliers: Array | None = None  # of a solved neighbour, cost per SI unit of e


def constant_bank_guess(mission: Mission, guess: ConstantBank) -> NodalGuess | None:
    """The flight of `guess` sampled at the nodes; None if it never slows to the target speed."""
    times, states = _fly(mission, guess)
    last_phase_start = max((p.end for p in mission.mesh.phase if p.end is not None), default=0.0)
    final_time = times[-1]
    if states is None or final_time <= 1.05 * last_phase_start:
        return None
    mesh = mission.pseudospectral_mesh
    nodal = _sampled(times, states, mesh.times(final_time))
    rate = np.zeros(mesh.n_nodes)
    if guess.heading_corridor is not None:
        rate = collocated_rate(mesh, nodal[:, 6], final_time)
    return NodalGuess(nodal, rate, final_time)


def _fly(
    mission: Mission, guess: ConstantBank
) -> tuple[list[float], list[Callable[[float], Array]] | None]:
    """Times at which the legs between reversals end, and each leg; no legs if it never slows down."""
    model, target = mission.flight_model, mission.target
    state = np.append(mission.entry_state, guess.bank_angle)
    command, times = guess.bank_angle, [0.0]
    legs: list[Callable[[float], Array]] = []

    def rates(t: float, x: Array) -> Array:
        roll = (command - x[6]) / ROLL_TIME
        return np.array(equations_of_motion(model, x, roll, t))

    def slow(t: float, x: Array) -> float:
        return float(x[3] - target.speed)

    def ground(t: float, x: Array) -> float:
        return float(x[0])

    def leaves_corridor(t: float, x: Array) -> float:
        """Crosses zero upwards where the turn has gone too far."""
        turned = x[5] - bearing(x[1], x[2], target.longitude, target.latitude)
        too_far = np.sign(command) * wrapped(turned)
        return float(too_far - (guess.heading_corridor or np.inf))

    slow.terminal = ground.terminal = leaves_corridor.terminal = True  # type: ignore[attr-defined]
    leaves_corridor.direction = 1.0  # type: ignore[attr-defined]
    events: list[Callable[[float, Array], float]] = [slow, ground]
    if guess.heading_corridor is not None:
        events.append(leaves_corridor)
    while times[-1] < LONGEST_FLIGHT:
        span = (times[-1], LONGEST_FLIGHT)
        leg = solve_ivp(rates, span, state, events=events, rtol=1e-7, atol=1e-9, dense_output=True)
        if leg.status != 1 or leg.sol is None:
            return times, None
        times.append(float(leg.t[-1]))
        legs.append(leg.sol)
        if leg.t_events is None or len(leg.t_events[-1]) == 0 or len(events) == 2:
            return times, legs
        state, command = leg.y[:, -1], -command
    return times, None


def collocated_rate(mesh: Mesh, bank: Array, final_time: float) -> Array:
    """Rate (n,) of the bank-angle polynomials through `bank` (n,); zero at the first node."""
    rate = np.zeros(mesh.n_nodes)
    for s in mesh.segments:
        half = s.half_length[0] + s.half_length[1] * final_time
        rate[1:][s.collocation] = s.rule.derivative @ bank[s.nodes] / half
    return rate


def _sampled(ends: list[float], legs: list[Callable[[float], Array]], times: Array) -> Array:
    """States (n, 7) at `times` (n,), each from the leg it lies in."""
    index = np.clip(np.searchsorted(ends, times, side="left") - 1, 0, len(legs) - 1)
    return np.stack([legs[k](float(t)) for k, t in zip(index, times, strict=True)])


def constant_banks(mission: Mission, candidates: int = 9) -> list[ConstantBank]:
    """A few bank angles of both signs within the limit, the one that ends nearest to the target first.

    Those whose flight never slows down are left out.
    """
    limit = 0.9 * mission.limits.bank_angle
    corridor = None if mission.guess is None else mission.guess.heading_corridor
    found: list[tuple[float, ConstantBank]] = []
    for bank_angle in np.linspace(-limit, limit, candidates):
        constant = ConstantBank(float(bank_angle), corridor)
        guess = constant_bank_guess(mission, constant)
        if guess is None:
            continue
        final = guess.states[-1]
        miss = great_circle_distance(
            final[1], final[2], mission.target.longitude, mission.target.latitude, 1.0
        )
        found.append((float(miss), constant))
    return [constant for _, constant in sorted(found, key=lambda pair: pair[0])]


def default_guess(mission: Mission) -> ConstantBank | None:
    """The mission's own constant bank angle, else the best one."""
    if mission.guess is not None:
        return ConstantBank(mission.guess.bank_angle, mission.guess.heading_corridor)
    return next(iter(constant_banks(mission)), None)


def from_trajectory(trajectory: Trajectory, mission: Mission) -> NodalGuess:
    """A trajectory as guess, resampled if it was solved on another mesh, on the mission's turns."""
    mesh = mission.pseudospectral_mesh
    if trajectory.mesh == mesh:
        states, rate = trajectory.states, trajectory.bank_rate
    else:
        times = mesh.times(trajectory.final_time)
        states, _ = trajectory.at(np.minimum(times, trajectory.final_time))
        rate = collocated_rate(mesh, states[6], trajectory.final_time)
    states = states.T.copy()
    for state, start in zip(CIRCULAR_STATES, (*mission.entry_state[[1, 5]], 0.0), strict=True):
        states[:, state] += on_turn_of(states[0, state], start) - states[0, state]
    return NodalGuess(states, rate.copy(), trajectory.final_time, trajectory.target_multipliers)


def nodal_guess(mission: Mission, guess: ConstantBank | Trajectory) -> NodalGuess | None:
    """Any guess at the nodes of the mission's mesh; None if it cannot be flown."""
    if isinstance(guess, Trajectory):
        return from_trajectory(guess, mission)
    return constant_bank_guess(mission, guess)
