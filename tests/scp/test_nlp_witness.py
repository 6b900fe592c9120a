"""Independent witness: the same transcription as one nonlinear program, by CasADi and IPOPT.

All states and rates are variables and the collocation equations are constraints: no condensing, no
restoration, no elastic target, no convexification. What remains common is the physics and the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.path_constraints import PATH_CONSTRAINTS, path_constraints
from ampi.scp.guess import ConstantBank, NodalGuess, constant_bank_guess
from ampi.scp.solve import solve
from ampi.trajectory import Status, Trajectory

Array = NDArray[np.float64]
SCALE = np.array([1e4, 1.0, 1.0, 1e3, 1.0, 1.0, 1.0])
SECONDS = 100.0
IPOPT = {  # limits to the last digit: relaxed by 1e-8, an active one is worth 6e-5 of the cost
    "print_level": 0,
    "sb": "yes",
    "max_iter": 500,
    "bound_relax_factor": 0.0,
}
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


def physics(mission: Mission) -> tuple[ca.Function, ca.Function]:
    """Scaled rates f(x, u, t) and path constraints g(x, t) over their limits."""
    limits, model = mission.limits, mission.flight_model
    x, u, t = ca.SX.sym("x", 7), ca.SX.sym("u"), ca.SX.sym("t")
    mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)
    f = ca.vertcat(*equations_of_motion(model, x * SCALE, u * limits.bank_rate, t)) / SCALE
    g = ca.vertcat(*path_constraints(model, x * SCALE, t))
    ca.GlobalOptions.setNumpyMode(mode)
    over = ca.DM([limits.dynamic_pressure, limits.heat_flux, limits.load_factor])
    return ca.Function("f", [x, u, t], [f]), ca.Function("g", [x, t], [g / over])


def entry_row(tau: Array) -> Array:
    """Lagrange's product form at τ = −1 through the collocation points `tau`."""
    return np.array([np.prod([(-1.0 - b) / (a - b) for b in tau if b != a]) for a in tau])


def nlp(mission: Mission, guess: NodalGuess, excess_price: float | None = None) -> Optimum:
    """Solve the transcription; with `excess_price`, one slack frees the path limits at a price."""
    mesh, limits, objective = mission.pseudospectral_mesh, mission.limits, mission.objective
    n = mesh.n_nodes
    f, g = physics(mission)
    x, u = ca.MX.sym("x", 7, n), ca.MX.sym("u", 1, n - 1)
    period, slack = ca.MX.sym("t_f"), ca.MX.sym("s")
    final_time = SECONDS * period
    fixed, free = mesh.node_time
    times = ca.DM(fixed).T + ca.DM(free).T * final_time
    rates = f.map(n - 1)(x[:, 1:], u, times[1:])

    collocation, effort = [], 0.0
    for s in mesh.segments:
        half = s.half_length[0] + s.half_length[1] * final_time
        points = slice(s.collocation.start, s.collocation.stop)
        nodal = x[:, s.nodes.start : s.nodes.stop]
        residual = nodal @ ca.DM(s.rule.derivative).T - half * rates[:, points]
        collocation.append(ca.vec(residual))
        effort += half * ca.sum2(ca.DM(s.rule.weights).T * u[0, points] ** 2)
    first = mesh.segments[0].rule
    entry_rate = u[0, : first.degree] @ ca.DM(entry_row(first.nodes[1:]))
    path = ca.vec(g.map(n)(x, times)) - slack

    target = mission.target
    reference = ca.DM([target.altitude, target.longitude, target.latitude, target.speed])
    weights = ca.DM(
        [
            objective.altitude_weight,
            objective.longitude_weight,
            objective.latitude_weight,
            objective.speed_weight,
        ]
    )
    error = x[:4, n - 1] * SCALE[:4] - reference
    epsilon = objective.bank_rate_effort
    cost = ca.dot(weights, error**2) / epsilon + np.degrees(limits.bank_rate) ** 2 * effort
    cost += (excess_price or 0.0) * slack

    low, high = np.full((n, 7), -np.inf), np.full((n, 7), np.inf)
    low[0, :6] = high[0, :6] = mission.entry_state / SCALE[:6]
    low[:, 6], high[:, 6] = -limits.bank_angle, limits.bank_angle
    most = 0.0 if excess_price is None else np.inf
    solver = ca.nlpsol(
        "witness",
        "ipopt",
        {
            "x": ca.vertcat(ca.vec(x), u.T, period, slack),
            "f": cost,
            "g": ca.vertcat(*collocation, entry_rate, path),
        },
        {"print_time": False, "ipopt": IPOPT},
    )
    equations = np.zeros(7 * (n - 1))
    found = solver(
        x0=np.concatenate(
            [
                (guess.states / SCALE).ravel(),
                guess.bank_rate[1:] / limits.bank_rate,
                [guess.final_time / SECONDS, 0.0],
            ]
        ),
        lbx=np.concatenate([low.ravel(), np.full(n - 1, -1.0), [0.0, 0.0]]),
        ubx=np.concatenate([high.ravel(), np.full(n - 1, 1.0), [np.inf, most]]),
        lbg=np.concatenate([equations, [-1.0], np.full(3 * n, -np.inf)]),
        ubg=np.concatenate([equations, [1.0], np.ones(3 * n)]),
    )
    values = np.array(found["x"]).ravel()
    return Optimum(
        status=solver.stats()["return_status"],
        cost=float(found["f"]) * epsilon,
        states=(values[: 7 * n].reshape(n, 7) * SCALE).T,
        bank_rate=values[7 * n : 8 * n - 1] * limits.bank_rate,
        final_time=float(values[-2]) * SECONDS,
        slack=float(values[-1]),
    )


