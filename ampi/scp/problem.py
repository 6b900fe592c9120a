"""The optimal control problem in scaled variables.

    minimise   φ(x(t_f)) + ε ∫ u² dt
    subject to ẋ = f(x, u, t),  x(0) = x₀ but for the free bank angle σ₀,
               |σ| ≤ σ_max,  |u| ≤ u_max,  g(x, t) ≤ 1                          (1)

with φ of Sagliano et al. 2016, Eq. (1), and g the path constraints of Eq. (4) over their limits.
`Scaling` is the one place where SI becomes dimensionless; time stays in seconds. The cost is divided
by ε, so that the effort of a bank profile, in (deg/s)² s, is of the order of ten for any ε.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import FlightModel
from ampi.pseudospectral.mesh import Mesh

Array = NDArray[np.float64]

N_STATES = 7
N_TARGETS = 4  # h, θ, φ, V: the leading states
BANK = 6  # row of the bank angle
DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True)
class Scaling:
    """x = states · x̂; the bank rate is measured in its limit."""

    states: tuple[float, ...] = (1e4, 1.0, 1.0, 1e3, 1.0, 1.0, 1.0)  # m, rad, m/s
    final_time: float = 100.0  # s per unit of δt_f in the subproblem


@dataclass(frozen=True, eq=False)
class OptimalControlProblem:
    """Eq. (1) for one entry state. Arrays are in scaled units."""

    model: FlightModel
    mesh: Mesh
    scaling: Scaling
    entry: Array  # (6,)
    target: Array  # (4,)
    target_weights: Array  # (4,), of the squared terminal errors, over ε
    target_tolerance: Array  # (2,): altitude, speed
    effort_weight: float  # of ∫ û² dt, over ε
    cost_scale: float  # J = cost_scale · scaled cost
    limits: tuple[float, float, float]  # Pa, W/m², g
    bank_limit: float  # rad
    bank_rate_limit: float  # rad/s

    @classmethod
    def from_mission(
        cls, mission: Mission, scaling: Scaling | None = None
    ) -> OptimalControlProblem:
        """Scale a mission's problem."""
        scaling = scaling or Scaling()
        scale = np.array(scaling.states)
        objective, target, limits = mission.objective, mission.target, mission.limits
        weights = np.array(
            [
                objective.altitude_weight,
                objective.longitude_weight,
                objective.latitude_weight,
                objective.speed_weight,
            ]
        )
        reference = np.array([target.altitude, target.longitude, target.latitude, target.speed])
        epsilon = objective.bank_rate_effort
        return cls(
            model=mission.flight_model,
            mesh=mission.pseudospectral_mesh,
            scaling=scaling,
            entry=mission.entry_state / scale[:6],
            target=reference / scale[:N_TARGETS],
            target_weights=weights * scale[:N_TARGETS] ** 2 / epsilon,
            target_tolerance=np.array(
                [target.altitude_tolerance / scale[0], target.speed_tolerance / scale[3]]
            ),
            effort_weight=(limits.bank_rate / DEGREE) ** 2,
            cost_scale=epsilon,
            limits=(limits.dynamic_pressure, limits.heat_flux, limits.load_factor),
            bank_limit=limits.bank_angle,
            bank_rate_limit=limits.bank_rate,
        )

    def target_error(self, final_state: Array) -> Array:
        """e = x_f − x_target (4,) of a scaled final state (7,)."""
        return np.asarray(final_state[:N_TARGETS] - self.target)

    def reference_effort(self, final_time: float) -> float:
        """Effort of one linear sweep from −σ_max to σ_max over the flight."""
        rate = 2.0 * self.bank_limit / (self.bank_rate_limit * final_time)
        return self.effort_weight * rate**2 * final_time
