"""Independent witness: the same transcription as one nonlinear program, by CasADi and IPOPT.

All states and rates are variables and the collocation equations are constraints: no condensing, no
restoration, no elastic target, no convexification; absolute values are split into slacks. Limits and
objective terms are written down here once more. What remains common is the physics and the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission, load_mission
from ampi.missions.family import MissionFamily
from ampi.missions.sections import NoFlyZoneSection
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import path_constraints
from ampi.physics.planet import great_circle_distance
from ampi.physics.state import ENTRY_STATES, LOADS
from ampi.physics.vehicle import air_loads
from ampi.pseudospectral.mesh import Mesh, Phase
from ampi.scp.guess import ConstantBank, NodalGuess, constant_bank_guess, from_trajectory
from ampi.scp.problem.objective import Objective
from ampi.scp.problem.problem_numbers import ProblemNumbers
from ampi.scp.solve import optimum, solve_family
from ampi.trajectory import Status, Trajectory
from tests.support.missions import SCALE

Array = NDArray[np.float64]
SECONDS = 100.0
IPOPT = {  # limits to the last digit: relaxed by 1e-8, an active one is worth 6e-5 of the cost
    "print_level": 0,
    "sb": "yes",
    "max_iter": 500,
    "bound_relax_factor": 0.0,
}
NEAR = {"mu_init": 1e-8, "bound_push": 1e-10, "bound_frac": 1e-10, "slack_bound_push": 1e-10}
GUESS = ConstantBank(np.radians(-30.0))


@dataclass(frozen=True)
class Optimum:
    """What IPOPT found (SI)."""

    status: str
    cost: float
    states: Array  # (7, n)
    bank_rate: Array  # (n − 1,)
    final_time: float
    slack: float


def physics(mission: Mission) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Scaled rates f(x, u, t), limits g(x, t) ≤ 1, and (Q̇, ground speed, ḣ) in SI."""
    limits, model = mission.limits, mission.flight_model
    radius = model.planet.equatorial_radius
    x, u, t = ca.SX.sym("x", 7), ca.SX.sym("u"), ca.SX.sym("t")
    si = x * SCALE
    mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)
    f = ca.vertcat(*equations_of_motion(model, si, u * limits.bank_rate, t))
    q, heat, load = path_constraints(model, si, t)
    drag = air_loads(model.vehicle, model.atmosphere, si[0], si[3], t).drag
    ca.GlobalOptions.setNumpyMode(mode)
    g = [q / limits.dynamic_pressure, heat / limits.heat_flux, load / limits.load_factor]
    if limits.drag_floor is not None:
        floor = limits.drag_floor * model.planet.load_factor_gravity
        g.append(ca.if_else(si[3] <= limits.drag_floor_speed, 2.0 - drag / floor, 0.0))
    for zone in mission.no_fly_zone:
        over = np.sin(zone.latitude) * ca.sin(x[2])
        along = np.cos(zone.latitude) * ca.cos(x[2]) * ca.cos(x[1] - zone.longitude)
        g.append(2.0 - (1.0 - over - along) / (1.0 - np.cos(zone.radius / radius)))
    terms = ca.vertcat(heat, si[3] * ca.cos(si[4]) * radius / (radius + si[0]), f[0])
    return (
        ca.Function("f", [x, u, t], [f / SCALE]),
        ca.Function("g", [x, t], [ca.vertcat(*g)]),
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
    x, u = ca.MX.sym("x", 7, n), ca.MX.sym("u", 1, n - 1)
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
    entry_rate = u[0, : first.degree] @ ca.DM(entry_row(first.nodes[1:]))
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
        objective.bank_rate_effort * degrees**2 * ca.dot(q, u**2)
        + objective.flight_time * final_time
        + objective.heat_load * 1e-6 * ca.dot(q, running[0, :])
        + objective.ground_range * 1e-3 * ca.dot(q, running[1, :])
    )
    low, high = np.full((n, 7), -np.inf), np.full((n, 7), np.inf)
    low[0, :6] = high[0, :6] = mission.entry_state / SCALE[:6]
    low[:, 6], high[:, 6] = -limits.bank_angle, limits.bank_angle
    least_rate, most_rate = -1.0, 1.0
    if mission.entry.bank_angle is not None:
        low[0, 6] = high[0, 6] = mission.entry.bank_angle
    if mission.entry.bank_rate is not None:
        least_rate = most_rate = mission.entry.bank_rate / limits.bank_rate
    target = mission.target
    for i, name in enumerate(ENTRY_STATES):
        wish, weight = getattr(target, name), getattr(objective, f"{name}_weight", None)
        if wish is None or (target.position == "free" and i in (1, 2)):
            continue
        if weight is None:
            ends = np.array(wish) * np.ones(2) / SCALE[i]
            low[-1, i], high[-1, i] = ends
        else:
            cost += weight * (x[i, n - 1] * SCALE[i] - wish) ** 2
    worth = Objective.of(
        ProblemNumbers.of(mission)
    ).cost_scale  # brings the cost to the order of ten
    most = 0.0 if excess_price is None else np.inf
    # |c| = a with a ≥ ±c, for the terms that are there
    insides = [
        (objective.bank_rate_variation * degrees, u),
        (objective.descent_rate * 100.0, (running[2, :] - wanted) / 100.0),
    ]
    insides = [one for one in insides if one[0] > 0.0]
    a, beyond = ca.MX.sym("a", len(insides), n - 1), []
    for k, (weight, inside) in enumerate(insides):
        cost += weight * ca.dot(q, a[k, :])
        beyond += [(a[k, :] - inside).T, (a[k, :] + inside).T]
    constraints = ca.vertcat(*collocation, entry_rate, between, path, *beyond)
    solver = ca.nlpsol(
        "witness",
        "ipopt",
        {
            "x": ca.vertcat(ca.vec(x), u.T, period, slack, ca.vec(a)),
            "f": cost / worth + (excess_price or 0.0) * slack,
            "g": constraints,
        },
        {"print_time": False, "ipopt": IPOPT | (NEAR if near else {})},
    )
    equations, paths, banks = np.zeros(7 * (n - 1)), path.numel(), np.ones(len(rows))
    start_u = guess.bank_rate[1:] / limits.bank_rate
    start_d = np.array(terms(guess.states.T / SCALE[:, None], np.zeros((1, n))))[2, 1:] - wanted
    starts = [start_u] * (objective.bank_rate_variation > 0.0)
    starts += [start_d / 100.0] * (objective.descent_rate > 0.0)
    start_a = np.abs(np.array(starts).reshape(len(insides), n - 1)).T.ravel()
    n_a = len(start_a)
    found = solver(
        x0=np.concatenate(
            [
                (guess.states / SCALE).ravel(),
                start_u,
                [guess.final_time / SECONDS, 0.0],
                start_a,
            ]
        ),
        lbx=np.concatenate([low.ravel(), -np.ones(n - 1), np.zeros(2 + n_a)]),
        ubx=np.concatenate([high.ravel(), np.ones(n - 1), [np.inf, most], np.full(n_a, np.inf)]),
        lbg=np.concatenate(
            [equations, [least_rate], -banks, np.full(paths, -np.inf), np.zeros(2 * n_a)]
        ),
        ubg=np.concatenate(
            [equations, [most_rate], banks, np.ones(paths), np.full(2 * n_a, np.inf)]
        ),
    )
    values = np.array(found["x"]).ravel()
    return Optimum(
        status=solver.stats()["return_status"],
        cost=(float(found["f"]) - (excess_price or 0.0) * float(values[8 * n])) * worth,
        states=(values[: 7 * n].reshape(n, 7) * SCALE).T,
        bank_rate=values[7 * n : 8 * n - 1] * limits.bank_rate,
        final_time=float(values[8 * n - 1]) * SECONDS,
        slack=float(values[8 * n]),
    )


