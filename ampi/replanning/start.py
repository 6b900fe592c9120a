"""Where the iteration starts: the plan that is flown, at the nodes of the rest of the flight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.onboard.reference import NodalReference
from ampi.physics.angles import on_turn_of
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import CIRCULAR_STATES, LATITUDE, LONGITUDE, N_STATES, SPEED
from ampi.pseudospectral.mesh import Mesh
from ampi.replanning.outcome import ReplanOutcome
from ampi.scp.guess import NodalGuess, collocated_rate
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]

FARTHEST = 500e3  # m from the plan at the same time: farther away, it is that of another flight
SHORTEST = 1.0  # s of flight that a plan which should be over is taken to have left


def as_trajectory(plan: NodalReference | Trajectory, mesh: Mesh) -> Trajectory | ReplanOutcome:
    """A plan at its own nodes, or why it is none; `mesh` is that of a whole flight of the mission."""
    if isinstance(plan, NodalReference):
        if plan.nodal.shape[-1] != mesh.n_nodes:
            return ReplanOutcome.ANOTHER_PLAN
        states, rate = plan.nodal[plan.layout.states], plan.nodal[plan.layout.bank_rate]
        plan = Trajectory(mesh, states, rate, plan.final_time, np.nan, Status.SOLVED)
    if plan.states.shape != (N_STATES, plan.mesh.n_nodes):
        return ReplanOutcome.ANOTHER_PLAN
    numbers = (plan.states, plan.bank_rate, plan.final_time)
    if not all(np.all(np.isfinite(number)) for number in numbers):
        return ReplanOutcome.NO_PLAN
    fixed = max((p.end for p in plan.mesh.phases if p.end is not None), default=plan.mesh.start)
    return plan if plan.final_time > fixed else ReplanOutcome.NO_PLAN


def start_of(plan: Trajectory, mission: Mission) -> NodalGuess | ReplanOutcome:
    """The rest of a plan at the nodes of the mission's mesh, on the turns of its entry state.

    A plan that begins later, or should be over, is held at its ends.
    """
    mesh, entry = mission.pseudospectral_mesh, mission.entry_state
    fixed = max((p.end for p in mesh.phases if p.end is not None), default=mesh.start)
    final_time = max(plan.final_time, fixed + SHORTEST)
    if mesh == plan.mesh:
        states, rate = plan.states.copy(), plan.bank_rate.copy()
    else:
        times = np.clip(mesh.times(final_time), plan.mesh.start, plan.final_time)
        states, _ = plan.at(times)
        rate = collocated_rate(mesh, states[-1], final_time)
    if _is_far(states[:, 0], entry, mission.flight_model.planet.equatorial_radius):
        return ReplanOutcome.ANOTHER_PLAN
    for state, here in zip(CIRCULAR_STATES, (*entry[[1, 5]], 0.0), strict=True):
        states[state] += on_turn_of(states[state, 0], here) - states[state, 0]
    return NodalGuess(states.T, rate, final_time, plan.target_multipliers)


def _is_far(planned: Array, state: Array, radius: float) -> bool:
    ends = (planned[LONGITUDE], planned[LATITUDE], state[LONGITUDE], state[LATITUDE])
    away = great_circle_distance(*ends, radius)
    return bool(away > FARTHEST or not 0.5 < state[SPEED] / planned[SPEED] < 2.0)
