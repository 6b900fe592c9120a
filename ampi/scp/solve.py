"""The front door of the optimiser: a mission in, a Trajectory out."""

from __future__ import annotations

from functools import lru_cache

from threadpoolctl import ThreadpoolController

from ampi.missions.mission import Mission
from ampi.scp.capabilities import check
from ampi.scp.exact_hessian import ExactHessianIteration, SolverSettings
from ampi.scp.guess import ConstantBank, default_guess, nodal_guess
from ampi.scp.problem import OptimalControlProblem
from ampi.scp.refinement import RefinementSettings, refine
from ampi.trajectory import Trajectory


def solve(
    mission: Mission,
    *,
    method: str = "exact_hessian",
    guess: Trajectory | ConstantBank | None = None,
    settings: SolverSettings | None = None,
    refinement: RefinementSettings | None = None,
) -> Trajectory:
    """Solve a mission's optimal control problem.

    Parameters
    ----------
    mission
        From `load_mission`; its entry state may be replaced with `Mission.with_entry`.
    method
        "exact_hessian", the condensed convexified-exact-Hessian method.
    guess
        A neighbouring trajectory, a `ConstantBank`, or None: the mission's own guess, or where it
        names none, the constant bank angle whose flight ends nearest to the target.
    settings
        Solver settings; the defaults need no tuning.
    refinement
        None solves on the mission's mesh; settings refine it until their tolerance or caps.

    Returns
    -------
    Trajectory
        With a status, never an exception, for a hard problem.

    Raises
    ------
    MethodError
        If the method does not know a constraint or a term of the mission's objective.
    """
    check(mission, method)
    chosen = settings or SolverSettings()

    def solve_on(mission: Mission, guess: Trajectory | ConstantBank | None) -> Trajectory:
        problem = OptimalControlProblem.from_mission(mission)
        start = guess if guess is not None else default_guess(mission)
        nodal = None if start is None else nodal_guess(mission, start)
        return ExactHessianIteration(problem, chosen).run(nodal, warm=isinstance(guess, Trajectory))

    with _blas().limit(limits=1):  # measured: threads more than double the time of small matrices
        if refinement is None:
            return solve_on(mission, guess)
        return refine(mission, solve_on, guess=guess, settings=refinement)


@lru_cache(maxsize=1)
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
