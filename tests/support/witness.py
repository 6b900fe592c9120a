"""Independent witnesses: programs that CasADi's IPOPT solves, and what they have in common.

`nlp` is the transcription that our optimiser solves, written down once more as one nonlinear program,
for one control or two. All states and rates are variables and the collocation equations are constraints:
no condensing, no restoration, no elastic target, no convexification; absolute values are split into
slacks. Limits and objective terms are written down here once more. What remains common is the physics
and the mesh.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import STEERED_STATES
from ampi.scp.guess import NodalGuess
from ampi.scp.problem.objective import Objective
from ampi.scp.problem.problem_numbers import ProblemNumbers
from tests.support.missions import SCALE

Array = NDArray[np.float64]
SECONDS = 100.0
IPOPT = {  # limits to the last digit: relaxed by 1e-8, an active one is worth 6e-5 of the cost
    "bound_relax_factor": 0.0,
}
RATES = ("bank_rate", "angle_of_attack_rate")  # of the states from the seventh on
NEAR = {"mu_init": 1e-8, "bound_push": 1e-10, "bound_frac": 1e-10, "slack_bound_push": 1e-10}


@contextmanager
def numpy_of_symbols() -> Iterator[None]:
    """Physics that is written in numpy's functions takes CasADi's symbols."""
    mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)
    try:
        yield
    finally:
        ca.GlobalOptions.setNumpyMode(mode)


def path_limits(mission: Mission, state: Any, time: Any) -> tuple[Any, Any]:
    """Limits g ≤ 1 of the mission at its states (SI), and the heat flux in W/m²."""
    limits, model, control = mission.limits, mission.flight_model, mission.angle_of_attack
    with numpy_of_symbols():
        q, heat, load = path_constraints(model, state, time)
        drag = model.air_loads(state, time).drag
        sound = model.atmosphere.speed_of_sound(state[0])
    g = [q / limits.dynamic_pressure, heat / limits.heat_flux, load / limits.load_factor]
    if limits.drag_floor is not None:
        floor = limits.drag_floor * model.planet.load_factor_gravity
        g.append(ca.if_else(state[3] <= limits.drag_floor_speed, 2.0 - drag / floor, 0.0))
    for zone in mission.no_fly_zone:
        over = np.sin(zone.latitude) * ca.sin(state[2])
        along = np.cos(zone.latitude) * ca.cos(state[2]) * ca.cos(state[1] - zone.longitude)
        width = 1.0 - np.cos(zone.radius / model.planet.equatorial_radius)
        g.append(2.0 - (1.0 - over - along) / width)
    if control is not None and control.at is not None:
        along = state[3] / sound if control.over == "mach" else state[3]
        held = ca.fmin(ca.fmax(along, control.at[0]), control.at[-1])
        low, high = (ca.pw_lin(held, np.array(control.at), np.array(b)) for b in control.points)
        width = 0.5 * max(upper - lower for lower, upper in zip(*control.points, strict=True))
        g += [1.0 + (low - state[7]) / width, 1.0 + (state[7] - high) / width]
    return ca.vertcat(*g), heat


def scale_of(mission: Mission) -> Array:
    """Units in which the states of a mission are near one."""
    return np.append(SCALE, np.ones(mission.n_states - len(SCALE)))


def rate_limits(mission: Mission) -> Array:
    """Of the bank angle and, where it is a control, of the angle of attack (rad/s)."""
    control = mission.angle_of_attack
    return np.array([mission.limits.bank_rate, *([] if control is None else [control.rate])])


def cross_range(mission: Mission, longitude: Any, latitude: Any) -> Any:
    """Final distance (km) out of the plane of the entry, to its left: a product of vectors."""
    entry = mission.entry
    to = np.array([np.cos(entry.longitude), np.sin(entry.longitude)])
    up = np.array([*(np.cos(entry.latitude) * to), np.sin(entry.latitude)])
    north = np.array([*(-np.sin(entry.latitude) * to), np.cos(entry.latitude)])
    east = np.cross(north, up)
    ahead = np.cos(entry.azimuth) * north + np.sin(entry.azimuth) * east
    left = np.cross(up, ahead)
    cos_lat = ca.cos(latitude)
    point = ca.vertcat(cos_lat * ca.cos(longitude), cos_lat * ca.sin(longitude), ca.sin(latitude))
    radius = mission.flight_model.planet.equatorial_radius
    return 1e-3 * radius * ca.asin(ca.dot(ca.DM(left), point))


@dataclass(frozen=True)
class Found:
    """Where IPOPT ends."""

    status: str
    objective: float
    values: Array  # of all variables
    iterations: int


def ipopt(
    program: dict[str, Any],
    options: dict[str, Any],
    *,
    start: Array,
    low: Array,
    high: Array,
    least: Array | float = 0.0,
    most: Array | float = 0.0,
    expand: bool = False,
) -> Found:
    """Solve from `start`, variables from `low` to `high`, constraints from `least` to `most`."""
    quiet = {"print_time": False, "expand": expand}
    settings = {"print_level": 0, "sb": "yes", "max_iter": 500, **options}
    solver = ca.nlpsol("witness", "ipopt", program, {**quiet, "ipopt": settings})
    found = solver(x0=start, lbx=low, ubx=high, lbg=least, ubg=most)
    stats = solver.stats()
    values = np.array(found["x"]).ravel()
    return Found(stats["return_status"], float(found["f"]), values, stats["iter_count"])


@dataclass(frozen=True)
class Optimum:
    """What IPOPT found (SI)."""

    status: str
    cost: float
    states: Array  # (7 or 8, n)
    rates: Array  # (m, n − 1)
    final_time: float
    slack: float
    iterations: int = 0

    @property
    def bank_rate(self) -> Array:
        """(n − 1,)."""
        return np.asarray(self.rates[0])


def physics(mission: Mission) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Scaled rates f(x, u, t), limits g(x, t) ≤ 1, and (Q̇, ground speed, ḣ) in SI."""
    model, radius = mission.flight_model, mission.flight_model.planet.equatorial_radius
    scale, most = scale_of(mission), rate_limits(mission)
    x, u, t = ca.SX.sym("x", len(scale)), ca.SX.sym("u", len(most)), ca.SX.sym("t")
    si, rate = ca.vertsplit(x * scale), ca.vertsplit(u * most)
    second = {"angle_of_attack_rate": rate[1]} if len(most) > 1 else {}
    with numpy_of_symbols():
        f = ca.vertcat(*equations_of_motion(model, si, rate[0], t, **second))
    g, heat = path_limits(mission, si, t)
    terms = ca.vertcat(heat, si[3] * ca.cos(si[4]) * radius / (radius + si[0]), f[0])
    return (
        ca.Function("f", [x, u, t], [f / scale]),
        ca.Function("g", [x, t], [g]),
        ca.Function("terms", [x, t], [terms]),
    )


