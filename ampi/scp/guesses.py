"""Where one first guess fails, another may not: constant bank angles to start from, what they give.

An entry has several optima: one for each side that it turns to first, others for each reversal. A first
guess selects one of them, or none. `from_any` starts from the mission's own guess; where that does not
solve the problem it tries the constant bank angles of both signs, nearest to the target first, and keeps
the best answer. `from_each` starts from all of them, to see which branches there are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ampi.missions.final_states import TargetMiss
from ampi.missions.mission import Mission
from ampi.missions.path_limits import KEPT
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import BANK
from ampi.scp.guess import ConstantBank, constant_banks, default_guess
from ampi.trajectory import GuessTried, Status, Trajectory

SolveFrom = Callable[[ConstantBank, int], Trajectory]  # a guess, and iterations at the most


@dataclass(frozen=True, kw_only=True)
class GuessSettings:
    """How much is spent on further guesses, and which solutions are one branch."""

    iterations: int = 120  # of all further guesses: four solves of an ordinary mission
    same_cost: float = 1e-3  # relative
    same_bank: float = float(np.radians(2.0))  # rad, greatest difference over the nodes


SETTINGS = GuessSettings()


@dataclass(frozen=True)
class GuessResult:
    """What one guess leads to; `branch` numbers the different solutions, the cheapest first."""

    guess: ConstantBank
    trajectory: Trajectory
    branch: int | None = None  # None: no solution


def from_any(mission: Mission, solve_from: SolveFrom, most_iterations: int) -> Trajectory:
    """The solution from the default guess, or the best answer of the others.

    The others have `GuessSettings.iterations` together. Solved and cheapest is best; where nothing
    is solved, the least that is left open: the excess of the limits and the miss of an exact target, as
    shares; and of equals the cheapest.
    """
    first = default_guess(mission)
    if first is None:
        return Trajectory.none(mission.pseudospectral_mesh, Status.GUESS_FAILED, mission.n_states)
    results = [GuessResult(first, solve_from(first, most_iterations))]
    if results[0].trajectory.status.ok:
        return results[0].trajectory
    left = SETTINGS.iterations
    for guess in constant_banks(mission):
        if left <= 0:
            break
        if guess != first:
            results.append(GuessResult(guess, solve_from(guess, left)))
            left -= results[-1].trajectory.statistics.iterations
    best = min(results, key=lambda result: _badness(mission, result.trajectory))
    statistics = replace(
        best.trajectory.statistics,
        solve_seconds=sum(r.trajectory.statistics.solve_seconds for r in results),
        guesses=tuple(
            GuessTried(
                r.guess.bank_angle,
                r.trajectory.status,
                r.trajectory.statistics.iterations,
                r.trajectory.cost,
                r is best,
            )
            for r in results
        ),
    )
    return replace(best.trajectory, statistics=statistics)


def from_each(
    mission: Mission, solve_from: Callable[[ConstantBank], Trajectory]
) -> list[GuessResult]:
    """What the mission's own guess and every constant bank angle lead to, with the branches numbered."""
    own = default_guess(mission)
    guesses = [] if own is None else [own]
    guesses += [guess for guess in constant_banks(mission) if guess != own]
    return _numbered([GuessResult(guess, solve_from(guess)) for guess in guesses])


def _numbered(results: Sequence[GuessResult]) -> list[GuessResult]:
    solved = [r for r in results if r.trajectory.status in (Status.SOLVED, Status.INACCURATE)]
    branches: list[Trajectory] = []
    number: dict[int, int] = {}
    for result in sorted(solved, key=lambda r: r.trajectory.cost):
        same = (k for k, b in enumerate(branches) if _is_same(b, result.trajectory))
        k = next(same, len(branches))
        if k == len(branches):
            branches.append(result.trajectory)
        number[id(result)] = k + 1
    return [replace(result, branch=number.get(id(result))) for result in results]


def _is_same(one: Trajectory, other: Trajectory) -> bool:
    costs = abs(one.cost - other.cost) <= SETTINGS.same_cost * max(abs(one.cost), abs(other.cost))
    return costs and float(np.abs(one.states[BANK] - other.states[BANK]).max()) < SETTINGS.same_bank


def _badness(mission: Mission, trajectory: Trajectory) -> tuple[int, float, float]:
    if trajectory.status.ok:
        return 0, 0.0, trajectory.cost
    if not np.all(np.isfinite(trajectory.states)):
        return 3, 0.0, 0.0
    entry, target = mission.entry, mission.target
    radius = mission.flight_model.planet.equatorial_radius
    start, end = (entry.longitude, entry.latitude), (target.longitude, target.latitude)
    way = float(great_circle_distance(*start, *end, radius))
    # the cost of a soft target tells its miss, and knows which final states count
    soft = mission.objective.altitude_weight is not None
    miss = TargetMiss.of(mission, trajectory.states[:, -1]).horizontal
    share = 0.0 if soft or way == 0.0 else miss / way
    excess = max(trajectory.statistics.limit_excess)
    opened = (excess if excess > KEPT else 0.0) + share
    return 1 if trajectory.status.converged else 2, opened, trajectory.cost
