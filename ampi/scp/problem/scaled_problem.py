"""The optimal control problem in scaled variables.

    minimise   Σ_i w_i e_i² + J(u, x, t_f)
    subject to ẋ = f(x, u, t),  x(0) = x₀ but for the free bank angle σ₀,
               e = x(t_f) − x_target,  e_lo ≤ e ≤ e_hi,
               |σ| ≤ σ_max,  |u| ≤ u_max,  g(x, t) ≤ 1                          (1)

with J of `objective` and g of `node_functions`. A final state is free (no row), weighted (Sagliano et
al. 2016, Eq. (1): w > 0, no bounds), met exactly (e_lo = e_hi = 0) or kept in a range. `Scaling` is the
one place where SI becomes dimensionless; time stays in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.missions.sections import TARGET_WEIGHTS
from ampi.physics.angles import on_turn_of
from ampi.physics.equations_of_motion import FlightModel
from ampi.physics.state import CIRCULAR_STATES, ENTRY_STATES
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.problem.objective import Objective
from ampi.tracing.node_functions import NodeFunctions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scaling:
    """x = states · x̂, angles as they are; the bank rate is measured in its limit."""

    states: tuple[float, ...] = (1e4, 1.0, 1.0, 1e3, 1.0, 1.0, 1.0)  # m, rad, m/s
    final_time: float = 100.0  # s per unit of δt_f in the subproblem


@dataclass(frozen=True, eq=False)
class Target:
    """The rows of e in Eq. (1), scaled: m of them."""

    state: NDArray[np.intp]  # (m,), which final state
    reference: Array  # (m,)
    weight: Array  # (m,), zero where the row is bounded
    lower: Array  # (m,), −∞ where the row is weighted
    upper: Array  # (m,)

    def __len__(self) -> int:
        return len(self.state)

    def error(self, final_state: Array) -> Array:
        """e (m,) of a scaled final state (7,): of an angle, the short way round."""
        error = np.asarray(final_state[self.state] - self.reference)
        circular = np.isin(self.state, CIRCULAR_STATES)
        error[circular] = on_turn_of(error[circular], 0.0)
        return error

    def quadratic(self, error: Array) -> float:
        """Σ w e²."""
        return float(self.weight @ error**2)

    @classmethod
    def from_mission(cls, mission: Mission, scale: Array, cost_scale: float) -> Target:
        """Altitude and speed, the position unless it is free, the final angles if given."""
        target, objective = mission.target, mission.objective
        weights = [getattr(objective, name) for name in TARGET_WEIGHTS]
        rows: list[tuple[int, float, float, float, float]] = []
        for i, (name, weight) in enumerate(zip(ENTRY_STATES[:4], weights, strict=True)):
            if weight == 0.0 or (target.position == "free" and i in (1, 2)):
                continue
            bound = 0.0 if weight is None else np.inf
            rows.append((i, getattr(target, name), weight or 0.0, -bound, bound))
        for i, span in ((4, target.flight_path_angle), (5, target.azimuth)):
            if span is not None:
                middle, half = 0.5 * (span[0] + span[1]), 0.5 * (span[1] - span[0])
                rows.append((i, middle, 0.0, -half, half))
        state = np.array([row[0] for row in rows], dtype=np.intp)
        reference, weight, lower, upper = np.array([row[1:] for row in rows]).T
        unit = scale[state]
        return cls(
            state=state,
            reference=reference / unit,
            weight=weight * unit**2 / cost_scale,
            lower=lower / unit,
            upper=upper / unit,
        )


@dataclass(frozen=True, eq=False)
class OptimalControlProblem:
    """Eq. (1) for one entry state. Arrays are in scaled units."""

    model: FlightModel
    mesh: Mesh
    scaling: Scaling
    entry: Array  # (6,)
    target: Target
    objective: Objective
    functions: NodeFunctions
    target_tolerance: Array  # (2,): altitude, speed
    bank_limit: float  # rad, less its margin
    bank_rate_limit: float  # rad/s, less its margin

    @classmethod
    def from_mission(
        cls, mission: Mission, scaling: Scaling | None = None
    ) -> OptimalControlProblem:
        """Scale a mission's problem."""
        scaling = scaling or Scaling()
        scale = np.array(scaling.states)
        target, limits = mission.target, mission.limits
        objective = Objective.from_mission(mission)
        return cls(
            model=mission.flight_model,
            mesh=mission.pseudospectral_mesh,
            scaling=scaling,
            entry=mission.entry_state / scale[:6],
            target=Target.from_mission(mission, scale, objective.cost_scale),
            objective=objective,
            functions=NodeFunctions.from_mission(mission, objective.cost_scale),
            target_tolerance=np.array(
                [target.altitude_tolerance / scale[0], target.speed_tolerance / scale[3]]
            ),
            bank_limit=limits.designed("bank_angle"),
            bank_rate_limit=limits.designed("bank_rate"),
        )

    @property
    def n_limits(self) -> int:
        """How many path limits there are."""
        return len(self.functions.names)

    @property
    def multiplier_scale(self) -> Array:
        """Scaled multipliers of the target over those in SI (m,)."""
        units = np.array(self.scaling.states)[self.target.state]
        return np.asarray(units / self.objective.cost_scale)

    def reference_cost(self, final_time: float) -> float:
        """Effort of one linear sweep from −σ_max to σ_max over the flight, at its reference weight."""
        rate = 2.0 * self.bank_limit / (self.bank_rate_limit * final_time)
        return self.objective.reference_effort * rate**2 * final_time
