"""Newton's iteration (ampi/scp/condensed/newton.py) of one flight, within a budget.

It differs from that of a database in what it does where a case is no near neighbour: a step of more than
`longest_step` is shortened, a Hessian that is not positive definite gives way to the effort's curvature,
multipliers that the plan does not know are those of a first solution that is not taken; and when the
iterations have been spent, what they have is made to fly (R = 0) and is the answer.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ampi.physics.state import BANK
from ampi.replanning.outcome import ReplanStatistics
from ampi.scp.condensed.newton import NewtonIteration
from ampi.scp.condensed.newton_system import NewtonStep, NewtonSystem
from ampi.scp.condensed.points import Points
from ampi.scp.condensed.settings import NewtonSettings, SolverSettings
from ampi.scp.guess import NodalGuess
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.problem.sensible import require_sensible
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ReplanSettings:
    """Numbers that steer a re-planning.

    A step ends it below `step` (rad), or where its simplified steps have less than the square of that
    left to come. Of 500 references polished 20 % outside their table the worst then ends 121 m from the
    target. With 1e-2 half of the plans that follow another need no simplified step, and the end of a
    plan moves by 2 m (median), but the worst polished one ends at 332 m.
    """

    longest_step: float = 0.5  # rad of bank angle, or 100 s · rad of final time
    step: float = 5e-3
    simplified_steps: int = 2
    fast: float = 0.3  # contraction of simplified steps, above which they are given up
    exchanges: int = 4  # of all limits that should be held or not, with the same matrices; then
    dual_steps: int = 12  # at most, which let them come and go one by one
    restored: float = 1e-8  # scaled: what is left of R = 0, centimetres
    solver: SolverSettings = field(default_factory=SolverSettings)

    def __post_init__(self) -> None:
        require_sensible("settings", self)

    @property
    def newton(self) -> SolverSettings:
        """As the iteration reads them."""
        own = self.solver
        return replace(
            own,
            newton=NewtonSettings(
                simplified_steps=self.simplified_steps,
                fast=self.fast,
                exchanges=self.exchanges,
                dual_steps=self.dual_steps,
            ),
            convergence=replace(own.convergence, step=self.step),
            restoration=replace(own.restoration, tolerance=self.restored),
        )


@dataclass(frozen=True, eq=False)
class Iterated:
    """What an iteration has found."""

    trajectory: Trajectory | None  # None: it is no flight
    settled: bool
    statistics: ReplanStatistics


def iterate(
    problem: OptimalControlProblem, guess: NodalGuess, iterations: int, settings: ReplanSettings
) -> Iterated:
    """At most so many iterations from a guess."""
    unknown = guess.target_multipliers is None
    known = replace(guess, target_multipliers=np.zeros(len(problem.target))) if unknown else guess
    points = Points.of(problem, [known], one_by_one=True)
    own = NewtonIteration.begin(points, [known], settings.newton)
    flies = settled = False
    made = 0
    with np.errstate(all="ignore"):  # what diverges ends as not-a-number
        while made < iterations and not settled:
            system, size = _newton_step(own, made == 0, unknown, settings)
            made += 1
            if not np.isfinite(size):
                break
            good = np.array([size <= settings.longest_step])
            done, last = own.simplified_steps(system, good, np.array([size]))
            if done[0] or made == iterations:
                flies = _made_to_fly(own, system, last)
                settled = bool(done[0]) and flies and bool(own.keeps_limits(system.rows)[0])
    steps = [row.step for row in own.logs[0]]
    statistics = ReplanStatistics(made, len(steps) - made, step=steps[-1] if steps else np.nan)
    if not flies:
        return Iterated(None, False, statistics)
    rate, cost = own.points.rate(points.everyone)[0], float(own.points.cost(points.everyone)[0])
    found = own.trajectory(0, rate, cost, time.perf_counter() - own.began)
    return Iterated(found, settled, statistics)


def _made_to_fly(own: NewtonIteration, system: NewtonSystem, last: Array) -> bool:
    """R = 0 under the control that is found: with the matrices at hand, then with new ones."""
    everyone = np.array([True])
    if own.restore(system.condensed, everyone, last)[0]:
        return True
    return bool(own.restore(own.points.condensed(), everyone, np.array([np.inf]))[0])


def _newton_step(
    own: NewtonIteration, is_first: bool, unknown: bool, settings: ReplanSettings
) -> tuple[NewtonSystem, float]:
    """Take a step with new matrices: those, and its size before it was shortened."""
    system = NewtonSystem.of(own.points, own.multipliers)
    shift = own.shift(system)
    step = own.solution(system, shift)
    if is_first and unknown and _is_finite(step):
        own.multipliers.target, own.multipliers.limits = step.target, step.limits
        system = system.with_curvature_of(own.multipliers)
        step = own.solution(system, shift)
    elif is_first and _is_finite(step):
        system, step = own.with_known_multipliers(system, shift, step)
    if not _is_finite(step):
        own.multipliers.side[:] = 0
        system = system.gauss_newton(own.settings.curvature)
        step = own.solution(system, shift)
    size = _size(step, shift)
    if size > settings.longest_step:
        share = settings.longest_step / size
        step = replace(step, z=share * step.z, change=share * step.change)
        shift = share * shift
    own.newton_step(shift, step)
    return system, size


def _is_finite(step: NewtonStep) -> bool:
    return bool(np.isfinite(step.z[0, 0]))


def _size(step: NewtonStep, shift: Array) -> float:
    """‖(δσ, δt_f)‖_∞, as `Points.take` measures it; not a number of a step that has not settled."""
    on_bank = step.change[BANK, 0].copy()
    on_bank[1:] += shift[0, :, BANK]
    return float(np.abs([*on_bank, step.z[0, -2]]).max())  # `max` would overlook what is no number
