"""The front door of the optimiser: a mission in, a Trajectory out."""

from __future__ import annotations

from functools import lru_cache

from threadpoolctl import ThreadpoolController

from ampi.missions.mission import Mission
from ampi.scp.exact_hessian import ExactHessianIteration, SolverSettings
from ampi.scp.guess import ConstantBank, default_guess, nodal_guess
from ampi.scp.problem import OptimalControlProblem
from ampi.trajectory import Trajectory


def solve(
    mission: Mission,
    *,
    guess: Trajectory | ConstantBank | None = None,
    settings: SolverSettings | None = None,
) -> Trajectory:
    """Solve a mission's optimal control problem.

    Parameters
    ----------
    mission
        From `load_mission`; its entry state may be replaced with `Mission.with_entry`.
    guess
        A neighbouring trajectory, a `ConstantBank`, or None: the mission's own constant bank angle,
        or where it names none, the one whose flight ends nearest to the target.
    settings
        Solver settings; the defaults need no tuning.

    Returns
    -------
    Trajectory
        With a status, never an exception, for a hard problem.
    """
    settings = settings or SolverSettings()
    problem = OptimalControlProblem.from_mission(mission)
    start = guess if guess is not None else default_guess(mission)
    nodal = None if start is None else nodal_guess(mission, start)
    with _blas().limit(limits=1):  # measured: threads more than double the time of small matrices
        return ExactHessianIteration(problem, settings).run(
            nodal, warm=isinstance(guess, Trajectory)
        )


@lru_cache(maxsize=1)
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
