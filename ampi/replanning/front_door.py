"""Re-planning: a state in flight and what is estimated in, a plan for the rest of the flight out."""

from __future__ import annotations

import time as clock
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.estimation.estimate import Estimate
from ampi.missions.final_states import TargetMiss
from ampi.missions.mission import Mission
from ampi.onboard.flight_model import Factors
from ampi.onboard.reference import NodalReference
from ampi.physics.state import BANK
from ampi.replanning.iteration import Iterated, ReplanSettings, iterate
from ampi.replanning.outcome import Replan, ReplanOutcome
from ampi.replanning.rest_of_flight import estimated, from_here, hardness, known_factors
from ampi.replanning.start import as_trajectory, start_of
from ampi.scp.problem.capabilities import MethodError
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.solve import one_blas_thread
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]

SETTINGS = ReplanSettings()


def replan(
    mission: Mission,
    state: ArrayLike,
    plan: NodalReference | Trajectory,
    estimate: Factors | Estimate | None = None,
    *,
    time: float,
    iterations: int = 3,
    settings: ReplanSettings = SETTINGS,
) -> Replan:
    """Plan the rest of a flight anew, by Newton's iteration from the plan that is flown.

    Parameters
    ----------
    mission
        Of the table that is flown; another target is a plan towards that one.
    state
        h, θ, φ, V, γ, ψ, σ and the bank rate (8,), SI and rad; without its last one (7,) the bank rate
        is free at once, without the last two (6,) so is the bank angle: before the entry, say.
    plan
        What is flown now: a reference of the table, or the trajectory of the last re-planning.
    estimate
        Factors of density, lift, drag and mass and the error of the angle of attack, as numbers; or an
        Estimate of one flight, as it is at the altitude of the state. A wind is left out. None: all as
        the mission says.
    time
        Of the state, s since the entry interface.
    iterations
        Budget: Newton's iterations with matrices of their own.

    Returns
    -------
    Replan
        With a status, never an exception, for a hard state. A plan satisfies the equations of motion at
        the nodes of its mesh; it is not flown again (`ampi.propagation.reintegration.flown_again`).

    Raises
    ------
    MethodError
        If an argument is of another kind or shape, the budget is no whole number of at least 1, or the
        mission's objective has a term that Newton's iteration does not know.
    """
    began = clock.perf_counter()
    here = np.asarray(state, dtype=float)
    _refuse(mission, here, plan, estimate, iterations)
    if not isinstance(settings, ReplanSettings):
        raise MethodError(f"settings: expected ReplanSettings, got {settings!r}")
    with one_blas_thread(), np.errstate(all="ignore"):
        found = _replanned(mission, here, plan, estimate, float(time), iterations, settings)
    seconds = clock.perf_counter() - began
    return replace(found, statistics=replace(found.statistics, seconds=seconds))


def _replanned(
    mission: Mission,
    state: Array,
    plan: NodalReference | Trajectory,
    estimate: Factors | Estimate | None,
    time: float,
    iterations: int,
    settings: ReplanSettings,
) -> Replan:
    hard = hardness(mission, state, time)
    if hard is not None:
        return Replan(hard)
    factors = known_factors(estimate, float(state[0]))
    if factors is None:
        return Replan(ReplanOutcome.NO_ESTIMATE)
    flown = as_trajectory(plan, mission.pseudospectral_mesh)
    if isinstance(flown, ReplanOutcome):
        return Replan(flown)
    rest = from_here(estimated(mission, factors), state, time)
    guess = start_of(flown, rest)
    if isinstance(guess, ReplanOutcome):
        return Replan(guess)
    problem = OptimalControlProblem.of(rest)
    return _told(rest, iterate(problem, guess.for_rows(len(problem.target)), iterations, settings))


def _told(rest: Mission, found: Iterated) -> Replan:
    """What has been found, by its name."""
    plan = found.trajectory
    if plan is None:
        return Replan(ReplanOutcome.NO_STEP, statistics=found.statistics)
    named = {
        Status.SOLVED: ReplanOutcome.REPLANNED,
        Status.TARGET_MISSED: ReplanOutcome.OUT_OF_REACH,
    }
    status = named.get(plan.status, ReplanOutcome.LIMITS_EXCEEDED)
    miss = TargetMiss.of(rest, plan.states[:, -1])
    return Replan(
        status if found.settled else ReplanOutcome.BUDGET_SPENT,
        plan if found.settled else replace(plan, status=Status.ITERATION_LIMIT),
        found.statistics,
        miss.horizontal,
        miss.altitude,
    )


def _refuse(mission: object, state: Array, plan: object, estimate: object, iterations: int) -> None:
    """What a call may confuse, in one sentence each."""
    if not isinstance(mission, Mission):
        raise MethodError(f"mission: expected a Mission, got {mission!r}")
    if mission.objective.bank_rate_variation > 0.0 or mission.objective.descent_rate > 0.0:
        raise MethodError(
            "mission: expected an objective without bank_rate_variation and descent_rate, which "
            f"Newton's iteration does not know, got that of {mission.name}; plan it with ampi.solve"
        )
    if state.shape not in ((BANK,), (BANK + 1,), (BANK + 2,)):
        raise MethodError(f"state: expected shape (6,), (7,) or (8,), got {state.shape}")
    if not isinstance(plan, NodalReference | Trajectory):
        raise MethodError(f"plan: expected a reference or a Trajectory, got {plan!r}")
    if not isinstance(estimate, Factors | Estimate | None):
        raise MethodError(f"estimate: expected Factors, an Estimate or None, got {estimate!r}")
    if isinstance(estimate, Estimate) and np.size(estimate.altitude) != 1:
        raise MethodError(
            f"estimate: expected that of one flight, got one of {np.size(estimate.altitude)}"
        )
    if isinstance(iterations, bool) or not isinstance(iterations, int) or iterations < 1:
        raise MethodError(f"iterations: expected a whole number of at least 1, got {iterations!r}")
