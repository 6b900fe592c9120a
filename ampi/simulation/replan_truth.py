"""The optimiser as witness of the corrector: where both say that flights of a world can end.

Along flights that a corrector flies by bank in a world, the states that navigation tells and the true
constant factors of density, lift, drag and mass, with no wind, are given to both: what they miss then
is what they can do, not what they know. Both weigh a miss alike, in metres,

    m = √(east² + north² + (w_h / w_xy)² up²)                                                 (1)

with the corrector's weights; the optimiser's is that of its bank angle, flown by DOP853 to the target's
speed. Where they differ, the corrector tries again with one of its own restraints taken off after the
other: that which lets it agree is the reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ampi.correction.corrector import Corrected, CorrectionOutcome, Corrector
from ampi.correction.onboard_correction import Correction
from ampi.correction.plan import Plans
from ampi.correction.prediction import Situation
from ampi.correction.settings import CorrectorSettings
from ampi.estimation.estimate import ESTIMATED, LIFT, LOG_DRAG, Estimate
from ampi.estimation.settings import EstimatorSettings
from ampi.guidance import Guidance
from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.onboard_model import correction_of
from ampi.physics.state import BANK, N_STATES, SPEED
from ampi.replanning.front_door import replan
from ampi.replanning.outcome import ReplanOutcome
from ampi.replanning.rest_of_flight import estimated, from_here, known_factors
from ampi.scp.solve import optimum
from ampi.simulation.certificate_truth import flown_miss
from ampi.simulation.estimate_truth import instants
from ampi.simulation.truth import Truth
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]

EVERY = 60.0  # s between the states of a flight
LEFT = 150.0  # m/s above the target's speed: a flight that is slower is as good as over
ALIKE = (100.0, 0.05)  # m, or share of the greater miss: by less, both agree
SPEED_WEIGHT = 100.0  # per (m/s)²: the corrector ends at the target's speed exactly
BUDGETS = (3, 12)  # iterations; then the whole method
RESTRAINTS = {  # taken off one after the other
    "limits": {"margin": 0.0},
    "budget": {"iterations": 60.0, "propagations": 3000.0},
    "smoothness": {"plan_roughness": 1e-6},
}


CONSTANTS = ("density", "lift", "drag", "mass")


class Told(NamedTuple):
    """What both are given at an instant of a flight."""

    flight: int
    time: float  # s
    state: Array  # (8,), the bank rate last
    plans: Plans  # that the corrector flies
    estimate: Estimate  # of one flight


@dataclass(frozen=True)
class ComparedState:
    """What both say; misses in m, Eq. (1)."""

    flight: int
    time: float  # s
    corrector: float
    optimiser: float  # infinite: it has found nothing
    outcome: CorrectionOutcome
    solved_by: str  # "3 iterations", "12 iterations", "whole method"; "nothing"
    verdict: str  # "agree", a restraint of the corrector, "corrector nearer", "unexplained"


def told_states(
    mission: Mission, guidance: Guidance, truth: Truth, every: float = EVERY
) -> Iterator[Told]:
    """Along the flights of `truth`, a few of each, while they are faster than the target."""
    due, slow = every, mission.target.speed + LEFT
    for instant in instants(mission, guidance, truth):
        if instant.time < due - 1e-6:
            continue
        due, plans = due + every, guidance.correction_state.plans
        for k in np.flatnonzero(instant.flying & (instant.told[SPEED] > slow)).tolist():
            own = plans.of(np.array([k]))
            state = instant.told[:, k].copy()
            yield Told(k, instant.time, state, own, true_constants(truth, k, state[0]))


def true_constants(truth: Truth, flight: int, altitude: float) -> Estimate:
    """The constant factors of one flight as an estimate without doubt."""
    factor = {name: float(truth.numbers[f"{name}_factor"][flight]) for name in CONSTANTS}
    mean = np.zeros((len(ESTIMATED), 1))
    mean[LOG_DRAG] = np.log(factor["density"] * factor["drag"] / factor["mass"])
    mean[LIFT] = np.log(factor["lift"] / factor["drag"])
    none = np.zeros((len(mean), len(mean), 1))
    return Estimate(mean, none, np.array([altitude]), EstimatorSettings())


def compared_states(
    mission: Mission, guidance: Guidance, truth: Truth, most: int
) -> Iterator[ComparedState]:
    """At most so many states, each given to both."""
    witness, corrector = Witness.of(mission), correction_of(mission, angle_of_attack=False)
    last = {k: planned(mission, guidance, p) for k, p in enumerate(truth.parameters)}
    for count, told in enumerate(told_states(mission, guidance, truth)):
        if count >= most:
            return
        found, plan = compared(witness, corrector, told, last[told.flight])
        last[told.flight] = plan or last[told.flight]
        yield found


def compared(
    witness: Witness, correction: Correction, told: Told, start: Trajectory
) -> tuple[ComparedState, Trajectory | None]:
    """What both say of a state, and the optimiser's plan; `start` is the one before."""
    plan, how = witness.plan(told, start)
    optimiser = np.inf if plan is None else witness.miss(told, plan)
    own = corrected(correction, told)
    missed, outcome = witness.weighed(own.missed[:3, 0]), CorrectionOutcome(int(own.outcome[0]))
    verdict = _verdict(witness, correction, told, missed, optimiser)
    found = ComparedState(told.flight, told.time, missed, optimiser, outcome, how, verdict)
    return found, plan


