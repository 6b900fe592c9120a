"""The front door of the optimiser: a mission in, a Trajectory out."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import ThreadpoolController

from ampi.missions.family import MissionFamily
from ampi.missions.mission import Mission
from ampi.missions.sections import GuessSection
from ampi.propagation.reintegration import flown_again
from ampi.scp.condensed.exact_hessian import ExactHessianIteration
from ampi.scp.condensed.newton import newton
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.condensed.subproblem import ConvexSubproblem, Step
from ampi.scp.guess import ConstantBank, nodal_guess, on_mesh_of
from ampi.scp.guesses import from_any
from ampi.scp.problem.capabilities import MethodError, check, check_bank_angle
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.refinement import RefinementSettings, refine
from ampi.trajectory import Status, Trajectory

if TYPE_CHECKING:
    from ampi.scp.literature.successive import SubproblemSolver


def solve(
    mission: Mission,
    *,
    method: str = "exact_hessian",
    guess: Trajectory | ConstantBank | None = None,
    settings: SolverSettings | None = None,
    refinement: RefinementSettings | None = None,
    subproblem: Callable[[Any], Any] | None = None,
) -> Trajectory:
    """Solve a mission's optimal control problem.

    Parameters
    ----------
    mission
        From `load_mission`; its entry state may be replaced with `Mission.with_entry`.
    method
        "exact_hessian", the condensed convexified-exact-Hessian method, or one of the literature,
        on its own mesh: see `ampi.scp.literature.methods`.
    guess
        A neighbouring trajectory (exact_hessian alone), a `ConstantBank`, or None: the mission's own
        guess, or where it names none, the constant bank angle whose flight ends nearest to the target;
        where that fails, exact_hessian tries others (`ampi.scp.guesses`).
    settings
        Solver settings of exact_hessian; the defaults need no tuning.
    refinement
        Of exact_hessian: None solves on the mission's mesh; settings refine it until their tolerance
        or caps.
    subproblem
        Another solver of the method's convex subproblem, such as `solve_subproblem_cvxpy` (of
        exact_hessian) or `solve_sparse_subproblem_cvxpy` with a constraint of one's own.

    Returns
    -------
    Trajectory
        With a status, never an exception, for a hard problem. It is flown again under its own bank
        angle: `statistics.flight` says what that found, and where the flight is another than its nodes
        say, or exceeds a limit between them, the status is `Status.INACCURATE`.

    Raises
    ------
    MethodError
        If the method does not know a constraint, a term of the mission's objective or an argument,
        or the guess banks beyond the limit.
    MissionError
        If the mission says what no mission file could: a number that is not finite or out of its range.
    """
    found = optimum(
        mission,
        method=method,
        guess=guess,
        settings=settings,
        refinement=refinement,
        subproblem=subproblem,
    )
    return flown_again(mission, found)


def optimum(
    mission: Mission,
    *,
    method: str = "exact_hessian",
    guess: Trajectory | ConstantBank | None = None,
    settings: SolverSettings | None = None,
    refinement: RefinementSettings | None = None,
    subproblem: Callable[[Any], Any] | None = None,
) -> Trajectory:
    """`solve` without the flight: for who flies many optima at once. All it says is of the nodes."""
    _refuse_other_kinds(mission, guess, settings, refinement)
    check(mission, method)
    if isinstance(guess, ConstantBank):
        check_bank_angle(mission, method, guess.bank_angle)
    if method != "exact_hessian":
        if isinstance(guess, Trajectory) or settings is not None or refinement is not None:
            raise MethodError(
                f"guess as a Trajectory, settings and refinement are arguments of method "
                f"'exact_hessian', not of {method!r}, which brings its own; leave them out"
            )
        return _by_the_literature(mission, method, guess, subproblem)
    chosen = settings or SolverSettings()

    def solve_from(
        mission: Mission, start: Trajectory | ConstantBank, settings: SolverSettings
    ) -> Trajectory:
        return _condensed(mission, start, settings, subproblem)

    def solve_on(mission: Mission, guess: Trajectory | ConstantBank | None) -> Trajectory:
        if guess is not None:
            return solve_from(mission, guess, chosen)
        return from_any(
            mission,
            lambda start, most: solve_from(mission, start, replace(chosen, max_iterations=most)),
            chosen.max_iterations,
        )

    with one_blas_thread():  # measured: threads more than double the time of small matrices
        if refinement is None:
            return solve_on(mission, guess)
        return refine(mission, solve_on, guess=guess, settings=refinement)


def _condensed(
    mission: Mission,
    start: Trajectory | ConstantBank,
    settings: SolverSettings,
    subproblem: Callable[[ConvexSubproblem], Step] | None,
) -> Trajectory:
    """By Newton's iteration where the start is a solved neighbour and that is enough, else robustly."""
    problem = OptimalControlProblem.of(mission)
    nodal, warm = nodal_guess(mission, start), isinstance(start, Trajectory)
    if nodal is not None:
        nodal = nodal.for_rows(len(problem.target))
    if nodal is not None and nodal.target_multipliers is not None and subproblem is None:
        for _, found in newton(problem, [nodal], settings, one_by_one=True):
            return found
    return ExactHessianIteration(problem, settings, subproblem).run(nodal, warm=warm)