def entry_row(tau: Array) -> Array:
    """Lagrange's product form at τ = −1 through the collocation points `tau`."""
    return np.array([np.prod([(-1.0 - b) / (a - b) for b in tau if b != a]) for a in tau])


def nlp(
    mission: Mission,
    guess: NodalGuess,
    excess_price: float | None = None,
    *,
    near: bool = False,
    bank: Array | None = None,
) -> Optimum:
    """Solve the transcription; with `excess_price`, one slack frees the path limits at a price.

    `near` starts with a small barrier, that is in the valley of the guess. `bank` (n,) tells where the
    bank angle comes near to its limit; None: in the guess.
    """
    mesh, limits, objective = mission.pseudospectral_mesh, mission.limits, mission.objective
    n = mesh.n_nodes
    f, g, terms = physics(mission)
    scale, rate_limit = scale_of(mission), rate_limits(mission)
    states, m = len(scale), len(rate_limit)
    x, u = ca.MX.sym("x", states, n), ca.MX.sym("u", m, n - 1)
    period, slack = ca.MX.sym("t_f"), ca.MX.sym("s")
    final_time = SECONDS * period
    fixed, free = mesh.node_time
    times = ca.DM(fixed).T + ca.DM(free).T * final_time
    rates = f.map(n - 1)(x[:, 1:], u, times[1:])
    running = terms.map(n - 1)(x[:, 1:], times[1:])
    wanted = objective.desired_altitude_rate or 0.0

    collocation, quadrature = [], []
    for s in mesh.segments:
        half = s.half_length[0] + s.half_length[1] * final_time
        points = slice(s.collocation.start, s.collocation.stop)
        nodal = x[:, s.nodes.start : s.nodes.stop]
        collocation.append(ca.vec(nodal @ ca.DM(s.rule.derivative).T - half * rates[:, points]))
        quadrature.append(half * ca.DM(s.rule.weights).T)
    q = ca.horzcat(*quadrature)
    first = mesh.segments[0].rule
    entry_rate = u[:, : first.degree] @ ca.DM(entry_row(first.nodes[1:]))
    path = ca.vec(g.map(n)(x, times)) - slack
    # five points between two nodes each, where the polynomial of the bank angle may overshoot: those
    # near the limit, for far from it the barrier of hundreds of bounds would bend the optimum
    at = mesh.times(1000.0)
    inner = (at[:-1, None] + np.diff(at)[:, None] * np.arange(1, 6) / 6.0).ravel()
    rows = mesh.conversion(inner, 1000.0) / limits.bank_angle
    rows = rows[np.abs(rows @ (guess.states[:, 6] if bank is None else bank)) > 0.95]
    between = ca.DM(rows) @ x[6, :].T

    degrees = np.degrees(limits.bank_rate)
    cost = (
        objective.bank_rate_effort * degrees**2 * ca.dot(q, u[0, :] ** 2)
        + objective.flight_time * final_time
        + objective.heat_load * 1e-6 * ca.dot(q, running[0, :])
        + objective.ground_range * 1e-3 * ca.dot(q, running[1, :])
    )
    if objective.angle_of_attack_effort:
        size = objective.angle_of_attack_effort * np.degrees(rate_limit[1]) ** 2
        cost += size * ca.dot(q, u[1, :] ** 2)
    if objective.cross_range:
        cost += objective.cross_range * cross_range(mission, x[1, n - 1], x[2, n - 1])
    cost += objective.final_speed * x[3, n - 1] * scale[3]
    low, high = np.full((n, states), -np.inf), np.full((n, states), np.inf)
    low[0, :6] = high[0, :6] = mission.entry_state / scale[:6]
    low[:, 6], high[:, 6] = -limits.bank_angle, limits.bank_angle
    control = mission.angle_of_attack
    if control is not None and control.at is None:
        low[:, 7], high[:, 7] = control.lower[0], control.upper[0]
    least_rate, most_rate = -np.ones(m), np.ones(m)
    for k, name in enumerate(STEERED_STATES[6:states]):
        angle, rate = (getattr(mission.entry, key) for key in (name, RATES[k]))
        if angle is not None:
            low[0, 6 + k] = high[0, 6 + k] = angle
        if rate is not None:
            least_rate[k] = most_rate[k] = rate / rate_limit[k]
    target = mission.target
    for i, name in enumerate(STEERED_STATES[:states]):
        field, weight = target.held_by(name), getattr(objective, f"{name}_weight", None)
        if field is None:
            continue
        wish = getattr(target, field)
        if weight is None or field != name:
            ends = np.array(wish) * np.ones(2) / scale[i]
            low[-1, i], high[-1, i] = max(low[-1, i], ends[0]), min(high[-1, i], ends[1])
        else:
            cost += weight * (x[i, n - 1] * scale[i] - wish) ** 2
    worth = Objective.of(
        ProblemNumbers.of(mission)
    ).cost_scale  # brings the cost to the order of ten
    most_excess = 0.0 if excess_price is None else np.inf
    # |c| = a with a ≥ ±c, for the terms that are there
    insides = [
        (objective.bank_rate_variation * degrees, u[0, :]),
        (objective.descent_rate * 100.0, (running[2, :] - wanted) / 100.0),
    ]
    insides = [one for one in insides if one[0] > 0.0]
    a, beyond = ca.MX.sym("a", len(insides), n - 1), []
    for k, (weight, inside) in enumerate(insides):
        cost += weight * ca.dot(q, a[k, :])
        beyond += [(a[k, :] - inside).T, (a[k, :] + inside).T]
    constraints = ca.vertcat(*collocation, entry_rate, between, path, *beyond)
    program = {
        "x": ca.vertcat(ca.vec(x), ca.vec(u), period, slack, ca.vec(a)),
        "f": cost / worth + (excess_price or 0.0) * slack,
        "g": constraints,
    }
    equations, paths, banks = np.zeros(states * (n - 1)), path.numel(), np.ones(len(rows))
    start_u = guess.controls[:, 1:] / rate_limit[:, None]
    start_d = np.array(terms(guess.states.T / scale[:, None], np.zeros((1, n))))[2, 1:] - wanted
    starts = [start_u[0]] * (objective.bank_rate_variation > 0.0)
    starts += [start_d / 100.0] * (objective.descent_rate > 0.0)
    start_a = np.abs(np.array(starts).reshape(len(insides), n - 1)).T.ravel()
    n_a = len(start_a)
    found = ipopt(
        program,
        IPOPT | (NEAR if near else {}),
        start=np.concatenate(
            [
                (guess.states / scale).ravel(),
                start_u.T.ravel(),
                [guess.final_time / SECONDS, 0.0],
                start_a,
            ]
        ),
        low=np.concatenate([low.ravel(), -np.ones(m * (n - 1)), np.zeros(2 + n_a)]),
        high=np.concatenate(
            [high.ravel(), np.ones(m * (n - 1)), [np.inf, most_excess], np.full(n_a, np.inf)]
        ),
        least=np.concatenate(
            [equations, least_rate, -banks, np.full(paths, -np.inf), np.zeros(2 * n_a)]
        ),
        most=np.concatenate(
            [equations, most_rate, banks, np.ones(paths), np.full(2 * n_a, np.inf)]
        ),
    )
    values, at_slack = found.values, states * n + m * (n - 1) + 1
    return Optimum(
        status=found.status,
        cost=(found.objective - (excess_price or 0.0) * float(values[at_slack])) * worth,
        states=(values[: states * n].reshape(n, states) * scale).T,
        rates=values[states * n : at_slack - 1].reshape(n - 1, m).T * rate_limit[:, None],
        final_time=float(values[at_slack - 1]) * SECONDS,
        slack=float(values[at_slack]),
        iterations=found.iterations,
    )
