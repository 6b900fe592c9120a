"""The entry problem over time, with the bank rate as control: Zhou 2021, Eqs. (12)–(17).

States (h, θ, φ, V, γ, ψ, σ), control û = σ̇ / σ̇_max, free final time. The equations of motion, the
path constraints and their derivatives are those of `ampi.physics`, differentiated exactly: the papers
freeze the small terms of the planet's rotation at the last iterate, which only slows convergence.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.final_states import FinalState, final_states
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import ALTITUDE, BANK, FLIGHT_PATH_ANGLE, LOADS, N_STATES, SPEED
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.coast import Coast
from ampi.scp.literature.formulation import (
    Linearisation,
    Term,
    TermKind,
    TracedFunctions,
)
from ampi.scp.problem.scaled_problem import Scaling
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]

SCALE = Scaling().states  # m, rad, m/s
SECONDS = 100.0  # per unit of δt_f
FLOOR_BEGINS = 20.0  # m/s, over which the drag floor begins
DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True, eq=False)
class TimeDomain:
    """`Formulation` over time, from the end of `coast` where there is one."""

    mission: Mission
    coast: Coast | None
    terms: tuple[Term, ...]
    functions: TracedFunctions
    limit_names: tuple[str, ...]
    n_states: int = N_STATES
    n_controls: int = 1
    state_scale: Array = field(default_factory=lambda: np.array(SCALE))
    final_scale: float = SECONDS
    final_is_free: bool = True
    control_cone: bool = False

    @classmethod
    def from_mission(cls, mission: Mission, coast: Coast | None = None) -> TimeDomain:
        """Trace a mission's problem."""
        names = PathLimits.of(mission).on_the_path
        return cls(mission, coast, _terms(mission), _traced(mission), names)

    @property
    def entry(self) -> Array:
        """Entry state or handover; the bank angle there is free."""
        start = self.mission.entry_state if self.coast is None else self.coast.handover
        return np.append(start, np.nan) / self.state_scale

    @property
    def target(self) -> tuple[FinalState, ...]:
        """The final states that the mission holds."""
        scale = self.state_scale
        return tuple(held.over(scale[held.state]) for held in final_states(self.mission))

    @property
    def final_cost(self) -> float:
        """Weight of the flight time, per s."""
        return self.mission.objective.flight_time

    @property
    def state_bounds(self) -> tuple[Array, Array]:
        """The bank limit."""
        upper = np.append(np.full(BANK, np.inf), self.mission.limits.bank_angle)
        return -upper, upper

    @property
    def control_bounds(self) -> tuple[Array, Array]:
        """The rate limit, scaled to one."""
        return -np.ones(1), np.ones(1)

    def linearise(self, mesh: Mesh, x: Array, u: Array, final: float) -> Linearisation:
        """See `Formulation`."""
        return self.functions.linearise(x, u, mesh.times(final))

    def curvature(self, mesh: Mesh, x: Array, u: Array, final: float, mu: Array, w: Array) -> Array:
        """See `Formulation`."""
        return self.functions.curvature(x, u, mesh.times(final), mu, w)

    def rates(self, x: Array, u: Array, s: Array) -> Array:
        """See `Formulation`."""
        return self.functions.rates(x, u, s)

    def limits(self, x: Array, u: Array, s: Array) -> Array:
        """See `Formulation`."""
        return self.functions.limits(x, u, s)

    def trajectory(self, mesh: Mesh, x: Array, u: Array, final: float) -> Trajectory:
        """See `Formulation`."""
        flight = Trajectory(
            mesh=mesh,
            states=(x * self.state_scale).T.copy(),
            bank_rate=u[:, 0] * self.mission.limits.bank_rate,
            final_time=final,
            cost=np.nan,
            status=Status.ITERATION_LIMIT,
        )
        return flight if self.coast is None else self.coast.before(flight)


def _terms(mission: Mission) -> tuple[Term, ...]:
    o = mission.objective
    terms = [
        Term("bank_rate_effort", o.bank_rate_effort, TermKind.CONVEX),
        Term("bank_rate_variation", o.bank_rate_variation, TermKind.ABSOLUTE),
        Term("heat_load", o.heat_load, TermKind.LINEAR),
        Term("ground_range", o.ground_range, TermKind.LINEAR),
        Term("descent_rate", o.descent_rate, TermKind.ABSOLUTE),
    ]
    return tuple(term for term in terms if term.weight != 0.0)


def _traced(mission: Mission) -> TracedFunctions:
    terms = tuple(term.name for term in _terms(mission))
    wanted = mission.objective.desired_altitude_rate or 0.0
    limits = PathLimits.of(mission)
    return _trace(mission.flight_model, limits, terms, wanted)


@lru_cache(maxsize=8)
def _trace(
    model: FlightModel, limits: PathLimits, terms: tuple[str, ...], altitude_rate: float
) -> TracedFunctions:
    def build(x: Any, u: Any, t: Any) -> tuple[list[Any], list[Any], list[Any]]:
        physical = [x[k] * SCALE[k] for k in range(N_STATES)]
        speed, radius = physical[SPEED], model.planet.equatorial_radius
        rate = u[0] * limits.bank_rate
        rates = equations_of_motion(model, physical, rate, t)
        heat_flux = path_constraints(model, physical, t)[LOADS.index("heat_flux")]
        over_ground = speed * np.cos(physical[FLIGHT_PATH_ANGLE]) * radius / (radius + physical[0])
        integrand = {
            "bank_rate_effort": (rate / DEGREE) ** 2,
            "bank_rate_variation": rate / DEGREE,
            "heat_load": heat_flux / 1e6,
            "ground_range": over_ground / 1e3,
            "descent_rate": rates[ALTITUDE] - altitude_rate,
        }
        use = dict(zip(limits.on_the_path, limits.path(model, physical, t), strict=True))
        if limits.drag_floor is not None:  # a step in an interval stops these methods: smooth it
            below = 0.5 * (1.0 - np.tanh((speed - limits.drag_floor[1]) / FLOOR_BEGINS))
            use["drag_floor"] = 1.0 + below * (limits.floor_use(model, physical, t) - 1.0)
        return (
            [r / SCALE[k] for k, r in enumerate(rates)],
            [*use.values()],
            [integrand[name] for name in terms],
        )

    return TracedFunctions(N_STATES, 1, build)