def planned(mission: Mission, guidance: Guidance, parameters: Array) -> Trajectory:
    """A reference of the table at the nodes of the mission."""
    found, mesh = guidance.reference(parameters).copy(), mission.pseudospectral_mesh
    states, rate = found.nodal[:N_STATES], found.nodal[found.layout.bank_rate]
    return Trajectory(mesh, states, rate, found.final_time, np.nan, Status.SOLVED)


def corrected(correction: Correction, told: Told, **settings: float) -> Corrected:
    """What a corrector makes of the plan that is flown, with some settings changed."""
    limits, state = correction.model.limits, told.state.copy()
    state[N_STATES] = 0.0  # the change of the angle of attack
    where = Situation(
        told.time,
        state[:, None],
        np.array(correction.target)[:, None],
        told.estimate,
        np.array([limits.bank_angle]),
        np.array([[limits.bank_rate], [correction.corrector.change_rate]]),
    )
    own = replace(correction.corrector, **settings)
    return Corrector(correction.model, own).correct(told.plans, where)


def _verdict(
    witness: Witness, correction: Correction, told: Told, corrector: float, optimiser: float
) -> str:
    """Whether both agree, and if not why."""
    if alike(corrector, optimiser):
        return "agree"
    if not optimiser > corrector:
        changed: dict[str, float] = {}
        for restraint, off in RESTRAINTS.items():
            changed |= off
            missed = corrected(correction, told, **changed).missed[:3, 0]
            if alike(witness.weighed(missed), optimiser) or witness.weighed(missed) < optimiser:
                return restraint
        return "unexplained"
    return "corrector nearer" if np.isfinite(optimiser) else "no optimum"


def alike(one: float, other: float) -> bool:
    """Whether two misses (m) are as good as the same."""
    least, share = ALIKE
    return bool(
        np.isfinite(one + other) and abs(one - other) <= max(least, share * max(one, other))
    )


@dataclass(frozen=True)
class Witness:
    """The optimiser, on a mission whose objective weighs a miss as the corrector does."""

    mission: Mission
    altitude_share: float  # w_h / w_xy

    @classmethod
    def of(cls, mission: Mission) -> Witness:
        """Of a mission with a weighted target."""
        settings, radius = CorrectorSettings(), mission.flight_model.planet.equatorial_radius
        across, up = settings.position_weight**2, settings.altitude_weight**2
        north = across * radius**2
        weights = {
            "altitude_weight": up,
            "longitude_weight": north * np.cos(mission.target.latitude) ** 2,
            "latitude_weight": north,
            "speed_weight": SPEED_WEIGHT,
        }
        objective = mission.objective.model_copy(update=weights)
        share = settings.altitude_weight / settings.position_weight
        return cls(mission.model_copy(update={"objective": objective}), share)

    def weighed(self, missed: Array) -> float:
        """Eq. (1) of a miss (3,): east, north, up; infinite of who does not arrive."""
        found = np.linalg.norm(missed * [1.0, 1.0, self.altitude_share])
        return float(found) if np.isfinite(found) else np.inf

    def plan(self, told: Told, start: Trajectory) -> tuple[Trajectory | None, str]:
        """From the plan before, and how it was found; None: not at all."""
        for budget in BUDGETS:
            given = (self.mission, told.state, start, told.estimate)
            found = replan(*given, time=told.time, iterations=budget)
            if found.status in (ReplanOutcome.REPLANNED, ReplanOutcome.OUT_OF_REACH):
                return found.trajectory, f"{budget} iterations"
        rest = self.rest(told)
        found_by = [optimum(rest, guess=guess) for guess in (start, None)]
        whole = [plan for plan in found_by if plan.status.converged]
        if not whole:
            return None, "nothing"
        return min(whole, key=lambda plan: self.miss(told, plan)), "whole method"

    def rest(self, told: Told) -> Mission:
        """What is left to be flown."""
        factors = known_factors(told.estimate, told.state[0])
        assert factors is not None
        return from_here(estimated(self.mission, factors), told.state, told.time)

    def miss(self, told: Told, plan: Trajectory) -> float:
        """Of a plan, flown."""
        family = MissionFamily.of([self.rest(told)])
        bank, final_time = plan.states[BANK][None], np.array([plan.final_time])
        return self.weighed(flown_miss(family, bank, final_time)[0])
