"""The methods of the literature, each as a combination of named parts.

| name            | formulation | transcription          | trust region | extras                        |
|-----------------|-------------|------------------------|--------------|-------------------------------|
| zhou2021        | time        | trapezoid, adaptive    | relaxed (η)  | global-error convergence      |
| zhou2021_fixed  | time        | trapezoid, 400 points  | relaxed (η)  | global-error convergence      |
| liu2015         | energy      | trapezoid, 201 points  | fixed        | cone, curvature, Aitken step  |
| wang2020_scp    | time        | trapezoid, 201 points  | fixed        | variable penalty (ours)       |
| wang2020_pscp   | time        | Radau, 1 × 200         | fixed        |                               |
| wang2020        | time        | Radau, 10 × 20         | fixed        |                               |
| liu2024_hp      | time        | Radau, hp              | fixed        | variable penalty              |
| liu2024         | time        | Radau, hp, reduced     | fixed        | variable penalty              |

Numbers are those of the papers; what they leave open is marked [X]. So is the eighth of a number for
each state: it is of an angle of attack that is a control, which the papers do not have.

References
----------
Zhou, He, Zhang, Tang, Bao (2021), Aerosp. Sci. Technol. 109, 106374.
Liu, Shen, Lu (2015), J. Guid. Control Dyn., doi 10.2514/1.G001210.
Wang, Wang, Tang, Guo (2020), "Entry Trajectory Optimization via hp Pseudospectral Convex Programming".
Liu, Cui, Du, Pu (2024), Aerospace 11, 785.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ampi.missions.final_states import TargetMiss
from ampi.missions.mission import Mission
from ampi.missions.path_limits import KEPT
from ampi.physics.state import LOADS
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.acceleration import AitkenRelaxation
from ampi.scp.literature.adaptive_mesh import LocalErrorAdaptation, global_error
from ampi.scp.literature.collocation import Collocation, line_mesh, radau, trapezoid
from ampi.scp.literature.formulation import Formulation
from ampi.scp.literature.modified_hp import ModifiedHpSettings, Refined, Round, refine_and_reduce
from ampi.scp.literature.sparse_subproblem import solve_sparse_subproblem
from ampi.scp.literature.starts import (
    Start,
    flown,
    over_energy,
    straight_line,
    typical_cost,
    uniform,
)
from ampi.scp.literature.subproblem_builder import (
    MeshIterate,
    Prices,
    StateTrustRegion,
    SubproblemBuilder,
)
from ampi.scp.literature.successive import (
    Convergence,
    Ending,
    GlobalErrorChange,
    Run,
    StateChange,
    SubproblemRecord,
    SubproblemSolver,
    Successive,
    VariableQuadraticPenalty,
)
from ampi.trajectory import IterationRecord, Statistics, Status, Trajectory

Array = NDArray[np.float64]

DEGREE = float(np.pi / 180.0)
EARTH_RADIUS = 6378137.0  # m, R₀ of the papers
CIRCULAR_SPEED = 7905.4  # m/s, √(g₀ R₀)
TIME_UNIT = 806.81  # s, √(R₀/g₀)


@dataclass(frozen=True, kw_only=True, eq=False)
class Method:
    """The parts. A field that is None or zero is a part that the method does without."""

    source: str
    start: Callable[[Mission], Start | None]  # None: no flyable guess
    transcribe: Callable[[Mesh], Collocation]
    trust_region: StateTrustRegion
    prices: Prices
    convergence: Convergence
    max_iterations: int
    own_cost_unit: float | None = None  # scaled cost per unit of the mission's, ∫ dτ: Zhou Eq. (34)
    final_bounds: tuple[float, float] = (-np.inf, np.inf)  # s, for a free final time
    limit_margin: float = 0.0
    curved_states: tuple[int, ...] = ()
    penalty: VariableQuadraticPenalty | None = None
    relaxation: AitkenRelaxation | None = None
    adapt: LocalErrorAdaptation | None = None
    global_error: bool = False  # computed at every iteration
    refinement: ModifiedHpSettings | None = None


@dataclass(frozen=True, eq=False)
class Solution:
    """A trajectory and how the method came to it."""

    trajectory: Trajectory
    formulation: Formulation
    iterate: MeshIterate
    log: tuple[SubproblemRecord, ...]
    rounds: tuple[Round, ...]


def solve_by(
    mission: Mission, method: Method, solver: SubproblemSolver = solve_sparse_subproblem
) -> Solution | None:
    """Solve a mission by a method of the literature; None if its guess cannot be flown."""
    began = time.perf_counter()
    start = method.start(mission)
    if start is None:
        return None
    successive = _assemble(mission, method, start.formulation, solver)
    if method.refinement is None:
        run = successive.run(start.iterate)
        refined = Refined(run, (), run.ending)
        log = run.log
    else:
        logs: list[SubproblemRecord] = []

        def solve_on(at: MeshIterate) -> Run:
            run = successive.run(at)
            logs.extend(run.log)
            return run

        refined = refine_and_reduce(start.formulation, solve_on, start.iterate, method.refinement)
        log = tuple(logs)
    trajectory = _trajectory(mission, successive, refined, log, time.perf_counter() - began)
    return Solution(trajectory, start.formulation, refined.run.iterate, log, refined.rounds)


def _assemble(
    mission: Mission, method: Method, formulation: Formulation, solver: SubproblemSolver
) -> Successive:
    curved = method.curved_states
    if mission.objective.has_terminal:
        # ours: without the curvature, a cost of the final state goes up and down for ever
        curved = tuple(range(formulation.n_states))
    builder = SubproblemBuilder(
        formulation=formulation,
        trust_region=method.trust_region,
        prices=method.prices,
        cost_scale=method.own_cost_unit or 1.0 / typical_cost(mission),
        frozen_time=method.own_cost_unit is not None,
        final_bounds=method.final_bounds,
        limit_margin=method.limit_margin,
        curved_states=curved,
    )
    return Successive(
        builder=builder,
        transcribe=method.transcribe,
        convergence=method.convergence,
        max_iterations=method.max_iterations,
        penalty=method.penalty,
        relaxation=method.relaxation,
        adapt=method.adapt,
        end_error=global_error if method.global_error else None,
        solver=solver,
    )


def _trajectory(
    mission: Mission,
    successive: Successive,
    refined: Refined,
    log: tuple[SubproblemRecord, ...],
    seconds: float,
) -> Trajectory:
    builder, at = successive.builder, refined.run.iterate
    form = builder.formulation
    flight = form.trajectory(at.mesh, at.states, at.controls, at.final)
    lin = form.linearise(at.mesh, at.states, at.controls, at.final)
    excess = dict(zip(form.limit_names, np.maximum(lin.limits.max(axis=0) - 1.0, 0.0), strict=True))
    cost = builder.cost(successive.transcribe(at.mesh), at)
    records = tuple(
        IterationRecord(
            iteration=k,
            cost=_mission_cost(builder, row.cost, row.final),
            merit=np.nan,
            step=float(np.max(np.array(row.change)[1:3])),
            final_time=row.final,
            trust_radius=np.nan,
            ratio=np.nan,
            accepted=True,
            subproblem=row.status,
        )
        for k, row in enumerate(log, start=1)
    )
    statistics = Statistics(
        iterations=len(log),
        solve_seconds=seconds,
        subproblem_seconds=sum(row.seconds for row in log),
        limit_excess=tuple(float(excess[name]) for name in LOADS),
        log=records,
    )
    return replace(
        flight,
        cost=_mission_cost(builder, cost, at.final),
        status=_status(mission, refined.ending, flight, float(np.max(list(excess.values())))),
        statistics=statistics,
    )


def _mission_cost(builder: SubproblemBuilder, cost: float, final: float) -> float:
    """In the mission's units: a cost over ∫ dτ is a mean over the flight, the mission's is not."""
    return cost * (final if builder.frozen_time else 1.0) / builder.cost_scale


_STATUS = {  # of a run that did not converge; others are judged by their limits and their end
    Ending.ITERATION_LIMIT: Status.ITERATION_LIMIT,
    Ending.SUBPROBLEM_FAILED: Status.SUBPROBLEM_FAILED,
}


def _status(mission: Mission, ended: Ending, flight: Trajectory, excess: float) -> Status:
    if ended in _STATUS:
        return _STATUS[ended]
    if not excess <= KEPT:  # NaN too
        return Status.LIMITS_EXCEEDED
    if not TargetMiss.of(mission, flight.states[:, -1]).is_met:
        return Status.TARGET_MISSED
    return Status.REFINEMENT_LIMIT if ended is Ending.MESH_LIMIT else Status.SOLVED


def loose_nodes(solution: Solution, tolerance: float = 1e-3) -> NDArray[np.intp]:
    """Nodes where u₁² + u₂² < 1: where the relaxation of Liu 2015, Eq. (49), is not tight."""
    return np.flatnonzero(np.sum(solution.iterate.controls**2, axis=1) < 1.0 - tolerance)


ZHOU = Method(
    source="Zhou et al. 2021, adaptive mesh",
    start=straight_line(400, 1700.0),  # [X] the flight time of the guess is unpublished
    transcribe=trapezoid,
    trust_region=StateTrustRegion(
        radius=(
            *(20e3, 20 * DEGREE, 20 * DEGREE, 500.0, 20 * DEGREE, 30 * DEGREE, 90 * DEGREE),
            20 * DEGREE,
        ),
        price=100.0,  # C₃
    ),
    prices=Prices(
        # C₂ per R₀, C₁ per rad; the speed is an equality in the paper, here 10⁴ per √(g₀R₀) [X]:
        # as an equality the first subproblems have no solution
        target=(1e4 / EARTH_RADIUS, 1e6, 1e6, 1e4 / CIRCULAR_SPEED, *(1e4,) * 4),
        limits=1e5,  # [X] equalities in the paper
    ),
    convergence=GlobalErrorChange(
        (100.0, 0.5 * DEGREE, 0.5 * DEGREE, 50.0, 0.5 * DEGREE, 5 * DEGREE)
    ),
    max_iterations=40,
    own_cost_unit=DEGREE * TIME_UNIT,  # ∫ |u| dτ with u in rad per time unit
    final_bounds=(800.0, 2500.0),  # Section 4.1
    adapt=LocalErrorAdaptation(
        # [X] the unit of Δ is unpublished; a twentieth of R₀, 1 rad and √(g₀R₀) leaves as many points
        # under ε₊ = 1e-2, ε₋ = 1e-3 as the paper reports
        units=(EARTH_RADIUS / 20, 0.05, 0.05, CIRCULAR_SPEED / 20, *(0.05,) * 4),
    ),
    global_error=True,
)

LIU_2015 = Method(
    source="Liu, Shen, Lu 2015",
    start=over_energy(201),
    transcribe=trapezoid,
    trust_region=StateTrustRegion(
        (20e3, 20 * DEGREE, 20 * DEGREE, 20 * DEGREE, 70 * DEGREE)  # Section V
    ),
    prices=Prices(
        target=(0.01, 100.0, 100.0, 100.0, 100.0), limits=100.0
    ),  # [X] c_θ, c_φ unpublished
    convergence=StateChange((200.0, *(0.05 * DEGREE,) * 4)),  # Section V
    max_iterations=20,
    # ours: without the curvature along ψ the CAV-H does not converge in 20 iterations, without that
    # along h the maximum range diverges; the X-33's other cases need neither. The whole matrix of a
    # node, its eigenvalues clipped, was tried: twice the iterations
    curved_states=(0, 4),
    # ours: where the minimum heat load climbs once more, the Lagrangian curves downwards along h
    relaxation=AitkenRelaxation(),
)

WANG = Method(
    source="Wang et al. 2020, hp-PSCP",
    start=flown(uniform(10, 20)),
    transcribe=radau,
    trust_region=StateTrustRegion(
        (
            *(5e3, 5 * DEGREE, 5 * DEGREE, 500.0, 5 * DEGREE, 5 * DEGREE, 10 * DEGREE),  # Eq. (39)
            5 * DEGREE,
        )
    ),
    prices=Prices(target=(0.1, 1e3, 1e3, 1.0, *(1e3,) * 4), limits=1e3),  # [X] hard in the paper
    convergence=StateChange(
        (
            *(
                200.0,
                0.1 * DEGREE,
                0.1 * DEGREE,
                1.0,
                0.1 * DEGREE,
                0.1 * DEGREE,
                DEGREE,
            ),  # Eq. (40)
            DEGREE,
        )
    ),
    max_iterations=40,
)

REDUCED = ModifiedHpSettings(
    # an angle that is steered is the polynomial itself: it has no error
    tolerance=(110.0, 1.7e-5, 1.7e-5, 2.75, 5.5e-4, 5.5e-4, np.inf, np.inf),
    limit_tolerance=0.0,
)

LIU_2024 = Method(
    source="Liu et al. 2024, modified hp with reduction, variable quadratic penalty",
    start=flown(uniform(16, 8)),  # [X] as everything here: the paper's settings are lost
    transcribe=radau,
    trust_region=StateTrustRegion(
        (
            *(10e3, 10 * DEGREE, 10 * DEGREE, 500.0, 10 * DEGREE, 20 * DEGREE, 40 * DEGREE),
            10 * DEGREE,
        )
    ),
    prices=Prices(target=(0.1, 1e3, 1e3, 1.0, *(1e3,) * 4), limits=1e3),
    convergence=StateChange(
        (
            *(100.0, 0.05 * DEGREE, 0.05 * DEGREE, 5.0, 0.05 * DEGREE, 0.2 * DEGREE, DEGREE),
            DEGREE,
        )
    ),
    max_iterations=40,
    limit_margin=2e-3,
    penalty=VariableQuadraticPenalty(),
    refinement=REDUCED,
)

METHODS: dict[str, Method] = {
    "zhou2021": ZHOU,
    "zhou2021_fixed": replace(ZHOU, source="Zhou et al. 2021, fixed mesh", adapt=None),
    "liu2015": LIU_2015,
    "wang2020_scp": replace(
        WANG,
        source="Wang et al. 2020, SCP",
        start=flown(line_mesh(np.linspace(0.0, 1.0, 201))),
        transcribe=trapezoid,
        # ours: without it the iteration jumps for ever between two flights whose costs differ by 2e-5
        penalty=VariableQuadraticPenalty(),
    ),
    "wang2020_pscp": replace(WANG, source="Wang et al. 2020, PSCP", start=flown(uniform(1, 200))),
    "wang2020": WANG,
    "liu2024_hp": replace(
        LIU_2024,
        source="Liu et al. 2024, hp without reduction",
        refinement=replace(REDUCED, reduce=False),
    ),
    "liu2024": LIU_2024,
}
