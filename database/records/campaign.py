"""What all jobs of a build share: mission, grid, optimiser, and the records already kept."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

from ampi.dataset import SENSITIVITIES, TrajectoryDataset
from ampi.missions.family import MissionFamily
from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.solve import solve
from ampi.tracker_design.riccati_gains import GainSettings
from ampi.trajectory import Trajectory
from database.plan.grid import Grid
from database.records.case_record import CaseRecord
from database.records.record_files import again_folder, keeping_records

TIME_LIMIT = 60.0  # s for one solve: some 300 times what a hard one takes


class BuildError(ValueError):
    """A build that cannot start or go on; the message says what is in its way."""


class Solver(Protocol):
    """An optimiser: a mission and a neighbour's trajectory in, a trajectory out."""

    __module__: str
    __qualname__: str

    def __call__(self, mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
        """Solve."""


def solver_name(solver: Solver) -> str:
    """Where to find an optimiser, for the records and for the file."""
    return f"{solver.__module__}.{solver.__qualname__}"


def as_built(dataset: TrajectoryDataset, solver: Solver) -> dict[str, Any]:
    """The settings that a database was built with, by the names that `database.build` has for them.

    Raises
    ------
    ValueError
        If it was built by another optimiser than `solver`.
    """
    require_solver(str(dataset.attributes["solver"]), solver)
    return {
        "solver": solver,
        "settings": settings_of(str(dataset.attributes["settings"])) if solver is solve else None,
        "time_limit": float(dataset.attributes["time_limit"]),
        "gains": GainSettings(**json.loads(dataset.attributes["gain_settings"])),
        "sensitivities": SENSITIVITIES in dataset.attributes,
    }


def settings_of(text: str) -> SolverSettings:
    """Solver settings from their JSON (`database.file.provenance`)."""
    given: dict[str, Any] = json.loads(text)
    for name, value in given.items():
        if isinstance(value, dict):
            given[name] = type(getattr(SolverSettings(), name))(**value)
    return SolverSettings(**given)


def require_solver(made_by: str, solver: Solver) -> None:
    """Raise ValueError unless cases made by the optimiser of this name are those of `solver`."""
    if made_by != solver_name(solver):
        raise ValueError(
            f"solver: the cases were solved by {made_by}, got {solver_name(solver)}; import that one "
            "and give it as `solver`, so that all cases are of one kind"
        )


@dataclass(frozen=True)
class Campaign:
    """What all jobs of a build share; it travels to the workers."""

    toml: str
    folder: Path
    solver: Solver = solve
    settings: SolverSettings = field(default_factory=SolverSettings)  # of `solve`
    time_limit: float = TIME_LIMIT  # s, of one solve
    gains: GainSettings = field(default_factory=GainSettings)
    sensitivities: bool = False  # whether the file holds them
    label: str = ""  # of the build's fingerprint: its records are sealed with it
    build: str = ""  # which run of it: in one, a record never changes once kept
    rounds: int = 0  # of the second pass (database.factory.second_pass) whose records count

    @property
    def together(self) -> bool:
        """Whether cases are solved together: `solve_family` finds what `solve` finds, and faster."""
        return self.solver is solve

    @property
    def judged(self) -> bool:
        """Whether a case is solved only if its flight says so; a stand-in claims no flight."""
        return self.solver is solve

    def solve(self, mission: Mission, guess: Trajectory) -> Trajectory:
        """By the campaign's optimiser."""
        if self.solver is solve:
            return solve(mission, guess=guess, settings=self.settings)
        return self.solver(mission, guess=guess)

    @property
    def mission(self) -> Mission:
        """The mission, parsed once per process."""
        return _mission_and_grid(self.toml)[0]

    def family_of(self, member: Mission) -> MissionFamily[Mission]:
        """The family of one member: its numbers are those of the grid, as in company."""
        return self.mission.family(member.nominal_parameters[None])

    @property
    def grid(self) -> Grid:
        """Its grid."""
        return _mission_and_grid(self.toml)[1]

    @property
    def round_folder(self) -> Path:
        """Where the last round keeps what it finds: records, and the blocks that hold them."""
        return again_folder(self.folder, self.rounds)

    def keeping(
        self, records: Sequence[CaseRecord], folder: Path | None = None
    ) -> Callable[[], None]:
        """Write records to one file; what it returns puts that in place (`record_files.keeping`)."""
        return keeping_records(folder or self.folder, records, self.label)


@lru_cache(maxsize=4)
def _mission_and_grid(toml: str) -> tuple[Mission, Grid]:
    mission = parse_mission(toml)
    return mission, Grid.from_mission(mission)
