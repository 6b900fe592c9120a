"""ampi: entry guidance from a database of optimal trajectories.

    mission  = ampi.load_mission("shefex3")
    optimum  = ampi.solve(mission)
    report   = database.build(mission, "shefex3.h5")
    guidance = ampi.load_guidance("shefex3.h5")
    flights  = ampi.fly(mission, guidance, n=1000)

Names are imported when they are first used: `import ampi` costs nothing, and what flies never pulls in
the optimiser.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ampi.correction.corrector import CorrectionOutcome
    from ampi.correction.settings import CorrectorSettings
    from ampi.estimation.settings import EstimatorSettings
    from ampi.guidance import Guidance
    from ampi.loading import load_guidance
    from ampi.missions.loading import load_mission
    from ampi.missions.mission import Mission
    from ampi.onboard.command import Command
    from ampi.onboard.health import Health, Steering
    from ampi.onboard.reference import Mode, Reference
    from ampi.onboard_model import correction_of
    from ampi.physics.equations_of_motion import aerodynamic_acceleration, equations_of_motion
    from ampi.replanning.front_door import replan
    from ampi.replanning.outcome import Replan, ReplanOutcome
    from ampi.scp.condensed.settings import SolverSettings
    from ampi.scp.condensed.subproblem_cvxpy import solve_subproblem_cvxpy
    from ampi.scp.guess import ConstantBank
    from ampi.scp.literature.sparse_subproblem_cvxpy import solve_sparse_subproblem_cvxpy
    from ampi.scp.problem.capabilities import MethodError
    from ampi.scp.refinement import RefinementSettings
    from ampi.scp.solve import solve, solve_family
    from ampi.simulation.estimates.stopping import StopRule
    from ampi.simulation.flights import Flights
    from ampi.simulation.flights_csv import write_flights_csv
    from ampi.simulation.flights_file import load_campaigns, save_campaigns
    from ampi.simulation.monte_carlo import Scheme, fly, fly_again, fly_schemes
    from ampi.simulation.plant import FlightStatus
    from ampi.simulation.statistics import compare, judge
    from ampi.simulation.world import World
    from ampi.simulation.world_loading import load_world
    from ampi.trajectory import Status, Trajectory

    __version__: str

_HOME = {
    "Command": "ampi.onboard.command",
    "ConstantBank": "ampi.scp.guess",
    "CorrectionOutcome": "ampi.correction.corrector",
    "CorrectorSettings": "ampi.correction.settings",
    "EstimatorSettings": "ampi.estimation.settings",
    "FlightStatus": "ampi.simulation.plant",
    "Flights": "ampi.simulation.flights",
    "Guidance": "ampi.guidance",
    "Health": "ampi.onboard.health",
    "MethodError": "ampi.scp.problem.capabilities",
    "Mission": "ampi.missions.mission",
    "Mode": "ampi.onboard.reference",
    "Reference": "ampi.onboard.reference",
    "RefinementSettings": "ampi.scp.refinement",
    "Replan": "ampi.replanning.outcome",
    "ReplanOutcome": "ampi.replanning.outcome",
    "SolverSettings": "ampi.scp.condensed.settings",
    "Status": "ampi.trajectory",
    "Steering": "ampi.onboard.health",
    "Trajectory": "ampi.trajectory",
    "correction_of": "ampi.onboard_model",
    "aerodynamic_acceleration": "ampi.physics.equations_of_motion",
    "equations_of_motion": "ampi.physics.equations_of_motion",
    "solve_sparse_subproblem_cvxpy": "ampi.scp.literature.sparse_subproblem_cvxpy",
    "solve_subproblem_cvxpy": "ampi.scp.condensed.subproblem_cvxpy",
    "compare": "ampi.simulation.statistics",
    "fly": "ampi.simulation.monte_carlo",
    "fly_again": "ampi.simulation.monte_carlo",
    "fly_schemes": "ampi.simulation.monte_carlo",
    "load_world": "ampi.simulation.world_loading",
    "Scheme": "ampi.simulation.monte_carlo",
    "StopRule": "ampi.simulation.estimates.stopping",
    "World": "ampi.simulation.world",
    "load_campaigns": "ampi.simulation.flights_file",
    "save_campaigns": "ampi.simulation.flights_file",
    "write_flights_csv": "ampi.simulation.flights_csv",
    "judge": "ampi.simulation.statistics",
    "load_guidance": "ampi.loading",
    "load_mission": "ampi.missions.loading",
    "replan": "ampi.replanning.front_door",
    "solve": "ampi.scp.solve",
    "solve_family": "ampi.scp.solve",
}

__all__ = [
    "Command",
    "ConstantBank",
    "CorrectionOutcome",
    "CorrectorSettings",
    "EstimatorSettings",
    "FlightStatus",
    "Flights",
    "Guidance",
    "Health",
    "MethodError",
    "Mission",
    "Mode",
    "Reference",
    "RefinementSettings",
    "Replan",
    "ReplanOutcome",
    "Scheme",
    "SolverSettings",
    "Status",
    "Steering",
    "StopRule",
    "Trajectory",
    "World",
    "__version__",
    "aerodynamic_acceleration",
    "compare",
    "correction_of",
    "equations_of_motion",
    "fly",
    "fly_again",
    "fly_schemes",
    "judge",
    "load_campaigns",
    "load_guidance",
    "load_mission",
    "load_world",
    "replan",
    "save_campaigns",
    "solve",
    "solve_family",
    "solve_sparse_subproblem_cvxpy",
    "solve_subproblem_cvxpy",
    "write_flights_csv",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("ampi.release").RELEASE
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'ampi' has no attribute {name!r}")
