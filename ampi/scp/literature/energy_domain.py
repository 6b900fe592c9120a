"""The entry problem over energy, with cos σ and sin σ as controls: Liu, Shen, Lu 2015.

    e = R₀/r − V²/(2 g₀ R₀),      V = √(2 g₀ R₀ (R₀/r − e))                     (1)   Liu Eqs. (4), (6)

grows along the flight, so it can be the independent variable s = e − e₀, and V is no state. With
u = (cos σ, sin σ) the equations of motion are affine in the control,

    x' = [f₀(x) + B(x) u] / ė,     x = (h, θ, φ, γ, ψ),                          (2)   Liu Eq. (18)

and the circle u₁² + u₂² = 1 is relaxed to the cone u₁² + u₂² ≤ 1 (Liu Eq. 49). ∂(B u)/∂x is left
out of the linearisation, which is thereby independent of the last control (Liu Eq. 22): that is what
keeps the bank angle free of jitter. The paper sets V = √(2(1 − e)) (Eq. 7) and leaves the planet's
rotation out of ė; Eq. (1) and the exact ė cost nothing here and are exact.

The relaxation is tight where the heading has a price. Liu Eq. (38) adds ε_ψ ∫ ψ de, and every linear
subproblem is tight indeed; but the curvature of cos ψ, which a converged iteration knows, makes flying
straight on with ‖u‖ < 1 the better optimum wherever there is lift to spare: 160 loose nodes of 201 on
the CAV-H. This is where we leave the paper: ε_ψ is here a row of impulses of alternating sign, by parts

    − w ∫ c (∂ψ'/∂u₂) u₂ ds,      c = ±1, changing when the lift could have turned the heading by Θ:  (3)

a weave of Θ about the straight flight, on the circle, for 0.3 % of the flight time.

Path limits are bounds on the altitude at every energy, l(e) ≤ h (Liu Eqs. 12–14), solved from the
limits themselves; the drag floor (Eq. 73) is a ceiling (Eq. 60); no-fly zones are linearised (Eq. 72).
f₀ and B come from the one source of the equations of motion, by
f₀ = ½[f(0) + f(π)], B = (½[f(0) − f(π)], ½[f(π/2) − f(−π/2)]) over the bank angle.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ampi.missions.final_states import FinalState, final_states
from ampi.missions.mission import Mission
from ampi.missions.path_limits import LimitKind, PathLimits
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import (
    ALTITUDE,
    AZIMUTH,
    BANK,
    FLIGHT_PATH_ANGLE,
    LATITUDE,
    LONGITUDE,
    N_STATES,
    SPEED,
)
from ampi.physics.vehicle import air_loads
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.chattering import reversals
from ampi.scp.literature.coast import JUMP, Coast
from ampi.scp.literature.collocation import line_mesh
from ampi.scp.literature.formulation import (
    Linearisation,
    Term,
    TermKind,
    TracedFunctions,
)
from ampi.scp.problem.scaled_problem import Scaling
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]

FASTEST = 1.0  # s per unit of energy, far below any dt/ds of a flight
HIGHEST = 200e3  # m, where the altitude bounds are looked for
STATE_OF = (ALTITUDE, LONGITUDE, LATITUDE, FLIGHT_PATH_ANGLE, AZIMUTH)  # among those over time
SCALE = tuple(Scaling().states[state] for state in STATE_OF)  # m, rad


@dataclass(frozen=True, eq=False)
class EnergyDomain:
    """`Formulation` over energy."""

    mission: Mission
    coast: Coast
    side_weight: float  # w of Eq. (3), in units of the mission's cost per rad
    half_wave: float  # Θ of Eq. (3), rad
    n_states: int = 5
    n_controls: int = 2
    state_scale: Array = field(default_factory=lambda: np.array(SCALE))
    final_scale: float = 1.0
    final_cost: float = 0.0
    final_is_free: bool = False
    control_cone: bool = True

    @property
    def energy_unit(self) -> float:
        """g₀ R₀ (J/kg)."""
        planet = self.mission.flight_model.planet
        return planet.gravitational_parameter / planet.equatorial_radius

    def energy(self, altitude: Any, speed: Any) -> Any:
        """e of Eq. (1)."""
        radius = self.mission.flight_model.planet.equatorial_radius
        return radius / (radius + altitude) - 0.5 * speed * speed / self.energy_unit

    def speed(self, altitude: Any, energy: Any) -> Any:
        """V of Eq. (1), m/s."""
        radius = self.mission.flight_model.planet.equatorial_radius
        return np.sqrt(2.0 * self.energy_unit * (radius / (radius + altitude) - energy))

    @cached_property
    def first_energy(self) -> float:
        """e₀ at the handover."""
        return float(self.energy(self.coast.handover[ALTITUDE], self.coast.handover[SPEED]))

    @cached_property
    def energy_range(self) -> float:
        """e_f − e₀."""
        target = self.mission.target
        return float(self.energy(target.altitude, target.speed)) - self.first_energy

    @property
    def entry(self) -> Array:
        """State at the handover, scaled."""
        return np.asarray(self.coast.handover[list(STATE_OF)] / self.state_scale)

    @property
    def entry_controls(self) -> Array:
        """All free."""
        return np.full(self.n_controls, np.nan)

    @property
    def target(self) -> tuple[FinalState, ...]:
        """Final states, Liu Eq. (8) and its ranges; the final energy holds the speed."""
        held = (one for one in final_states(self.mission) if one.state != SPEED)
        rows = ((STATE_OF.index(one.state), one) for one in held)
        return tuple(replace(one.over(SCALE[row]), state=row) for row, one in rows)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Liu Section II.C, linearised (Eqs. 28, 34).

        Their second derivatives (Eqs. 29–35) were tried: they are ten times the curvature of the
        Lagrangian, and the iteration then creeps to the minimum time by a factor 0.9 a step.
        """
        o = self.mission.objective
        weights = {
            "flight_time": o.flight_time,
            "heat_load": o.heat_load,
            "ground_range": o.ground_range,
            "side": self.side_weight,  # last: `_signs`
        }
        terms = [Term(name, weight, TermKind.LINEAR) for name, weight in weights.items()]
        return tuple(term for term in terms if term.weight != 0.0)

    @property
    def state_bounds(self) -> tuple[Array, Array]:
        """None but the limits."""
        return np.full(5, -np.inf), np.full(5, np.inf)

    @property
    def control_bounds(self) -> tuple[Array, Array]:
        """ω_l ≤ u₁ ≤ ω_h, Liu Eq. (24)."""
        limits = self.mission.limits
        least, most = np.cos(limits.bank_angle), np.cos(limits.bank_angle_minimum)
        return np.array([least, -np.inf]), np.array([most, np.inf])

    @property
    def limit_names(self) -> tuple[str, ...]:
        """Kinds of limits, in order."""
        kinds = PathLimits.of(self.mission).kinds.items()
        zones = (name for name, kind in kinds if kind is LimitKind.NO_FLY_ZONE)
        others = (name for name, kind in kinds if kind in (LimitKind.LOAD, LimitKind.DRAG_FLOOR))
        return (*zones, *others)

    @cached_property
    def functions(self) -> TracedFunctions:
        """Eq. (2) and the integrands, traced."""
        model, names = self.mission.flight_model, [term.name for term in self.terms]
        radius = model.planet.equatorial_radius

        def build(x: Any, u: Any, s: Any) -> tuple[list[Any], list[Any], list[Any]]:
            altitude, longitude, latitude = x[0] * SCALE[0], x[1], x[2]
            speed = self.speed(altitude, s + self.first_energy)

            def rates_at(bank: float) -> list[Any]:
                state = [altitude, longitude, latitude, speed, x[3], x[4], bank]
                return list(equations_of_motion(model, state, 0.0, 0.0))

            up, down = rates_at(0.0), rates_at(np.pi)
            right, left = rates_at(0.5 * np.pi), rates_at(-0.5 * np.pi)
            free = [0.5 * (a + b) for a, b in zip(up, down, strict=True)]
            energy_rate = (
                -self.energy_unit * radius / (radius + altitude) ** 2 * free[0] - speed * free[3]
            ) / self.energy_unit
            rates = []
            for row, k in enumerate(STATE_OF):
                lift = 0.5 * (up[k] - down[k]) * u[0] + 0.5 * (right[k] - left[k]) * u[1]
                rates.append((free[k] + lift) / energy_rate / SCALE[row])
            path = path_constraints(model, [altitude, 0.0, 0.0, speed], 0.0)
            along = speed * np.cos(x[3]) * radius / (radius + altitude)
            integrand = {
                "flight_time": 1.0 / energy_rate,
                "heat_load": path[1] / 1e6 / energy_rate,
                "ground_range": along / 1e3 / energy_rate,
                "side": -0.5 * (right[5] - left[5]) / energy_rate * u[1],
            }
            zones = PathLimits.of(self.mission).zones(longitude, latitude)
            clock = 1.0 / energy_rate  # dt/ds, for the trajectory over time
            return rates, zones, [*(integrand[name] for name in names), clock]

        return TracedFunctions(5, 2, build)

    def linearise(self, mesh: Mesh, x: Array, u: Array, final: float) -> Linearisation:
        """See `Formulation`; the state Jacobian is that of f₀, Liu Eq. (22)."""
        s, m = mesh.times(final), len(self.terms)
        lin = self.functions.linearise(x, np.zeros_like(u), s)
        with_lift = lin.rates + np.einsum("nij,nj->ni", lin.control_jacobian, u)
        g, jacobian = self._altitude_limits(x, s)
        return Linearisation(
            rates=with_lift,
            state_jacobian=lin.state_jacobian,
            control_jacobian=lin.control_jacobian,
            drift=lin.drift,
            limits=np.hstack([lin.limits, g]),
            limit_jacobian=np.concatenate([lin.limit_jacobian, jacobian], axis=1),
            limit_drift=np.zeros((len(x), len(self.limit_names))),
            integrands=lin.integrands[:, :m],
            integrand_state=lin.integrand_state[:, :m],
            integrand_control=lin.integrand_control[:, :m] * self._signs(s)[:, :, None],
            integrand_curvature=lin.integrand_curvature[:, :m],
        )

    def curvature(self, mesh: Mesh, x: Array, u: Array, final: float, mu: Array, w: Array) -> Array:
        """See `Formulation`."""
        s, clock = mesh.times(final), np.zeros((len(x), 1))
        return self.functions.curvature(x, u, s, mu, np.hstack([w * self._signs(s), clock]))

    def _signs(self, s: Array) -> Array:
        """Factors of the terms (n, m): those of Eq. (3) on the last, which is traced without."""
        return np.column_stack([np.ones((len(s), len(self.terms) - 1)), self.side(s)])

    def side(self, s: Array) -> Array:
        """±1 of Eq. (3): it changes whenever the lift could have turned the heading by Θ."""
        waves = np.floor(self._turn(s) / self.half_wave + 0.5)
        return np.asarray((-1.0) ** waves)

    def _turn(self, s: Array) -> Array:
        """∫ (L/D) dV/V, what the lift could turn the heading by (rad), from s = 0.

        L/D is a function of the speed alone where the angle of attack is (Liu Section II.B); the
        altitude of the target stands for all.
        """
        model, altitude = self.mission.flight_model, self.mission.target.altitude
        fine = np.linspace(0.0, self.energy_range, 1001)
        speed = self.speed(altitude, fine + self.first_energy)
        air = air_loads(model.vehicle, model.atmosphere, altitude, speed, 0.0)
        rate = air.lift / air.drag * self.energy_unit / speed**2
        turned = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(fine) * (rate[1:] + rate[:-1]))])
        return np.asarray(np.interp(s, fine, turned))

    def ground_range(self, s: Array, altitude: Array) -> Array:
        """∫ cos γ R₀/r ds/D of Liu Section II.C (n,), m, for a level flight at `altitude` (n,)."""
        model = self.mission.flight_model
        radius = model.planet.equatorial_radius
        speed = self.speed(altitude, s + self.first_energy)
        drag = air_loads(model.vehicle, model.atmosphere, altitude, speed, 0.0).drag
        rate = self.energy_unit / drag * radius / (radius + altitude)
        steps = 0.5 * np.diff(s) * (rate[1:] + rate[:-1])
        return np.concatenate([[0.0], np.cumsum(steps)])

    def terminal(self, x: Array) -> tuple[float, Array]:
        """None is known over energy."""
        return 0.0, np.zeros(len(x))

    def rates(self, x: Array, u: Array, s: Array) -> Array:
        """See `Formulation`."""
        return self.functions.rates(x, u, s)

    def limits(self, x: Array, u: Array, s: Array) -> Array:
        """See `Formulation`."""
        g, _ = self._altitude_limits(x, s)
        return np.hstack([self.functions.limits(x, u, s), g])

    def _altitude_limits(self, x: Array, s: Array) -> tuple[Array, Array]:
        """g = 1 + (l − ĥ) for the floors, 1 + (ĥ − c) for the ceiling: (n, k) and (n, k, 5)."""
        floors = self.altitude_floors(s) / SCALE[0]
        g = [1.0 + low - x[:, 0] for low in floors]
        signs = [-1.0] * len(g)
        ceiling = self.altitude_ceiling(s)
        if ceiling is not None:
            g.append(1.0 + x[:, 0] - ceiling / SCALE[0])
            signs.append(1.0)
        jacobian = np.zeros((len(x), len(g), 5))
        jacobian[:, :, 0] = signs
        return np.column_stack(g), jacobian

    def altitude_floors(self, s: Array) -> Array:
        """l_q, l_Q, l_n of Liu Eq. (12): (3, n) m."""
        model, over = self.mission.flight_model, PathLimits.of(self.mission).loads

        def excess(kind: int, altitude: Array) -> Array:
            speed = self.speed(altitude, s + self.first_energy)
            value = path_constraints(model, [altitude, 0.0, 0.0, speed], 0.0)[kind]
            return np.asarray(value / over[kind] - 1.0)

        top = self._highest(s)
        return np.array([_last_root(lambda h, k=k: excess(k, h), top) for k in range(3)])

    def _highest(self, s: Array) -> Array:
        """Where bounds are looked for: below it there is kinetic energy left (m)."""
        radius = self.mission.flight_model.planet.equatorial_radius
        return np.minimum(HIGHEST, 0.999 * (radius / (s + self.first_energy) - radius))

    def altitude_ceiling(self, s: Array) -> Array | None:
        """Highest altitude with the drag floor (m), inf above its speed; None without a floor."""
        model, limit = self.mission.flight_model, PathLimits.of(self.mission).drag_floor
        if limit is None:
            return None
        floor, below = limit

        def surplus(altitude: Array) -> Array:
            speed = self.speed(altitude, s + self.first_energy)
            air = air_loads(model.vehicle, model.atmosphere, altitude, speed, 0.0)
            return np.asarray(air.drag - floor)

        ceiling = _last_root(surplus, self._highest(s))
        speed = self.speed(ceiling, s + self.first_energy)
        return np.where(speed <= below, ceiling, 10.0 * HIGHEST)

    def trajectory(self, mesh: Mesh, x: Array, u: Array, final: float) -> Trajectory:
        """See `Formulation`: time by the trapezoid of dt/ds, the coast before it.

        A reversal has two nodes of its own, `JUMP` apart, where `chattering` puts it.
        """
        s = mesh.times(final)
        clock = self.functions.linearise(x, np.zeros_like(u), s).integrands[:, -1]
        clock = np.maximum(clock, FASTEST)  # an iterate that diverged may have time run backwards
        elapsed = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(s) * (clock[1:] + clock[:-1]))])
        states = np.empty((N_STATES, len(x)))
        states[list(STATE_OF)] = (x * self.state_scale).T
        states[SPEED] = self.speed(states[ALTITUDE], s + self.first_energy)
        sign, turns = reversals(s, u)
        turns = np.interp(turns, s, elapsed)
        states[BANK] = np.arccos(np.clip(u[:, 0], -1.0, 1.0))
        every = np.union1d(elapsed, np.concatenate([turns - 0.5 * JUMP, turns + 0.5 * JUMP]))
        states = np.array([np.interp(every, elapsed, row) for row in states])
        states[BANK] *= sign * (-1.0) ** np.searchsorted(turns, every)
        elapsed = every
        before = self.coast.times[:-1]
        times = np.concatenate([before, self.coast.times[-1] + elapsed])
        states = np.hstack([self.coast.states[:, :-1], states])
        return Trajectory(
            mesh=line_mesh(times / times[-1]),
            states=states,
            bank_rate=np.gradient(states[BANK], times),
            final_time=float(times[-1]),
            cost=np.nan,
            status=Status.ITERATION_LIMIT,
        )


def _last_root(function: Any, high: Array) -> Array:
    """Altitude (n,) where a function that falls with altitude crosses zero, by bisection."""
    low = np.zeros_like(high)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = function(middle) > 0.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return 0.5 * (low + high)
