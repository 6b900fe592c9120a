"""Sequential convex programming as the entry literature does it: linearise, solve, step, compare.

    repeat
        linearise about (x, u, s_f)                     Zhou Eq. 18, Liu Eq. 46, Wang Eq. 27
        convex subproblem under a trust region          Zhou Eq. 38, Liu Eqs. 64–69, Wang P1
        take the whole step
        adapt the mesh, where the method does           Zhou Section 3.2
        or linearise further on, where it relaxes       `acceleration` (ours)
    until the convergence condition holds               Zhou Eqs. 43 or 44, Liu Eq. 70, Wang Eq. 36

There is no merit function and no rejected step. What the methods differ in are the named parts of
`Method`: formulation, transcription, mesh, trust region, penalty, relaxation, convergence test,
refinement.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ampi.pseudospectral.mesh import Mesh
from ampi.scp.cone_program import ConeStatus
from ampi.scp.literature.acceleration import AitkenRelaxation
from ampi.scp.literature.collocation import Collocation
from ampi.scp.literature.formulation import Formulation
from ampi.scp.literature.sparse_subproblem import (
    SparseStep,
    SparseSubproblem,
    solve_sparse_subproblem,
)
from ampi.scp.literature.subproblem_builder import MeshIterate, SubproblemBuilder

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SubproblemRecord:
    """One row of the log."""

    iteration: int
    nodes: int
    cost: float  # objective of the nonlinear problem, scaled
    quadratic_penalty: float  # ρ
    relaxation: float  # η
    final: float  # s or the final energy
    change: tuple[float, ...]  # greatest change of every state, SI or rad
    target_slack: float
    limit_slack: float
    status: ConeStatus
    seconds: float  # in the solver
    global_error: tuple[float, ...] = ()  # Δx_f, Zhou Eq. (41), SI or rad


class Ending(Enum):
    """How an iteration, or a refinement of its mesh, ended."""

    CONVERGED = "Converged."
    ITERATION_LIMIT = "Stopped at the iteration limit."
    SUBPROBLEM_FAILED = "Stopped: a convex subproblem returned no usable step."
    MESH_LIMIT = "Converged, but the mesh reached a cap before its tolerance."


SubproblemSolver = Callable[[SparseSubproblem], SparseStep]


@dataclass(frozen=True)
class StateChange:
    """max_i |x_i^{k+1} − x_i^k| ≤ ε: Zhou 2021, Eq. (44); Liu 2015, Eq. (70); Wang 2020, Eq. (36)."""

    tolerance: tuple[float, ...]  # ε per state that there may be, SI or rad; inf where not asked

    def reached(self, log: list[SubproblemRecord]) -> bool:
        """Whether the last step was small."""
        change = np.array(log[-1].change)
        return bool(np.all(change <= np.array(self.tolerance[: len(change)])))


@dataclass(frozen=True)
class GlobalErrorChange:
    """|Δx_f^{k+1} − Δx_f^k| ≤ ε with Δx_f the end error of the flight flown again: Zhou, Eq. (43)."""

    tolerance: tuple[float, ...]  # ε per state, SI or rad

    def reached(self, log: list[SubproblemRecord]) -> bool:
        """Whether the end error has settled."""
        if len(log) < 2:
            return False
        n = len(self.tolerance)
        change = np.subtract(log[-1].global_error[:n], log[-2].global_error[:n])
        return bool(np.all(np.abs(change) <= np.array(self.tolerance)))


@dataclass(frozen=True, kw_only=True)
class VariableQuadraticPenalty:
    """A proximal term that comes and goes: Liu et al. 2024, Section 4.3 (its rule is our reading).

    A linearised problem with a fixed trust region may jump between two flights for ever. The sign of
    that is an objective that goes up and down by steps that do not shrink: then ρ appears, and grows
    while it goes on. As soon as the objective is steady ρ falls again, for it slows convergence.
    """

    initial: float = 0.0  # ρ of the first subproblem
    first: float = 0.05  # ρ when it appears, in units of the scaled cost
    grow: float = 4.0
    shrink: float = 0.5
    settled: float = 0.7  # |ΔJ| must fall below this share of the last one to count as shrinking

    def update(self, penalty: float, costs: list[float]) -> float:
        """ρ of the next subproblem from the objectives so far."""
        if len(costs) < 3:
            return penalty
        now, before = costs[-1] - costs[-2], costs[-2] - costs[-3]
        if now * before < 0.0 and abs(now) > self.settled * abs(before):
            return max(self.first, self.grow * penalty)
        return self.shrink * penalty if penalty > 0.01 * self.first else 0.0


Convergence = StateChange | GlobalErrorChange
Adaptation = Callable[[Formulation, MeshIterate], MeshIterate]
EndError = Callable[[Formulation, MeshIterate], Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class Successive:
    """The iteration with all its parts."""

    builder: SubproblemBuilder
    transcribe: Callable[[Mesh], Collocation]
    convergence: Convergence
    max_iterations: int
    penalty: VariableQuadraticPenalty | None = None
    relaxation: AitkenRelaxation | None = None  # on a mesh that does not change
    adapt: Adaptation | None = None
    end_error: EndError | None = None
    solver: SubproblemSolver = solve_sparse_subproblem

    def run(self, start: MeshIterate) -> Run:
        """MeshIterate from `start` until convergence, the iteration limit or an unusable step."""
        form, at, log = self.builder.formulation, start, list[SubproblemRecord]()
        rule = self.transcribe(at.mesh)
        ending = Ending.ITERATION_LIMIT
        quadratic = 0.0 if self.penalty is None else self.penalty.initial
        costs, multipliers = [self.builder.cost(rule, at)], None
        last, length = None, 1.0
        for iteration in range(1, self.max_iterations + 1):
            problem = self.builder.subproblem(rule, at, quadratic, multipliers)
            built = time.perf_counter()
            step = self.solver(problem)
            seconds = time.perf_counter() - built
            if not step.usable:
                ending = Ending.SUBPROBLEM_FAILED
                break
            at = MeshIterate(
                at.mesh,
                at.states + step.states,
                at.controls + step.controls,
                at.final + step.final * form.final_scale,
            )
            multipliers = step.dynamics_multipliers
            costs.append(self.builder.cost(rule, at))
            error = () if self.end_error is None else tuple(self.end_error(form, at))
            change = np.abs(step.states).max(axis=0) * form.state_scale
            log.append(
                SubproblemRecord(
                    iteration=iteration,
                    nodes=at.mesh.n_nodes,
                    cost=costs[-1],
                    quadratic_penalty=quadratic,
                    relaxation=step.relaxation,
                    final=at.final,
                    change=tuple(change),
                    target_slack=float(step.target_slack.max(initial=0.0)),
                    limit_slack=float(step.limit_slack.max(initial=0.0)),
                    status=step.status,
                    seconds=seconds,
                    global_error=error,
                )
            )
            if self.convergence.reached(log):
                ending = Ending.CONVERGED
                break
            if self.penalty is not None:
                quadratic = self.penalty.update(quadratic, costs)
            if self.relaxation is not None and iteration < self.max_iterations:
                in_radii = step.states / problem.trust_radius
                length = self.relaxation.length(in_radii, last, length)
                last, at = in_radii, _further(at, step, length, form)
            if self.adapt is not None and iteration < self.max_iterations:
                adapted = self.adapt(form, at)
                if adapted is not at:
                    at, rule = adapted, self.transcribe(adapted.mesh)
        return Run(at, ending, tuple(log))


def _further(at: MeshIterate, step: SparseStep, length: float, form: Formulation) -> MeshIterate:
    """`length` of a step of which one was taken; the controls, which may be on their cone, stay."""
    more = length - 1.0
    final = at.final + more * step.final * form.final_scale
    return MeshIterate(at.mesh, at.states + more * step.states, at.controls, final)


@dataclass(frozen=True, eq=False)
class Run:
    """Where the iteration ended and how it got there."""

    iterate: MeshIterate
    ending: Ending
    log: tuple[SubproblemRecord, ...]