def flown(mission: Mission, bank_deg: float) -> NodalGuess:
    """A constant-bank flight at the nodes."""
    guess = constant_bank_guess(mission, ConstantBank(np.radians(bank_deg)))
    assert guess is not None
    return guess


def limited(mission: Mission, kind: int, share: float, nominal: Trajectory) -> Mission:
    """The mission with one path limit at a share of the nominal optimum's peak."""
    values = path_constraints(mission.flight_model, nominal.states, nominal.times)
    limit = {PATH_CONSTRAINTS[kind]: share * float(values[kind].max())}
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
    ours = solve(corner, guess=nominal)
    assert_the_same(ours, nlp(corner, flown(corner, -30.0)))


def test_an_optimum_on_the_dynamic_pressure_limit(mission: Mission, nominal: Trajectory) -> None:
    soft = limited(mission, 0, 0.9, nominal)
    ours = solve(soft, guess=GUESS)
    assert ours.status is Status.SOLVED
    assert ours.cost > 1.1 * nominal.cost
    assert_the_same(ours, nlp(soft, flown(soft, -30.0)))


def test_an_optimum_on_the_heat_flux_limit(mission: Mission, nominal: Trajectory) -> None:
    # The peak comes after a minute, before the bank angle has much to say: 0.05 % cost tenfold.
    cool = limited(mission, 1, 0.9995, nominal)
    ours = solve(cool, guess=GUESS)
    assert ours.status is Status.SOLVED
    assert ours.cost > 5.0 * nominal.cost
    assert_the_same(ours, nlp(cool, flown(cool, -30.0)))


def test_the_smallest_excess_of_a_hopeless_limit(mission: Mission, nominal: Trajectory) -> None:
    cold = limited(mission, 1, 0.95, nominal)
    ours = solve(cold, guess=GUESS)
    assert ours.status is Status.LIMITS_EXCEEDED
    witness = nlp(cold, flown(cold, -30.0), excess_price=1e7)
    assert witness.status == "Solve_Succeeded"
    assert witness.slack > 0.01
    assert ours.statistics.limit_excess[1] == pytest.approx(witness.slack, abs=1e-4)
