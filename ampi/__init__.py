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
    from ampi.guidance import Guidance
    from ampi.loading import load_guidance
    from ampi.missions.mission import Mission, load_mission
    from ampi.onboard.health import Health
    from ampi.onboard.reference import Mode, Reference
    from ampi.scp.capabilities import MethodError
    from ampi.scp.exact_hessian import SolverSettings
    from ampi.scp.guess import ConstantBank
    from ampi.scp.refinement import RefinementSettings
    from ampi.scp.solve import solve, solve_family
    from ampi.simulation.dispersions import Dispersions
    from ampi.simulation.monte_carlo import Flights, fly
    from ampi.simulation.statistics import judge
    from ampi.trajectory import Status, Trajectory

_HOME = {
    "ConstantBank": "ampi.scp.guess",
    "Dispersions": "ampi.simulation.dispersions",
    "Flights": "ampi.simulation.monte_carlo",
    "Guidance": "ampi.guidance",
    "Health": "ampi.onboard.health",
    "MethodError": "ampi.scp.capabilities",
    "Mission": "ampi.missions.mission",
    "Mode": "ampi.onboard.reference",
    "Reference": "ampi.onboard.reference",
    "RefinementSettings": "ampi.scp.refinement",
    "SolverSettings": "ampi.scp.exact_hessian",
    "Status": "ampi.trajectory",
    "Trajectory": "ampi.trajectory",
    "fly": "ampi.simulation.monte_carlo",
    "judge": "ampi.simulation.statistics",
    "load_guidance": "ampi.loading",
    "load_mission": "ampi.missions.mission",
    "solve": "ampi.scp.solve",
    "solve_family": "ampi.scp.solve",
}

__all__ = [
    "ConstantBank",
    "Dispersions",
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
    "fly",
    "judge",
    "load_guidance",
    "load_mission",
    "solve",
    "solve_family",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'ampi' has no attribute {name!r}")
