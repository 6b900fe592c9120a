"""The entry problem over time, with the bank rate as control: Zhou 2021, Eqs. (12)–(17).

States (h, θ, φ, V, γ, ψ, σ), control û = σ̇ / σ̇_max, free final time. Where the angle of attack is
steered too (ours), it is an eighth state and α̇ / α̇_max a second control. The equations of motion, the
path constraints and their derivatives are those of `ampi.physics`, differentiated exactly: the papers
freeze the small terms of the planet's rotation at the last iterate, which only slows convergence.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ampi.missions.final_states import FinalState, final_states
from ampi.missions.mission import Mission
from ampi.missions.path_limits import PathLimits
from ampi.physics.equations_of_motion import FlightModel, equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    BANK,
    FLIGHT_PATH_ANGLE,
    LOADS,
    SPEED,
)
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.coast import Coast
from ampi.scp.literature.formulation import (
    Linearisation,
    Term,
    TermKind,
    TracedFunctions,
)
from ampi.scp.problem.problem_numbers import ProblemNumbers
from ampi.scp.problem.scaled_problem import Scaling
from ampi.scp.problem.steered_angles import SteeredAngle, steered_angles
from ampi.tracing.node_functions import TerminalCost
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]

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
    final_scale: float = SECONDS
    final_is_free: bool = True
    control_cone: bool = False

    @classmethod
    def from_mission(cls, mission: Mission, coast: Coast | None = None) -> TimeDomain:
        """Trace a mission's problem."""
        names = PathLimits.of(mission).on_the_path
        return cls(mission, coast, _terms(mission), _traced(mission), names)

    @property
    def n_states(self) -> int:
        """Seven, or eight."""
        return self.mission.n_states

    @property
    def n_controls(self) -> int:
        """One, or two."""
        return self.n_states - BANK

    @cached_property
    def state_scale(self) -> Array:
        """Of the states that there are."""
        return np.array(_scale(self.n_states))

    @cached_property
    def angles(self) -> tuple[SteeredAngle, ...]:
        """What is steered: bounds, greatest rates and what is given at the entry."""
        return steered_angles(ProblemNumbers.of(self.mission))

    @property
    def entry(self) -> Array:
        """Entry state with the angles given there, or handover; there the bank angle alone is free."""
        start, angles = self.mission.entry_state, [angle.entry for angle in self.angles]
        if self.coast is not None:
            start, angles = self.coast.handover, [None, *self.coast.states[ANGLE_OF_ATTACK:, -1]]
        return np.append(start, _nan_where_free(angles)) / self.state_scale

    @property
    def entry_controls(self) -> Array:
        """The rates given at the entry."""
        return _nan_where_free([angle.scaled_entry_rate for angle in self.angles])

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
        """Those of the angles; that go by speed or Mach number are limits on the path."""
        free = np.full(BANK, np.inf)
        lower = np.append(-free, [angle.lower for angle in self.angles])
        return lower, np.append(free, [angle.upper for angle in self.angles])

    @property
    def control_bounds(self) -> tuple[Array, Array]:
        """The limits of the rates, scaled to one."""
        return -np.ones(self.n_controls), np.ones(self.n_controls)

    def linearise(self, mesh: Mesh, x: Array, u: Array, final: float) -> Linearisation:
        """See `Formulation`."""
        return self.functions.linearise(x, u, mesh.times(final))

    def curvature(self, mesh: Mesh, x: Array, u: Array, final: float, mu: Array, w: Array) -> Array:
        """See `Formulation`."""
        return self.functions.curvature(x, u, mesh.times(final), mu, w)

    def terminal(self, x: Array) -> tuple[float, Array]:
        """See `Formulation`: cross-range and final speed."""
        return self.functions.terminal(x)

    def rates(self, x: Array, u: Array, s: Array) -> Array:
        """See `Formulation`."""
        return self.functions.rates(x, u, s)

    def limits(self, x: Array, u: Array, s: Array) -> Array:
        """See `Formulation`."""
        return self.functions.limits(x, u, s)

    def trajectory(self, mesh: Mesh, x: Array, u: Array, final: float) -> Trajectory:
        """See `Formulation`."""
        bank_rate, *others = (u * np.array([angle.rate_limit for angle in self.angles])).T
        flight = Trajectory(
            mesh=mesh,
            states=(x * self.state_scale).T.copy(),
            bank_rate=bank_rate,
            final_time=final,
            cost=np.nan,
            status=Status.ITERATION_LIMIT,
            angle_of_attack_rate=others[0] if others else None,
        )
        return flight if self.coast is None else self.coast.before(flight)


def _scale(states: int) -> tuple[float, ...]:
    """Units of so many states: m, rad, m/s."""
    return Scaling().of_states(states).states


def _nan_where_free(given: list[Any]) -> Array:
    return np.array([np.nan if one is None else one for one in given])


def _terms(mission: Mission) -> tuple[Term, ...]:
    o = mission.objective
    terms = [
        Term("bank_rate_effort", o.bank_rate_effort, TermKind.CONVEX),
        Term("angle_of_attack_effort", o.angle_of_attack_effort, TermKind.CONVEX),
        Term("bank_rate_variation", o.bank_rate_variation, TermKind.ABSOLUTE),
        Term("heat_load", o.heat_load, TermKind.LINEAR),
        Term("ground_range", o.ground_range, TermKind.LINEAR),
        Term("descent_rate", o.descent_rate, TermKind.ABSOLUTE),
    ]
    return tuple(term for term in terms if term.weight != 0.0)


def _traced(mission: Mission) -> TracedFunctions:
    terms = tuple(term.name for term in _terms(mission))
    wanted = mission.objective.desired_altitude_rate or 0.0
    limits, o, entry = PathLimits.of(mission), mission.objective, mission.entry
    start, final = (entry.longitude, entry.latitude, entry.azimuth), None
    if o.has_terminal:
        final = TerminalCost(o.final_speed, o.cross_range * 1e-3, *start)
    return _trace(mission.flight_model, limits, terms, altitude_rate=wanted, final=final)


@lru_cache(maxsize=8)
def _trace(
    model: FlightModel,
    limits: PathLimits,
    terms: tuple[str, ...],
    *,
    altitude_rate: float,
    final: TerminalCost | None,
) -> TracedFunctions:
    scale, angle = _scale(model.n_states), limits.angle_of_attack

    def build(x: Any, u: Any, t: Any) -> tuple[list[Any], list[Any], list[Any]]:
        physical = [x[k] * one for k, one in enumerate(scale)]
        speed, radius = physical[SPEED], model.planet.equatorial_radius
        rate = u[0] * limits.bank_rate
        angle_rate = 0.0 if angle is None else u[1] * angle.rate
        rates = equations_of_motion(model, physical, rate, t, angle_of_attack_rate=angle_rate)
        heat_flux = path_constraints(model, physical, t)[LOADS.index("heat_flux")]
        over_ground = speed * np.cos(physical[FLIGHT_PATH_ANGLE]) * radius / (radius + physical[0])
        integrand = {
            "bank_rate_effort": (rate / DEGREE) ** 2,
            "angle_of_attack_effort": (angle_rate / DEGREE) ** 2,
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
            [r / scale[k] for k, r in enumerate(rates)],
            [*use.values()],
            [integrand[name] for name in terms],
        )

    def final_cost(x: Any) -> Any:
        physical = [x[k] * one for k, one in enumerate(scale)]
        return ca.SX(0.0) if final is None else final.value(model, physical)

    return TracedFunctions(model.n_states, model.n_states - BANK, build, final_cost)
