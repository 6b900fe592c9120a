"""What a build refuses before any work, each in one sentence."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from uuid import uuid4

import numpy as np

from ampi.dataset import (
    partial_folder,
    stored_mission,
)
from ampi.missions.mission import Mission
from ampi.scp.condensed.settings import SolverSettings
from ampi.scp.problem.capabilities import check
from ampi.scp.problem.scaled_problem import OptimalControlProblem
from ampi.scp.sensitivities import refusal
from ampi.scp.solve import solve
from ampi.tracker_design.riccati_gains import GainSettings
from database.estimate import MOST_EVER
from database.records.campaign import BuildError, Campaign, Solver, solver_name


def checked(
    mission: Mission,
    path: Path,
    solver: Solver,
    settings: SolverSettings | None,
    time_limit: float,
    gains: GainSettings | None,
    sensitivities: bool,
) -> Campaign:
    """The campaign that a call of `database.build` asks for.

    Raises
    ------
    BuildError, MissionError
        If there can be none.
    """
    if not isinstance(mission, Mission):
        raise BuildError(
            f"mission: expected a Mission, got {mission!r:.60}; load one with ampi.load_mission(name)"
        )
    mission.checked()
    if not 0.0 < time_limit < np.inf:
        raise BuildError(f"time_limit: expected a positive number of seconds, got {time_limit}")
    size = math.prod(len(p.offsets) for p in mission.parameters)
    if size > MOST_EVER:
        raise BuildError(
            f"{mission.name}: expected a grid of at most {MOST_EVER:,} cases, got {size:,}; give its "
            "axes fewer points"
        )
    _refuse_unknown(mission, solver, settings)
    if sensitivities:
        _refuse_sensitivities(mission, solver)
    _refuse_other_database(path, mission)
    campaign = Campaign(
        mission.toml,
        partial_folder(path),
        solver,
        settings or SolverSettings(),
        time_limit,
        gains or GainSettings(),
        sensitivities,
        build=str(uuid4()),
    )
    try:
        pickle.dumps(campaign)
    except (pickle.PicklingError, AttributeError, TypeError):
        raise BuildError(
            f"solver: expected a function that workers can import, got {solver!r}; "
            "define it at the top of a module"
        ) from None
    return campaign


def _refuse_unknown(mission: Mission, solver: Solver, settings: SolverSettings | None) -> None:
    """What a case asks for the optimiser must know, and all must have the same rows of the target."""
    if settings is not None and solver is not solve:
        raise BuildError(
            f"settings: expected None with another optimiser than ampi.solve ({solver_name(solver)}), "
            "got some; leave them out"
        )
    if not isinstance(settings, SolverSettings | None):
        raise BuildError(f"settings: expected SolverSettings or None, got {settings!r}")
    rows = OptimalControlProblem.of(mission).target.state
    points = [mission.nominal_parameters]
    for i, axis in enumerate(mission.grid_axes):
        for value in axis:
            points.append(mission.nominal_parameters)
            points[-1][i] = value
    for point in points:
        there = mission.with_parameters(point)
        if solver is solve:
            check(there, "exact_hessian")
        if not np.array_equal(OptimalControlProblem.of(there).target.state, rows):
            i = int(np.flatnonzero(point != points[0])[0])
            raise BuildError(
                f"grid.{mission.parameters[i].key}: expected a target of the same rows at every point, "
                "got one row more or less where its weight is 0; leave out that point"
            )


def _refuse_sensitivities(mission: Mission, solver: Solver) -> None:
    """They are those of optima of `ampi.solve`, whose conditions are known."""
    if solver is not solve:
        raise BuildError(
            f"sensitivities: expected False with another optimiser than ampi.solve "
            f"({solver_name(solver)}), got True; leave them out"
        )
    sentence = refusal(mission)
    if sentence is not None:
        raise BuildError(f"{mission.name}: {sentence}")


def _refuse_other_database(path: Path, mission: Mission) -> None:
    """An existing file is replaced only by a new database of the same mission."""
    if path.is_dir():
        raise BuildError(f"{path}: expected a file to write, got a folder")
    if path.exists() and stored_mission(path) != mission.toml:
        raise BuildError(
            f"{path} exists and is not a database of this mission ({mission.name}); "
            "nothing was overwritten: choose another path, or delete the file"
        )
