"""Initial guesses: the flight at one bank angle, turned over at a heading corridor, or a trajectory.

A target far away and to the side is out of the reach of any constant bank angle. Entry flights get
there by reversals: the bank angle keeps its size, and changes its sign where the azimuth leaves a
corridor about the bearing of the target (Harpold & Graves 1979, J. Astronaut. Sci. 27).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.missions.angle_of_attack import AngleBounds
from ampi.missions.mission import Mission
from ampi.physics.angles import on_turn_of, wrapped
from ampi.physics.planet import bearing, great_circle_distance
from ampi.physics.state import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    AZIMUTH,
    BANK,
    CIRCULAR_STATES,
    LATITUDE,
    LONGITUDE,
    SPEED,
)
from ampi.propagation.adaptive_step import Accuracy, Integration, IntegrationError, Stop, integrate
from ampi.pseudospectral.mesh import Mesh
from ampi.tracing.dynamics import Physics, node_dynamics
from ampi.tracing.node_functions import NodeFunctions
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

LONGEST_FLIGHT = 6000.0  # s
ACCURACY = Accuracy(relative=1e-7)
ROLL_TIME = 20.0  # s: time constant of a reversal, slow enough for the polynomials of a mesh


@dataclass(frozen=True)
class ConstantBank:
    """Fly at one bank angle (rad, on any turn) from the entry state down to the target speed.

    With a heading corridor (rad) the sign of the bank angle turns over whenever the azimuth leaves
    bearing ± corridor. Where the angle of attack (rad) is a control, it is held, too; None: in the
    middle of its bounds.
    """

    bank_angle: float
    heading_corridor: float | None = None
    angle_of_attack: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "bank_angle", float(on_turn_of(self.bank_angle, 0.0)))


@dataclass(frozen=True)
class NodalGuess:
    """States (n, s; SI) and rates of the controls (n; rad/s) at the mesh nodes, final time (s)."""

    states: Array
    bank_rate: Array
    final_time: float
    target_multipliers: Array | None = None  # of a solved neighbour, cost per SI unit of e
    angle_of_attack_rate: Array | None = None  # where it is a control

    @property
    def controls(self) -> Array:
        """(m, n), rad/s."""
        rates = [self.bank_rate, self.angle_of_attack_rate]
        return np.stack([rate for rate in rates if rate is not None])

    def for_rows(self, rows: int) -> NodalGuess:
        """The same beside a target of so many rows: multipliers of another target say nothing of it."""
        known = self.target_multipliers
        if known is None or len(known) == rows:
            return self
        return replace(self, target_multipliers=None)


def constant_bank_guess(mission: Mission, guess: ConstantBank) -> NodalGuess | None:
    """The flight of `guess` sampled at the nodes; None if it never slows to the target speed."""
    legs = _fly(mission, guess)
    mesh = mission.pseudospectral_mesh
    last_phase_start = max((p.end for p in mesh.phases if p.end is not None), default=mesh.start)
    if legs is None or legs[-1].end <= 1.05 * last_phase_start:
        return None
    final_time = legs[-1].end
    nodal = _sampled(legs, mesh.times(final_time))
    rate = np.zeros(mesh.n_nodes)
    if guess.heading_corridor is not None or mission.entry.bank_angle is not None:
        rate = collocated_rate(mesh, nodal[:, 6], final_time)
    angle_rate = None
    if mission.angle_of_attack is not None:
        angle_rate = collocated_rate(mesh, nodal[:, ANGLE_OF_ATTACK], final_time)
    return NodalGuess(nodal, rate, final_time, angle_of_attack_rate=angle_rate)


def _fly(mission: Mission, guess: ConstantBank) -> list[Integration] | None:
    """The legs between reversals; None if the flight never slows to the target speed."""
    entry, target = mission.entry, mission.target
    held = held_angle(mission, guess.angle_of_attack)
    physics = Physics.of(mission.flight_model, NodeFunctions(), (1.0, 1.0) if held else 1.0)
    function = node_dynamics(physics.structure, (1.0,) * mission.n_states).values
    start = guess.bank_angle if entry.bank_angle is None else entry.bank_angle
    state = np.array([*mission.entry_state, start])
    if held is not None:
        first = held(state) if entry.angle_of_attack is None else entry.angle_of_attack
        state = np.append(state, first)
    command, legs = guess.bank_angle, list[Integration]()

    def rates(t: float, x: Array) -> Array:
        turn = [(command - x[BANK]) / ROLL_TIME]
        if held is not None:
            turn.append((held(x) - x[ANGLE_OF_ATTACK]) / ROLL_TIME)
        at = (x[:, None, None], np.array(turn)[:, None, None], np.array([[t]]))
        return function.one_by_one(*at, physics.numbers)[0][:, 0, 0]

    def turned_too_far(t: float, x: Array) -> float:
        goal = bearing(x[LONGITUDE], x[LATITUDE], target.longitude, target.latitude)
        turned = np.sign(command) * wrapped(x[AZIMUTH] - goal)
        return float(turned - (guess.heading_corridor or np.inf))

    reversal = Stop(turned_too_far, direction=1.0)
    stops = [
        Stop(lambda t, x: float(x[SPEED] - target.speed)),
        Stop(lambda t, x: float(x[ALTITUDE])),
    ]
    if guess.heading_corridor is not None:
        stops.append(reversal)
    begin = entry.time
    while begin < LONGEST_FLIGHT:
        try:
            leg = integrate(rates, (begin, LONGEST_FLIGHT), state, ACCURACY, stops=stops)
        except IntegrationError:
            return None
        legs.append(leg)
        if leg.stop is not reversal:
            return None if leg.stop is None else legs
        begin, state, command = leg.end, leg.state, -command
    return None


def held_angle(mission: Mission, own: float | None) -> Callable[[Array], float] | None:
    """The angle of attack (rad) at a state where it is a control: `own`, or the middle of its bounds."""
    bounds, model = AngleBounds.of(mission.angle_of_attack), mission.flight_model
    if bounds is None:
        return None

    def held(state: Array) -> float:
        low, high = bounds.at_state(model, state)
        return float(min(max(0.5 * (low + high) if own is None else own, low), high))

    return held


def collocated_rate(mesh: Mesh, bank: Array, final_time: float) -> Array:
    """Rate (n,) of the bank-angle polynomials through `bank` (n,); zero at the first node."""
    rate = np.zeros(mesh.n_nodes)
    for s in mesh.segments:
        half = s.half_length[0] + s.half_length[1] * final_time
        rate[1:][s.collocation] = s.rule.derivative @ bank[s.nodes] / half
    return rate


def _sampled(legs: list[Integration], times: Array) -> Array:
    """States (n, s) at `times` (n,), each from the leg it lies in."""
    index = np.searchsorted([leg.end for leg in legs[:-1]], times, side="left")
    return np.stack([legs[k].at(float(t)) for k, t in zip(index, times, strict=True)])


def constant_banks(mission: Mission, candidates: int = 9) -> list[ConstantBank]:
    """A few bank angles of both signs within the limit, the one that ends nearest to the target first.

    Those whose flight never slows down are left out.
    """
    limit = 0.9 * mission.limits.bank_angle
    given = mission.guess
    corridor = None if given is None else given.heading_corridor
    angle = None if given is None else given.angle_of_attack
    found: list[tuple[float, ConstantBank]] = []
    for bank_angle in np.linspace(-limit, limit, candidates):
        constant = ConstantBank(float(bank_angle), corridor, angle)
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
        given = mission.guess
        return ConstantBank(given.bank_angle, given.heading_corridor, given.angle_of_attack)
    return next(iter(constant_banks(mission)), None)


def from_trajectory(trajectory: Trajectory, mission: Mission) -> NodalGuess:
    """A trajectory as guess, resampled if it was solved on another mesh, on the mission's turns."""
    return on_mesh_of(trajectory, mission.pseudospectral_mesh, mission.entry_state)


def on_mesh_of(trajectory: Trajectory, mesh: Mesh, entry: Array) -> NodalGuess:
    """A trajectory at the nodes of `mesh`, on the turns of the `entry` state (6,)."""
    if trajectory.mesh == mesh:
        states, rates = trajectory.states, trajectory.controls
    else:
        times = mesh.times(trajectory.final_time)
        states, _ = trajectory.at(np.minimum(times, trajectory.final_time))
        angles = states[BANK:]
        rates = np.stack([collocated_rate(mesh, y, trajectory.final_time) for y in angles])
    states = states.T.copy()
    for state, start in zip(CIRCULAR_STATES, (*entry[[1, 5]], 0.0), strict=True):
        states[:, state] += on_turn_of(states[0, state], start) - states[0, state]
    return NodalGuess(
        states,
        rates[0].copy(),
        trajectory.final_time,
        trajectory.target_multipliers,
        rates[1].copy() if len(rates) > 1 else None,
    )


def nodal_guess(mission: Mission, guess: ConstantBank | Trajectory) -> NodalGuess | None:
    """Any guess at the nodes of the mission's mesh; None if it cannot be flown."""
    if isinstance(guess, Trajectory):
        return from_trajectory(guess, mission)
    return constant_bank_guess(mission, guess)