def flown(mission: Mission, bank_deg: float) -> NodalGuess:
    """A constant-bank flight at the nodes."""
    guess = constant_bank_guess(mission, ConstantBank(np.radians(bank_deg)))
    assert guess is not None
    return guess


def limited(mission: Mission, kind: int, share: float, nominal: Trajectory) -> Mission:
    """The mission with one path limit at a share of the nominal optimum's peak."""
    values = path_constraints(mission.flight_model, nominal.states, nominal.times)
    limit = {LOADS[kind]: share * float(values[kind].max())}
    return mission.model_copy(update={"limits": mission.limits.model_copy(update=limit)})


def assert_the_same(ours: Trajectory, witness: Optimum) -> None:
    """Objective to 1e-6, states to the flatness of the optimum."""
    assert witness.status == "Solve_Succeeded"
    assert ours.cost == pytest.approx(witness.cost, rel=1e-6)
    assert ours.final_time == pytest.approx(witness.final_time, abs=1e-2)
    error = np.abs(ours.states - witness.states).max(axis=1)
    assert error[0] < 5.0  # m
    assert error[[1, 2]].max() * 6.4e6 < 20.0  # m
    assert error[3] < 0.2  # m/s
    assert error[4:].max() < 2e-4  # rad
    assert np.abs(ours.bank_rate[1:] - witness.bank_rate).max() < 1e-5  # rad/s