def solve_family(
    family: MissionFamily[Mission],
    guesses: Sequence[Trajectory],
    settings: SolverSettings | None = None,
) -> list[Trajectory | None]:
    """Solve neighbouring missions together, each from a neighbour's solution on the same mesh.

    The optima are those of `solve`, and not flown again: what is said of them is said of the nodes. A
    solution does not depend on which missions are solved with it.

    Parameters
    ----------
    family
        From `Mission.family`.
    guesses
        One for each of its cases, with `target_multipliers`.
    settings
        Its tolerances; those of `solve`.

    Returns
    -------
    list of Trajectory or None
        None for a mission that needs the whole method (a term of the objective that Newton's iteration
        does not know, a neighbour too far away): that is no verdict on it, `solve` it.
    """
    if len(family) != len(guesses):
        raise ValueError(
            f"guesses: expected one for each of the {len(family)} cases, got {len(guesses)}"
        )
    family.checked()
    mesh = family.mission.pseudospectral_mesh
    cases = [
        case
        for case, guess in enumerate(guesses)
        if guess.mesh == mesh and guess.target_multipliers is not None
    ]
    found: list[Trajectory | None] = [None] * len(guesses)
    if not cases:
        return found
    problem = OptimalControlProblem.of(family)
    entry, rows = family.entry_states, len(problem.target)
    starts = [on_mesh_of(guesses[case], mesh, entry[case]).for_rows(rows) for case in cases]
    known = [k for k, start in enumerate(starts) if start.target_multipliers is not None]
    cases, starts = [cases[k] for k in known], [starts[k] for k in known]
    problem = problem.at(np.array(cases, dtype=np.intp))
    with one_blas_thread():
        for place, solution in newton(problem, starts, settings):
            found[cases[place]] = solution
    return found


def _refuse_other_kinds(mission: Any, guess: Any, settings: Any, refinement: Any) -> None:
    """What a call may confuse, in one sentence each."""
    if not isinstance(mission, Mission):
        raise MethodError(
            f"mission: expected a Mission, got {mission!r}; load one with ampi.load_mission(name)"
        )
    mission.checked(whole=False)
    if not isinstance(guess, Trajectory | ConstantBank | None):
        raise MethodError(
            f"guess: expected a Trajectory, a ConstantBank (rad) or None, got {guess!r}; a bank angle "
            "is a guess as ampi.ConstantBank(bank_angle)"
        )
    if isinstance(guess, Trajectory) and guess.states.shape != (
        shape := (mission.n_states, guess.mesh.n_nodes)
    ):
        raise MethodError(
            f"guess: expected states of shape {shape}, those of the mission on its mesh, got "
            f"{guess.states.shape}"
        )
    for name, value, expected in (
        ("settings", settings, SolverSettings),
        ("refinement", refinement, RefinementSettings),
    ):
        if not isinstance(value, expected | None):
            raise MethodError(f"{name}: expected {expected.__name__} or None, got {value!r}")


def _by_the_literature(
    mission: Mission, method: str, guess: ConstantBank | None, subproblem: SubproblemSolver | None
) -> Trajectory:
    # imported when asked for: the workers of a build wait for their imports, and never ask
    from ampi.scp.literature.methods import METHODS, solve_by
    from ampi.scp.literature.sparse_subproblem import solve_sparse_subproblem

    if guess is not None:
        section = GuessSection.model_construct(**asdict(guess))
        mission = mission.model_copy(update={"guess": section})
    with one_blas_thread():
        found = solve_by(mission, METHODS[method], subproblem or solve_sparse_subproblem)
    if found is not None:
        return found.trajectory
    return Trajectory.none(mission.pseudospectral_mesh, Status.GUESS_FAILED, mission.n_states)


def one_blas_thread() -> AbstractContextManager[object]:
    """The matrices are small: threads cost more than they save."""
    if all(os.environ.get(name) == "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")):
        return nullcontext()  # a worker of a build, say: it had that set before BLAS was loaded
    return _blas().limit(limits=1)


@lru_cache(maxsize=1)
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
