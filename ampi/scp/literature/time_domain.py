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

from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import CIRCULAR_STATES, LOADS
from ampi.physics.vehicle import air_loads
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.coast import Coast
from ampi.scp.literature.formulation import (
    FinalState,
    Linearisation,
    Term,
    TermKind,
    TracedFunctions,
    no_fly_zone_names,
    no_fly_zone_values,
)
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]

SCALE = (1e4, 1.0, 1.0, 1e3, 1.0, 1.0, 1.0)  # m, rad, m/s
SECONDS = 100.0  # per unit of δt_f
DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True, eq=False)
class TimeDomain:
    """`Formulation` over time, from the end of `coast` where there is one."""

    mission: Mission
    coast: Coast | None
    terms: tuple[Term, ...]
    functions: TracedFunctions
    limit_names: tuple[str, ...]
    n_states: int = 7
    n_controls: int = 1
    state_scale: Array = field(default_factory=lambda: np.array(SCALE))
    final_scale: float = SECONDS
    final_is_free: bool = True
    control_cone: bool = False

    @classmethod
    def from_mission(cls, mission: Mission, coast: Coast | None = None) -> TimeDomain:
        """Trace a mission's problem."""
        names = [*LOADS, *no_fly_zone_names(mission)]
        if mission.limits.drag_floor is not None:
            names.append("drag_floor")
        return cls(mission, coast, _terms(mission), _traced(mission), tuple(names))

    @property
    def entry(self) -> Array:
        """Entry state or handover; the bank angle there is free."""
        start = self.mission.entry_state if self.coast is None else self.coast.handover
        return np.append(start, np.nan) / self.state_scale

    @property
    def target(self) -> tuple[FinalState, ...]:
        """The final states that the mission holds."""
        target = self.mission.target
        held: list[tuple[int, float, float]] = [(0, target.altitude, target.altitude)]
        if target.position == "fixed":
            held.append((1, target.longitude, target.longitude))
            held.append((2, target.latitude, target.latitude))
        held.append((3, target.speed, target.speed))
        for state, angles in ((4, target.flight_path_angle), (5, target.azimuth)):
            if angles is not None:
                held.append((state, *angles))
        scale = self.state_scale
        return tuple(
            FinalState(k, low / scale[k], high / scale[k], k in CIRCULAR_STATES)
            for k, low, high in held
        )

    @property
    def final_cost(self) -> float:
        """Weight of the flight time, per s."""
        return self.mission.objective.flight_time

    @property
    def state_bounds(self) -> tuple[Array, Array]:
        """The bank limit."""
        upper = np.append(np.full(6, np.inf), self.mission.limits.bank_angle)
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


@lru_cache(maxsize=8)
def _trace(key: str, holder: _Holder) -> TracedFunctions:
    mission = holder.mission
    model, limits, objective = mission.flight_model, mission.limits, mission.objective
    scale, names = SCALE, [term.name for term in _terms(mission)]
    over = (limits.dynamic_pressure, limits.heat_flux, limits.load_factor)

    def build(x: Any, u: Any, t: Any) -> tuple[list[Any], list[Any], list[Any]]:
        physical = [x[k] * scale[k] for k in range(7)]
        rate = u[0] * limits.bank_rate
        rates = equations_of_motion(model, physical, rate, t)
        path = path_constraints(model, physical, t)
        bounded = [value / most for value, most in zip(path, over, strict=True)]
        bounded += no_fly_zone_values(mission, physical[1], physical[2])
        air = air_loads(model.vehicle, model.atmosphere, physical[0], physical[3], t)
        if limits.drag_floor is not None and limits.drag_floor_speed is not None:
            floor = limits.drag_floor * model.planet.load_factor_gravity
            below = 0.5 * (1.0 - np.tanh((physical[3] - limits.drag_floor_speed) / 20.0))
            bounded.append(1.0 + below * (1.0 - air.drag / floor))
        radius = model.planet.equatorial_radius
        integrand = {
            "bank_rate_effort": (rate / DEGREE) ** 2,
            "bank_rate_variation": rate / DEGREE,
            "heat_load": path[1] / 1e6,
            "ground_range": physical[3]
            * np.cos(physical[4])
            * radius
            / (radius + physical[0])
            / 1e3,
            "descent_rate": rates[0] - (objective.desired_altitude_rate or 0.0),
        }
        return (
            [r / scale[k] for k, r in enumerate(rates)],
            bounded,
            [integrand[name] for name in names],
        )

    return TracedFunctions(7, 1, build)


@dataclass(frozen=True)
class _Holder:
    """Carries the mission past the cache, whose key is its text and entry state."""

    mission: Mission = field(compare=False)


def _traced(mission: Mission) -> TracedFunctions:
    derived = mission.model_dump_json(exclude={"toml", "entry", "mesh", "grid", "guess"})
    return _trace(derived, _Holder(mission))
