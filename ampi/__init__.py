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
    from ampi.guidance import BankCommand, Guidance
    from ampi.loading import load_guidance
    from ampi.missions.loading import load_mission
    from ampi.missions.mission import Mission
    from ampi.onboard.health import Health
    from ampi.onboard.reference import Mode, Reference
    from ampi.scp.condensed.settings import SolverSettings
    from ampi.scp.guess import ConstantBank
    from ampi.scp.problem.capabilities import MethodError
    from ampi.scp.refinement import RefinementSettings
    from ampi.scp.solve import solve, solve_family
    from ampi.simulation.closed_loop import FlightStatus
    from ampi.simulation.dispersions import Dispersions, Distribution
    from ampi.simulation.flights import Flights
    from ampi.simulation.flights_csv import write_flights_csv
    from ampi.simulation.flights_file import load_campaigns, save_campaigns
    from ampi.simulation.monte_carlo import fly, fly_modes
    from ampi.simulation.statistics import judge
    from ampi.trajectory import Status, Trajectory

    __version__: str

_HOME = {
    "BankCommand": "ampi.guidance",
    "ConstantBank": "ampi.scp.guess",
    "Dispersions": "ampi.simulation.dispersions",
    "Distribution": "ampi.simulation.dispersions",
    "FlightStatus": "ampi.simulation.closed_loop",
    "Flights": "ampi.simulation.flights",
    "Guidance": "ampi.guidance",
    "Health": "ampi.onboard.health",
    "MethodError": "ampi.scp.problem.capabilities",
    "Mission": "ampi.missions.mission",
    "Mode": "ampi.onboard.reference",
    "Reference": "ampi.onboard.reference",
    "RefinementSettings": "ampi.scp.refinement",
    "SolverSettings": "ampi.scp.condensed.settings",
    "Status": "ampi.trajectory",
    "Trajectory": "ampi.trajectory",
    "fly": "ampi.simulation.monte_carlo",
    "fly_modes": "ampi.simulation.monte_carlo",
    "load_campaigns": "ampi.simulation.flights_file",
    "save_campaigns": "ampi.simulation.flights_file",
    "write_flights_csv": "ampi.simulation.flights_csv",
    "judge": "ampi.simulation.statistics",
    "load_guidance": "ampi.loading",
    "load_mission": "ampi.missions.loading",
    "solve": "ampi.scp.solve",
    "solve_family": "ampi.scp.solve",
}

__all__ = [
    "BankCommand",
    "ConstantBank",
    "Dispersions",
    "Distribution",
    "FlightStatus",
    "Flights",
    "Guidance",
    "Health",
    "MethodError",
    "Mission",
    "Mode",
    "Reference",
    "RefinementSettings",
    "SolverSettings",
    "Status",
    "Trajectory",
    "__version__",
    "fly",
    "fly_modes",
    "judge",
    "load_campaigns",
    "load_guidance",
    "load_mission",
    "save_campaigns",
    "solve",
    "solve_family",
    "write_flights_csv",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version("ampi")
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'ampi' has no attribute {name!r}")
