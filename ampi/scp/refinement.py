"""hp mesh refinement of any collocation solver: where the mesh fails, first a degree, then a cut.

A solution is looked at independently of its collocation. Every segment is flown again by DOP853 from
its collocated start under its bank-angle polynomial, and the limits are read between the nodes:

    r_s = max( ‖x̃_s − x_s‖_∞ / (scale · tolerance),  (max g − 1) / limit_tolerance )        (1)

Where r_s ≤ 1 everywhere the mesh will do. Elsewhere (Patterson, Hager & Rao 2015, Eqs. 27, 31) a segment
of degree N would reach the tolerance, were its error to fall by the factor N per degree, with

    N' = N + max(2, ⌈ln r_s / ln N⌉);                                                (2)

it gets that degree while N' ≤ `greatest_degree`, and else is cut into ⌈N' / least_degree⌉ equal parts,
at most `most_parts`, of half its degree, at least `least_degree`. The next solve starts from the last
solution.

The estimate, the mesh and the caps know no solver: `refine` calls any `solve_on(mission, guess)`.

References
----------
Patterson, Hager, Rao (2015), "A ph mesh refinement method for optimal control", Optim. Control Appl.
Methods 36. Darby, Hager, Rao (2011), Optim. Control Appl. Methods 32.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.path_limits import KEPT, PathLimits
from ampi.physics.state import BANK, STEERING
from ampi.propagation.adaptive_step import Accuracy, IntegrationError
from ampi.propagation.segment_flight import fly_segment
from ampi.pseudospectral.mesh import Mesh, Phase, Segment
from ampi.scp.problem.scaled_problem import Scaling
from ampi.trajectory import RefinementRound, Status, Trajectory

Array = NDArray[np.float64]

ACCURACY = Accuracy(relative=1e-9)
STATE_SCALE = Scaling().states  # m, rad, m/s
SolveOn = Callable[[Mission, Any], Trajectory]


@dataclass(frozen=True, kw_only=True)
class RefinementSettings:
    """What is asked for, how meshes grow, and the caps after which refinement gives up."""

    tolerance: float = 1e-5  # of a segment's states, over 10 km, 1 rad, 1 km/s
    limit_tolerance: float = KEPT  # relative excess of a limit between the nodes
    spacing: float = 1.0  # s, at most, of the points where the limits are read
    least_degree: int = 4
    greatest_degree: int = 14
    most_parts: int = 3
    max_nodes: int = 300
    max_segments: int = 60
    max_rounds: int = 8
    max_seconds: float = 300.0  # no round starts after that

    def __post_init__(self) -> None:
        if not 1 <= self.least_degree <= self.greatest_degree:
            raise ValueError(
                f"refinement: expected 1 ≤ least_degree ≤ greatest_degree, got {self.least_degree} "
                f"and {self.greatest_degree}"
            )
        for name in (
            "tolerance",
            "limit_tolerance",
            "spacing",
            "max_nodes",
            "max_rounds",
            "max_seconds",
        ):
            if getattr(self, name) <= 0:
                raise ValueError(f"refinement.{name}: must be positive, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False)
class MeshError:
    """An independent look at each segment."""

    state: Array  # (segments,), over `STATE_SCALE`
    excess: Array  # (segments,), greatest g − 1 between the nodes

    def ratio(self, settings: RefinementSettings) -> Array:
        """r of Eq. (1)."""
        return np.maximum(self.state / settings.tolerance, self.excess / settings.limit_tolerance)


def mesh_error(mission: Mission, trajectory: Trajectory, settings: RefinementSettings) -> MeshError:
    """Fly every segment again and read the limits between its nodes."""
    limits = PathLimits.of(mission)
    found = [
        _segment_error(mission, limits, trajectory, s, settings.spacing)
        for s in trajectory.mesh.segments
    ]
    state, excess = np.array(found).T
    return MeshError(state, excess)


def _segment_error(
    mission: Mission, limits: PathLimits, trajectory: Trajectory, s: Segment, spacing: float
) -> tuple[float, float]:
    collocated = trajectory.states[None, :, s.nodes]
    first, angles = collocated[:, :BANK, 0], collocated[:, BANK:].swapaxes(0, 1)
    final_time = np.array([trajectory.final_time])
    model = mission.flight_model
    try:
        flight = fly_segment(model, s, angles, first, final_time, spacing, ACCURACY)
    except IntegrationError:
        return np.inf, np.inf
    scale = np.array(STATE_SCALE[:BANK])
    off = np.abs(flight.states[..., flight.at_nodes] - collocated)[0, :BANK].max(axis=1)
    steering = dict(zip(STEERING, flight.rates[:, 0], strict=False))
    use = limits.use(model, flight.states[0], time=flight.times[0], **steering)
    # not the rates: beside a switch their polynomials overshoot on any mesh, the more the finer
    read = [one for name, one in zip(limits.names, use, strict=True) if name not in STEERING]
    return float((off / scale).max()), max(float(np.max(one)) for one in read) - 1.0


def refined_mesh(mesh: Mesh, ratio: Array, settings: RefinementSettings) -> Mesh:
    """The next mesh from r (segments,) of Eq. (1); unchanged where r ≤ 1."""
    phases, first = [], 0
    for phase in mesh.phases:
        degrees: list[int] = []
        cuts = [0.0]
        for degree, (left, right) in zip(phase.degrees, pairwise(phase.cuts), strict=True):
            parts = _parts(degree, float(ratio[first]), settings)
            first += 1
            degrees += parts
            cuts += [float(c) for c in np.linspace(left, right, len(parts) + 1)[1:]]
        cuts[-1] = 1.0
        phases.append(Phase(tuple(degrees), phase.end, tuple(cuts)))
    return Mesh(tuple(phases))


def _parts(degree: int, ratio: float, settings: RefinementSettings) -> list[int]:
    """Degrees of what one segment becomes, Eq. (2)."""
    if ratio <= 1.0:
        return [degree]
    raised = settings.greatest_degree + settings.least_degree
    if np.isfinite(ratio):
        raised = degree + max(2, int(np.ceil(np.log(ratio) / np.log(max(degree, 2)))))
    if raised <= settings.greatest_degree:
        return [raised]
    parts = int(np.ceil(raised / settings.least_degree))
    parts = min(max(parts, 2), settings.most_parts)
    return [max(settings.least_degree, -(-degree // 2))] * parts


def refine(
    mission: Mission,
    solve_on: SolveOn,
    *,
    guess: Any = None,
    settings: RefinementSettings | None = None,
) -> Trajectory:
    """Solve on the mission's mesh, and on finer ones until Eq. (1) holds or a cap is reached.

    Parameters
    ----------
    mission
        Its mesh is the first one.
    solve_on
        Solves the mission it is given, on its mesh, from a guess: the argument `guess` in the first
        round, then the last solution.
    settings
        Tolerances and caps.

    Returns
    -------
    Trajectory
        Of the last round. `Status.REFINEMENT_LIMIT` if it is converged and its mesh not good enough;
        the rounds stand in its statistics, and its iterations and seconds are those of all rounds.
    """
    settings = settings or RefinementSettings()
    began, rounds = time.perf_counter(), []
    trajectory = solve_on(mission, guess)
    while True:
        good, mesh = True, trajectory.mesh
        error = None
        if np.all(np.isfinite(trajectory.states)):
            error = mesh_error(mission, trajectory, settings)
            ratio = error.ratio(settings)
            good, mesh = bool(np.all(ratio <= 1.0)), refined_mesh(mesh, ratio, settings)
        rounds.append(_record(trajectory, error))
        if trajectory.status is not Status.SOLVED or good:
            return _with_rounds(trajectory, rounds, trajectory.status)
        late = time.perf_counter() - began > settings.max_seconds
        large = mesh.n_nodes > settings.max_nodes or len(mesh.segments) > settings.max_segments
        if late or large or len(rounds) >= settings.max_rounds:
            return _with_rounds(trajectory, rounds, Status.REFINEMENT_LIMIT)
        trajectory = solve_on(mission.with_mesh(mesh), trajectory)


def _record(trajectory: Trajectory, error: MeshError | None) -> RefinementRound:
    return RefinementRound(
        nodes=trajectory.mesh.n_nodes,
        segments=len(trajectory.mesh.segments),
        iterations=trajectory.statistics.iterations,
        solve_seconds=trajectory.statistics.solve_seconds,
        cost=trajectory.cost,
        state_error=np.nan if error is None else float(error.state.max()),
        limit_excess=np.nan if error is None else float(error.excess.max()),
    )


def _with_rounds(
    trajectory: Trajectory, rounds: list[RefinementRound], status: Status
) -> Trajectory:
    statistics = replace(
        trajectory.statistics,
        iterations=sum(r.iterations for r in rounds),
        solve_seconds=sum(r.solve_seconds for r in rounds),
        rounds=tuple(rounds),
    )
    return replace(trajectory, status=status, statistics=statistics)