@pytest.mark.parametrize("bank_deg", [-30.0, -20.0])
def test_the_nominal_optimum(mission: Mission, nominal: Trajectory, bank_deg: float) -> None:
    assert_the_same(nominal, nlp(mission, flown(mission, bank_deg)))


def test_a_corner_of_the_hexeract(mission: Mission, nominal: Trajectory) -> None:
    corner = mission.with_entry([axis[-1] for axis in mission.grid_axes])
    ours = optimum(corner, guess=nominal)
    assert_the_same(ours, nlp(corner, flown(corner, -30.0)))


def test_an_optimum_on_the_dynamic_pressure_limit(mission: Mission, nominal: Trajectory) -> None:
    soft = limited(mission, 0, 0.9, nominal)
    ours = optimum(soft, guess=GUESS)
    assert ours.status is Status.SOLVED
    assert ours.cost > 1.1 * nominal.cost
    assert_the_same(ours, nlp(soft, flown(soft, -30.0), bank=ours.states[6]))


def test_an_optimum_on_the_heat_flux_limit(mission: Mission, nominal: Trajectory) -> None:
    # The peak comes after a minute, before the bank angle has much to say: 0.05 % cost tenfold.
    cool = limited(mission, 1, 0.9995, nominal)
    ours = optimum(cool, guess=GUESS)
    assert ours.status is Status.SOLVED
    assert ours.cost > 5.0 * nominal.cost
    # from −30° IPOPT may end, by the last digits of the nodes, at a local optimum that costs 30 % more
    assert_the_same(ours, nlp(cool, flown(cool, -20.0), bank=ours.states[6]))


def beside(neighbour: Mission, mission: Mission, guess: Trajectory) -> Trajectory:
    """By Newton's iteration alone, from the optimum of a neighbour."""
    start = optimum(neighbour, guess=guess)
    assert start.status is Status.SOLVED
    (found,) = solve_family(MissionFamily.of([mission]), [start])
    assert found is not None
    assert found.status is Status.SOLVED
    return found


def test_newtons_iteration_on_the_bank_limit(mission: Mission) -> None:
    """Held between two nodes, where the polynomial touches it."""
    free = optimum(mission)
    highest = float(np.abs(free.states[6]).max())
    limits = mission.limits.model_copy(update={"bank_angle": highest - np.radians(2.0)})
    tight = mission.model_copy(update={"limits": limits})
    ours = beside(mission, tight, free)
    assert ours.cost > 1.01 * free.cost
    witness = nlp(tight, from_trajectory(ours, tight), near=True)
    assert witness.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    assert ours.cost == pytest.approx(witness.cost, rel=1e-6)


def test_newtons_iteration_with_a_given_entry_and_a_range(mission: Mission) -> None:
    """Bank angle and rate at the entry, and a final path angle at the bound of its range."""
    free = optimum(mission)
    final = float(free.states[4, -1])
    entry = mission.entry.model_copy(
        update={
            "bank_angle": float(free.states[6, 0]) + np.radians(2.0),
            "bank_rate": float(free.bank_rate[0]) - np.radians(0.05),
        }
    )
    target = mission.target.model_copy(
        update={"flight_path_angle": (final - np.radians(2.0), final - np.radians(0.4))}
    )
    asked = mission.model_copy(update={"entry": entry, "target": target})
    start = replace(free, target_multipliers=np.append(free.target_multipliers, 0.0))
    (ours,) = solve_family(MissionFamily.of([asked]), [start])
    assert ours is not None
    assert ours.cost > 1.005 * free.cost
    witness = nlp(asked, from_trajectory(ours, asked), near=True)
    assert witness.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    assert ours.cost == pytest.approx(witness.cost, rel=1e-6)
    assert witness.states[4, -1] == pytest.approx(final - np.radians(0.4), abs=1e-7)


