"""What is feasible, before a week of computing: reach, limits, mesh, corners, size and time.

reach      ranges of the nominal vehicle with its bank angle held, by propagation
optimum    the nominal case solved and flown again: which limits bind
mesh       that flight against its nodes, and the same case on a finer mesh
corners    the extreme cases of the grid (database.corners)
cost       the cases of the grid times the seconds of one here, and the bytes of its file
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ampi.guidance import NUMPY
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.planet import great_circle_distance
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.problem.shortfall import outcome_sentence
from ampi.scp.solve import solve
from ampi.simulation.physical_reach import Authority, nearest_misses
from ampi.simulation.plant import Plant
from ampi.simulation.reach import ranges
from ampi.simulation.world_loading import parse_world
from ampi.trajectory import POSITION_TOLERANCE, Status, Trajectory
from database.corners import Corners, solve_corners
from database.estimate import Estimate, estimate

NOMINAL = 'name = "nominal"\ntitle = "Nominal"\n[entry]\ndistribution = "none"\n'
LONGEST = 6000.0  # s, of a flight with its bank angle held
BANKS = (0.0, 0.5, -0.5)  # of the limit, where the search for a plan begins
BINDS = 0.99  # of what an optimum may use of a limit
FINER = 4  # degrees more in each segment
COST_MOVED = 0.01  # relative: more on a finer mesh, and the mesh is not adequate


@dataclass(frozen=True)
class Reach:
    """Of the nominal vehicle; NaN where it is unknown, or where the target has no position.

    Unknown are the ranges of a vehicle that steers its angle of attack: none is held.
    """

    distance: float  # m, from entry to target over the ground
    least: float  # m, range with the bank angle held at its limit, to the target speed
    greatest: float  # m, range wings level
    nearest: float = (
        np.nan
    )  # m, from the target: of the best plan found; sought where no optimum is

    @property
    def within(self) -> bool:
        """Whether the target lies between both ranges, or that is unknown."""
        return not (self.distance > self.greatest or self.distance < self.least)


@dataclass(frozen=True)
class MeshCheck:
    """The nominal optimum flown again, and what a finer mesh makes of the case."""

    nodes: int
    position_error: float  # m, greatest over the nodes, of the flight
    finer_nodes: int
    finer_status: Status
    final_time_moved: float  # s, by the finer mesh
    cost_moved: float  # relative

    @property
    def adequate(self) -> bool:
        """Whether the flight is that of the nodes and the finer mesh finds the same."""
        return (
            self.position_error <= POSITION_TOLERANCE
            and self.finer_status.ok
            and self.cost_moved <= COST_MOVED
        )


@dataclass(frozen=True)
class Feasibility:
    """What was found; parts that need a nominal optimum, or a grid, are None without one."""

    mission: str
    reach: Reach
    status: Status  # of the nominal optimum
    sentence: str  # what it says, and what is open
    use: dict[str, float]  # of each limit
    binding: tuple[str, ...]  # names of those that bind
    mesh: MeshCheck | None
    corners: Corners | None
    cost: Estimate | None

    @property
    def clear(self) -> bool:
        """Whether nothing speaks against the build."""
        whole = self.corners is None or not self.corners.failed
        return self.status.ok and self.mesh is not None and self.mesh.adequate and whole

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        found = asdict(self)
        found["reach"]["within"] = self.reach.within
        found["status"] = self.status.name
        if self.mesh is not None:
            found["mesh"] |= {
                "adequate": self.mesh.adequate,
                "finer_status": self.mesh.finer_status.name,
            }
        if self.corners is not None:
            for corner in found["corners"]["solved"]:
                corner["status"] = corner["status"].name
        return {**found, "clear": self.clear}


def feasibility(
    mission: Mission,
    *,
    workers: int = 1,
    folder: Path | None = None,
    advance: Callable[[int], None] = lambda count: None,
) -> Feasibility:
    """Look at a mission before its grid is built.

    Parameters
    ----------
    mission
        From `load_mission`.
    workers
        Processes that the build will have.
    folder
        Where its file will lie; by default the working folder.
    advance
        Called with the number of steps done, of five and the corners.
    """
    reach = _reach(mission)
    advance(1)
    nominal = solve(mission)
    advance(1)
    sentence = outcome_sentence(mission, nominal)
    flight = nominal.statistics.flight
    use = {} if flight is None else flight.use
    found = Feasibility(
        mission.name, reach, nominal.status, sentence, use, _binding(mission, use), None, None, None
    )
    if not nominal.status.ok and nominal.status is not Status.INACCURATE:
        sought = not mission.target.place_is_free and mission.angle_of_attack is None
        nearest = _nearest(mission) if sought else np.nan
        return replace(found, reach=replace(reach, nearest=nearest))
    found = replace(found, mesh=_mesh(mission, nominal))
    advance(1)
    if not mission.parameters or not nominal.status.ok:
        return found
    corners = solve_corners(mission, nominal, advance)
    cost = estimate(mission, (folder or Path()) / f"{mission.name}.h5", workers=workers)
    cost = replace(cost, seconds=corners.seconds_each * cost.cases / workers)
    return replace(found, corners=corners, cost=cost)


def _plant(mission: Mission, n: int) -> Plant:
    """The nominal vehicle, n times."""
    truth = parse_world(NOMINAL).draw(mission, n, seed=0)
    return Plant(mission.family(truth.parameters), truth, np.full(n, LONGEST))


def _reach(mission: Mission) -> Reach:
    least, greatest = ranges(_plant(mission, 1), NUMPY)
    distance, target = np.nan, mission.target
    if not target.place_is_free:
        entry, radius = mission.entry, mission.flight_model.planet.equatorial_radius
        ends = (entry.longitude, entry.latitude, target.longitude, target.latitude)
        distance = float(great_circle_distance(*ends, radius))
    return Reach(distance, float(least[0]), float(greatest[0]))


def _nearest(mission: Mission) -> float:
    """The distance (m) from the target of the best plan of bank angles that is found."""
    limits = mission.limits
    authority = Authority(
        bank_angle=limits.bank_angle, bank_rate=limits.bank_rate, angle=0.0, angle_rate=0.0
    )
    banks = limits.bank_angle * np.array(BANKS)
    missed = nearest_misses(_plant(mission, len(banks)), authority, banks)
    away = np.hypot(missed[0], missed[1])
    return float(np.nanmin(away)) if np.isfinite(away).any() else np.nan


def _binding(mission: Mission, use: dict[str, float]) -> tuple[str, ...]:
    """The limits that the nominal flight uses up, margins left out."""
    names = PathLimits.of(mission).names
    return tuple(name for name in names if use and use[name] >= BINDS * mission.limits.share(name))


def _mesh(mission: Mission, nominal: Trajectory) -> MeshCheck:
    mesh = mission.pseudospectral_mesh
    phases = tuple(
        replace(phase, degrees=tuple(degree + FINER for degree in phase.degrees))
        for phase in mesh.phases
    )
    finer = solve(mission.with_mesh(Mesh(phases, mesh.start)), guess=nominal)
    flight = nominal.statistics.flight
    return MeshCheck(
        nodes=mesh.n_nodes,
        position_error=np.inf if flight is None else flight.position_error,
        finer_nodes=finer.mesh.n_nodes,
        finer_status=finer.status,
        final_time_moved=finer.final_time - nominal.final_time,
        cost_moved=abs(finer.cost - nominal.cost) / max(abs(nominal.cost), np.finfo(float).tiny),
    )
