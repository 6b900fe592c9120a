"""The transcription of a mission as one nonlinear program for CasADi and IPOPT, for one control or two.

States, rates and final time are variables, the collocation equations are constraints; expanded to SX,
with exact Hessians, MUMPS with pivot_order=0. It knows what the benchmarks ask for: the target weighted,
met exactly, in a range or free, efforts of both controls, cross-range and final speed, the three loads.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ampi.missions.final_states import final_states
from ampi.missions.mission import Mission
from ampi.missions.sections import TARGET_WEIGHTS
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.planet import cross_range_angle
from ampi.physics.state import BANK, LATITUDE, LONGITUDE, SPEED
from ampi.pseudospectral.lagrange import barycentric_weights, interpolation_matrix
from ampi.scp.guess import NodalGuess
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

SCALE = np.array([1e4, 1.0, 1.0, 1e3, 1.0, 1.0, 1.0, 1.0])  # of eight states, if there are as many
SECONDS = 100.0
BARRIERS: dict[str, dict[str, Any]] = {
    "monotone": {"mu_strategy": "monotone", "mu_init": 1e-5},
    "adaptive": {"mu_strategy": "adaptive"},
    "cold": {"warm_start_init_point": "no"},  # its own defaults
}
OPTIONS: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-6,
    "max_iter": 300,
    "linear_solver": "mumps",
    "mumps_pivot_order": 0,
    "warm_start_init_point": "yes",
    "warm_start_bound_push": 1e-9,
    "warm_start_mult_bound_push": 1e-9,
    "warm_start_slack_bound_push": 1e-9,
}


@dataclass(frozen=True)
class Point:
    """A primal-dual point of the program."""

    x: Array
    on_x: Array
    on_g: Array
    cost: float
    iterations: int
    seconds: float
    ok: bool


class Program:
    """One nonlinear program for every entry state of a mission."""

    def __init__(self, mission: Mission, barrier: str) -> None:
        control = mission.angle_of_attack
        self.mission, self.n = mission, mission.pseudospectral_mesh.n_nodes
        self.scale = SCALE[: mission.n_states]
        self.rates = np.array(
            [mission.limits.bank_rate, *([] if control is None else [control.rate])]
        )
        self.unit = mission.objective.bank_rate_effort
        n, controls = self.n, len(self.rates)
        x, u = ca.MX.sym("x", mission.n_states, n), ca.MX.sym("u", controls, n - 1)
        period = ca.MX.sym("t_f")
        collocation, effort, first_rate, path = self._transcribed(x, u, SECONDS * period)
        self.solver = ca.nlpsol(
            "program",
            "ipopt",
            {
                "x": ca.vertcat(ca.vec(x), ca.vec(u), period),
                "f": effort + self._terminal(x[:, n - 1] * self.scale) / self.unit,
                "g": ca.vertcat(*collocation, first_rate, path),
            },
            {"print_time": False, "expand": True, "ipopt": {**OPTIONS, **BARRIERS[barrier]}},
        )
        self.low, self.high = self._bounds()
        equations = np.zeros(mission.n_states * (n - 1))
        self.g_low = np.concatenate([equations, -np.ones(controls), np.full(3 * n, -np.inf)])
        self.g_high = np.concatenate([equations, np.ones(controls), np.ones(3 * n)])

    def _transcribed(self, x: ca.MX, u: ca.MX, final_time: ca.MX) -> tuple[Any, Any, Any, Any]:
        """Collocation equations, effort, rates at the first node, path limits."""
        mesh, objective, n = self.mission.pseudospectral_mesh, self.mission.objective, self.n
        f, g = self._physics()
        fixed, free = mesh.node_time
        times = ca.DM(fixed).T + ca.DM(free).T * final_time
        rates = f.map(n - 1)(x[:, 1:], u, times[1:])
        given = np.array([objective.bank_rate_effort, objective.angle_of_attack_effort])
        weights = ca.DM((given / self.unit)[: len(self.rates)] * np.degrees(self.rates) ** 2).T
        collocation, effort = [], 0.0
        for s in mesh.segments:
            half = s.half_length[0] + s.half_length[1] * final_time
            points = slice(s.collocation.start, s.collocation.stop)
            nodal = x[:, s.nodes.start : s.nodes.stop]
            collocation.append(ca.vec(nodal @ ca.DM(s.rule.derivative).T - half * rates[:, points]))
            effort += half * ca.sum2(ca.DM(s.rule.weights).T * (weights @ u[:, points] ** 2))
        inner = mesh.segments[0].rule.nodes[1:]
        entry_rate = interpolation_matrix(inner, barycentric_weights(inner), [-1.0])
        first_rate = u[:, : len(inner)] @ ca.DM(entry_rate).T
        return collocation, effort, first_rate, ca.vec(g.map(n)(x, times))

    def _terminal(self, final: ca.MX) -> Any:
        """Cost of the final state (SI)."""
        target, objective, entry = self.mission.target, self.mission.objective, self.mission.entry
        weights = [getattr(objective, name) or 0.0 for name in TARGET_WEIGHTS]
        wished = [target.altitude, target.longitude, target.latitude, target.speed]
        cost = ca.dot(ca.DM(weights), (final[: len(wished)] - ca.DM(wished)) ** 2)
        if objective.cross_range:
            start = entry.longitude, entry.latitude, entry.azimuth
            with_numpy = ca.GlobalOptions.getNumpyMode()
            ca.GlobalOptions.setNumpyMode(-1)
            angle = cross_range_angle(*start, final[LONGITUDE], final[LATITUDE])
            ca.GlobalOptions.setNumpyMode(with_numpy)
            radius = self.mission.flight_model.planet.equatorial_radius
            cost += objective.cross_range * 1e-3 * radius * angle
        return cost + objective.final_speed * final[SPEED]

    def _bounds(self) -> tuple[Array, Array]:
        """Of the states (n, s), but for the entry."""
        limits, control, n = self.mission.limits, self.mission.angle_of_attack, self.n
        low = np.full((n, len(self.scale)), -np.inf)
        high = -low
        low[:, BANK], high[:, BANK] = -limits.bank_angle, limits.bank_angle
        if control is not None:
            low[:, BANK + 1], high[:, BANK + 1] = control.lower[0], control.upper[0]
        if self.mission.objective.altitude_weight is None:
            for held in final_states(self.mission):
                scaled = held.over(self.scale[held.state])
                low[-1, held.state], high[-1, held.state] = scaled.lower, scaled.upper
        return low, high

    def _physics(self) -> tuple[ca.Function, ca.Function]:
        limits, model = self.mission.limits, self.mission.flight_model
        x, u, t = ca.SX.sym("x", len(self.scale)), ca.SX.sym("u", len(self.rates)), ca.SX.sym("t")
        si, rate = ca.vertsplit(x * self.scale), ca.vertsplit(u * self.rates)
        second = {"angle_of_attack_rate": rate[1]} if len(rate) > 1 else {}
        mode = ca.GlobalOptions.getNumpyMode()
        ca.GlobalOptions.setNumpyMode(-1)
        f = ca.vertcat(*equations_of_motion(model, si, rate[0], t, **second)) / self.scale
        g = ca.vertcat(*path_constraints(model, si, t))
        ca.GlobalOptions.setNumpyMode(mode)
        over = ca.DM([limits.dynamic_pressure, limits.heat_flux, limits.load_factor])
        return ca.Function("f", [x, u, t], [f]), ca.Function("g", [x, t], [g / over])

    def solve(self, entry_state: Array, start: Point) -> Point:
        """From a neighbour's primal-dual point."""
        low, high = self.low.copy(), self.high.copy()
        low[0, :6] = high[0, :6] = entry_state / self.scale[:6]
        most = np.ones(len(self.rates) * (self.n - 1))
        began = time.perf_counter()
        found = self.solver(
            x0=start.x,
            lam_x0=start.on_x,
            lam_g0=start.on_g,
            lbx=np.concatenate([low.ravel(), -most, [0.0]]),
            ubx=np.concatenate([high.ravel(), most, [np.inf]]),
            lbg=self.g_low,
            ubg=self.g_high,
        )
        seconds, stats = time.perf_counter() - began, self.solver.stats()
        return Point(
            x=np.array(found["x"]).ravel(),
            on_x=np.array(found["lam_x"]).ravel(),
            on_g=np.array(found["lam_g"]).ravel(),
            cost=float(found["f"]) * self.unit,
            iterations=int(stats["iter_count"]),
            seconds=seconds,
            ok=bool(stats["success"]),
        )

    def start(self, flight: Trajectory | NodalGuess) -> Point:
        """A primal start without multipliers: an optimum, or a guess at the nodes."""
        states = flight.states.T if isinstance(flight, Trajectory) else flight.states
        x = np.concatenate(
            [
                (states / self.scale).ravel(),
                (flight.controls[:, 1:] / self.rates[:, None]).T.ravel(),
                [flight.final_time / SECONDS],
            ]
        )
        return Point(x, np.zeros(len(x)), np.zeros(len(self.g_low)), np.nan, 0, 0.0, True)