def test_the_smallest_excess_of_a_hopeless_limit(mission: Mission, nominal: Trajectory) -> None:
    cold = limited(mission, 1, 0.95, nominal)
    ours = optimum(cold, guess=GUESS)
    assert ours.status is Status.LIMITS_EXCEEDED
    witness = nlp(cold, flown(cold, -30.0), excess_price=1e7)
    assert witness.status == "Solve_Succeeded"
    assert witness.slack > 0.01
    assert ours.statistics.limit_excess[1] == pytest.approx(witness.slack, abs=1e-4)


def coarse(name: str, degrees: tuple[int, ...]) -> Mission:
    """A shipped mission on a small mesh, without the least bank angle."""
    mission = load_mission(name).with_mesh(Mesh((Phase(degrees),)))
    limits = mission.limits.model_copy(update={"bank_angle_minimum": 0.0})
    return mission.model_copy(update={"limits": limits}).with_mesh(mission.pseudospectral_mesh)


def objective(mission: Mission, **terms: float) -> Mission:
    """The mission with other terms in its objective."""
    changed = mission.objective.model_copy(update=terms)
    return mission.model_copy(update={"objective": changed}).with_mesh(mission.pseudospectral_mesh)


def assert_optimal(mission: Mission, ours: Trajectory) -> None:
    """IPOPT, started in the valley of our optimum, ends at its cost."""
    assert ours.status is Status.SOLVED
    beside = from_trajectory(ours, mission)
    witness = nlp(mission, beside, near=True)
    assert witness.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    assert ours.cost == pytest.approx(witness.cost, rel=1e-4)
    assert ours.final_time == pytest.approx(witness.final_time, rel=1e-3)


FIVE = (5,) * 8
MISSIONS = {
    "least bank-rate variation": ("cavh_zhou2021", (5,) * 10, {}),
    "even descent": ("cavh_wang2020", (5,) * 10, {}),
    "final angles met exactly": ("rlv_liu2024", (5,) * 10, {}),
    "minimum time": ("x33_liu2015", FIVE, {}),
    "maximum time": ("x33_liu2015", FIVE, {"flight_time": -1.0}),
    "drag floor and a long way": ("cavh_liu2015", (8,) * 8, {}),
    "minimum heat load": ("x33_liu2015", FIVE, {"flight_time": 0.0, "heat_load": 1.0}),
}


@pytest.mark.parametrize("case", MISSIONS)
def test_an_optimum_of_the_other_missions(case: str) -> None:
    name, degrees, terms = MISSIONS[case]
    mission = objective(coarse(name, degrees), **terms)
    if name == "cavh_liu2015":  # its zones ask for a finer mesh; they have their own test
        free = mission.model_copy(update={"no_fly_zone": ()})
        mission = free.with_mesh(mission.pseudospectral_mesh)
    assert_optimal(mission, optimum(mission))


def test_an_optimum_beside_a_no_fly_zone(mission: Mission, nominal: Trajectory) -> None:
    # A zone over the optimum's ground track at half of the flight, its centre off to one side.
    middle = nominal.states[1:3, nominal.states.shape[1] // 2]
    off = np.array([0.0, np.radians(1.0)])
    zone = NoFlyZoneSection.model_construct(
        longitude=middle[0] + off[0], latitude=middle[1] + off[1], radius=150e3
    )
    closed = mission.model_copy(update={"no_fly_zone": (zone,)})
    ours = optimum(closed, guess=GUESS)
    assert ours.status is Status.SOLVED
    radius = mission.flight_model.planet.equatorial_radius
    away = great_circle_distance(*ours.states[1:3], zone.longitude, zone.latitude, radius)
    assert away.min() == pytest.approx(zone.radius, rel=1e-6)
    assert ours.cost > nominal.cost
    beside = from_trajectory(ours, closed)
    assert_the_same(ours, nlp(closed, beside, near=True))
