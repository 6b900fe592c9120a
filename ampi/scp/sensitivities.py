"""How optima move with the parameters: ∂(states, controls, final time)/∂p at the nodes.

Let F(w, p) = 0 be the conditions of Karush, Kuhn and Tucker with the limits that hold the optimum as
equations, w = (states, control, final time, multipliers). Where the second-order condition holds, the
rows held are independent and each has a multiplier that is not zero, w(p) is differentiable, with

    ∂w/∂p = −(∂F/∂w)⁻¹ ∂F/∂p                                                        (1)

(Fiacco's theorem). The matrix is that of Newton's iteration (`condensed.newton`, Eq. (1)), factored once
more, at the optimum: the last factors of the solve were made before its simplified steps. They do for a
step, but would leave a derivative off by as much as those steps were long, and make it a matter of the
way to the optimum.

The numbers of a mission are inputs of its traced functions, so ∂F/∂p is a central difference of F at
p ± ε by the same lines for every parameter: both residuals are solved with the same factors, each by a
simplified step of Newton's, and Eq. (1) is the difference of the steps. F is as smooth as the physics
and evaluated to the last digits; with `STEP` the difference is off by 1e-8 of itself.

Where a limit has just come to hold, or is about to let go, the derivative is that of the side on which
the held rows stay held. Where a parameter moves a kink (of the angle of attack without `smoothing`)
over a node there is none, and the difference is a mean.

References
----------
Fiacco (1976), Mathematical Programming 10, 287–311, Theorem 2.1.
Büskens & Maurer (2000), J. Comput. Appl. Math. 120, 85–108, Section 4 (for optimal control problems).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ampi.missions.mission import Mission
from ampi.scp.condensed.limit_rows import Sides
from ampi.scp.condensed.newton import NewtonIteration
from ampi.scp.condensed.newton_system import NewtonSystem
from ampi.scp.condensed.points import Points
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.condensed.transcription import by_control
from ampi.scp.guess import on_mesh_of
from ampi.scp.problem.scaled_problem import OptimalControlProblem, by_case
from ampi.scp.solve import one_blas_thread
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

STEP = 1e-4  # ε, of the extent of the parameter's axis
AT_OPTIMUM = 1e-2  # rad: Newton's step from an optimum is shorter, by far if nothing is wrong


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """∂/∂p of c optima, SI per SI unit of each of d parameters; NaN where an optimum has none."""

    states: Array  # (c, d, s, n)
    controls: Array  # (c, d, m, n): bank rate, then the angle of attack's where it is a control
    final_time: Array  # (c, d)
    held: Sides  # (c, rows), which limits hold the optima (condensed.limit_rows)

    @property
    def bank_rate(self) -> Array:
        """(c, d, n)."""
        return self.controls[:, :, 0]


def refusal(mission: Mission) -> str | None:
    """Why optima of a mission have no sensitivities, in a sentence; None if they have."""
    if not mission.parameters:
        return (
            "sensitivities: expected a grid with an axis of two or more points, got none; add one"
        )
    for name in ("bank_rate_variation", "descent_rate"):
        if getattr(mission.objective, name) != 0.0:
            return (
                "sensitivities: expected an objective without absolute values, which have no second "
                f"derivative, got objective.{name}; ask for none, or leave that term out"
            )
    return None


def sensitivities(
    mission: Mission,
    points: ArrayLike,
    optima: Sequence[Trajectory],
    settings: SolverSettings | None = None,
) -> Sensitivities:
    """Eq. (1) of each of c optima. Nothing of one depends on its company.

    Parameters
    ----------
    mission
        Its `parameters` are p.
    points
        Values of p (c, d; SI, rad), one row for each optimum.
    optima
        Solved there on the mission's mesh, with `target_multipliers`.
    settings
        Of `solve`, which solved them.

    Returns
    -------
    Sensitivities
        Not a number where the second-order condition fails, the held rows depend on each other or do
        not settle, or Newton's step is longer than `AT_OPTIMUM`: then it is no optimum.

    Raises
    ------
    ValueError
        If the objective is not differentiable, or an optimum is on another mesh or without multipliers.
    """
    if (sentence := refusal(mission)) is not None:
        raise ValueError(sentence)
    mesh = mission.pseudospectral_mesh
    if any(o.mesh != mesh or o.target_multipliers is None for o in optima):
        raise ValueError(
            "optima: expected solutions on the mission's mesh, with target_multipliers; solve them with "
            "ampi.solve"
        )
    steps = np.array([STEP * np.ptp(parameter.axis) for parameter in mission.parameters])
    here, *beside = _problems(mission, np.asarray(points, dtype=float), steps)
    with one_blas_thread(), np.errstate(all="ignore"):
        base = _Optima.of(here, optima, settings or SolverSettings())
        derivatives = []
        for i, step in enumerate(steps):
            above, below = (base.followed_to(there) for there in beside[2 * i : 2 * i + 2])
            parts = zip(above, below, strict=True)
            derivatives.append([(up - down) / (2.0 * step) for up, down in parts])
    states, controls, final_time = (np.stack(d, axis=1) for d in zip(*derivatives, strict=True))
    for array in (states, controls, final_time):
        array[~base.regular] = np.nan
    return Sensitivities(states, controls, final_time, base.iteration.multipliers.side)


def _problems(mission: Mission, points: Array, steps: Array) -> list[OptimalControlProblem]:
    """At the points (c, d), then a step (d,) above and below them along each axis.

    They are of one family: what is moved is an array there, and no term is left out for being zero.
    """
    moved = [points, *(points + side * row for row in np.diag(steps) for side in (1.0, -1.0))]
    whole, count = OptimalControlProblem.of(mission.family(np.concatenate(moved))), len(points)
    return [whole.at(np.arange(k * count, (k + 1) * count)) for k in range(len(moved))]


@dataclass(frozen=True, eq=False)
class _Optima:
    """c optima with their multipliers, and the matrix of Eq. (1) there, factored."""

    iteration: NewtonIteration
    system: NewtonSystem
    regular: NDArray[np.bool_]  # (c,), whether Eq. (1) has a solution

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, optima: Sequence[Trajectory], settings: SolverSettings
    ) -> _Optima:
        """Multipliers and held rows by the convex model: at an optimum its solution is no step.

        There it has the multipliers of the optimum, whatever its Hessian, and a held set can be found by
        it where that of the Lagrangian is not positive definite without the very rows that are sought.
        """
        scale, rows = np.array(problem.scaling.states), len(problem.target)
        guesses = [
            on_mesh_of(optimum, problem.mesh, entry * scale[:6]).for_rows(rows)
            for optimum, entry in zip(optima, problem.entry, strict=True)
        ]
        points = Points.of(problem, guesses, one_by_one=False)
        iteration = NewtonIteration.begin(points, guesses, settings)
        multipliers = iteration.multipliers
        system = NewtonSystem.of(points, multipliers)
        shift = iteration.shift(system)
        model = iteration.solution(system.gauss_newton(settings.curvature), shift)
        limited = np.flatnonzero(multipliers.side.any(axis=1))
        if len(limited):  # of the others the Hessian has all it needs
            multipliers.target[limited] = model.target[limited]
            multipliers.limits[limited] = model.limits[limited]
            system = system.with_curvature_of(multipliers)
        step = system.held_step(*system.right_side(shift), multipliers.side)
        multipliers.target, multipliers.limits = step.target, step.limits
        time_column = system.condensed.time_column
        size = np.maximum(np.abs(step.change).max(axis=(0, 2)), np.abs(step.z[:, time_column]))
        return cls(iteration, system, size < AT_OPTIMUM)

    def followed_to(self, problem: OptimalControlProblem) -> tuple[Array, Array, Array]:
        """States (c, s, n), controls (c, m, n) and final time (c,) near the optima of `problem`, SI.

        A simplified step with the factors of these optima.
        """
        points = self.iteration.points.of_problem(problem)
        multipliers = self.iteration.multipliers.copy()
        iteration = replace(self.iteration, points=points, multipliers=multipliers)
        system, everyone = self.system.with_numbers_of(points), points.everyone
        iteration.simplified_step(system, points.nothing_changed(), everyone)
        scale = np.array(problem.scaling.states)[:, None]
        rates = by_control(points.rate(everyone), problem.n_controls)
        controls = [r * by_case(a.rate_limit) for r, a in zip(rates, problem.angles, strict=True)]
        return points.x.transpose(1, 0, 2) * scale, np.stack(controls, axis=1), points.final_time
