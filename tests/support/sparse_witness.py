"""Independent witness of the literature's methods over time: their transcriptions as one program.

The trapezoid and the flipped Radau rule, the limits and the terms of the objective are written down
here once more and handed to CasADi and IPOPT: no linearisation, no trust region, no elastic target, no
penalty. What remains common is the physics and the mesh. These problems have several optima: IPOPT
starts from the solution under test, with a small barrier, and names the optimum of its valley.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import ANGLE_OF_ATTACK, BANK, STEERED_STATES
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.subproblem_builder import MeshIterate
from tests.support.missions import SCALE
from tests.support.witness import (
    RATES,
    cross_range,
    entry_row,
    ipopt,
    numpy_of_symbols,
    path_limits,
    rate_limits,
    scale_of,
)

Array = NDArray[np.float64]
SECONDS = 100.0
IPOPT = {
    "bound_relax_factor": 0.0,
    "mu_init": 1e-6,
    **dict.fromkeys(("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac"), 1e-8),
}


@dataclass(frozen=True)
class Optimum:
    """What IPOPT found."""

    status: str
    cost: float  # in units of the mission's objective
    states: Array  # (n, 7 or 8), SI
    final_time: float  # s, of the optimised part of the flight


@dataclass(frozen=True, kw_only=True)
class Transcription:
    """What a method solves, besides the mission."""

    radau: bool
    per_second: bool = False  # the objective is divided by the flight time: Zhou 2021, Eq. (34)
    limit_margin: float = 0.0
    final_bounds: tuple[float, float] = (1.0, np.inf)  # s


def node_functions(mission: Mission) -> tuple[ca.Function, Array, int]:
    """(x, u, t) → rates, g ≤ 1, insides of the absolute terms and what is integrated as it is.

    With the weights of the absolute terms and the number of limits.
    """
    model, objective, units = mission.flight_model, mission.objective, scale_of(mission)
    most = rate_limits(mission)
    x, u, t = ca.SX.sym("x", len(units)), ca.SX.sym("u", len(most)), ca.SX.sym("t")
    si, turning = x * units, u * most
    with numpy_of_symbols():
        own = {} if len(most) == 1 else {"angle_of_attack_rate": turning[1]}
        rates = ca.vertcat(*equations_of_motion(model, si, turning[0], t, **own))
    g, _ = path_limits(mission, si, t)
    inside, weight = [u[0]], [objective.bank_rate_variation * np.degrees(most[0])]
    if objective.descent_rate:
        inside.append((rates[0] - objective.desired_altitude_rate) / 100.0)
        weight.append(objective.descent_rate * 100.0)
    efforts = (objective.bank_rate_effort, objective.angle_of_attack_effort)
    smooth = sum(efforts[k] * (np.degrees(one) * u[k]) ** 2 for k, one in enumerate(most))
    outputs = [rates / units, g, ca.vertcat(*inside), smooth]
    return ca.Function("node", [x, u, t], outputs), np.array(weight), g.numel()


def final_cost(mission: Mission, last: Any, final_time: Any) -> Any:
    """Flight time, final speed and cross-range of a scaled final state."""
    objective = mission.objective
    return (
        objective.flight_time * final_time
        + objective.final_speed * last[3] * SCALE[3]
        + objective.cross_range * cross_range(mission, last[1], last[2])
    )


def trapezoid(mesh: Mesh, x: Any, f: Any, times: Any) -> tuple[Any, Any]:
    """Defects and quadrature weights (1, n)."""
    half = 0.5 * (times[1:] - times[:-1])
    steps = ca.repmat(half, x.shape[0], 1) * (f[:, 1:] + f[:, :-1])
    return ca.vec(x[:, 1:] - x[:, :-1] - steps), ca.horzcat(half, 0) + ca.horzcat(0, half)


def radau(mesh: Mesh, x: Any, f: Any, times: Any) -> tuple[Any, Any]:
    """Defects and quadrature weights (1, n); the first node is not collocated."""
    defects, weights = [], [ca.MX(0)]
    for s in mesh.segments:
        first, last = s.nodes.start, s.nodes.stop - 1
        half = 0.5 * (times[last] - times[first])
        nodal, rates = x[:, first : last + 1], f[:, first + 1 : last + 1]
        defects.append(ca.vec(nodal @ ca.DM(s.rule.derivative).T - half * rates))
        weights.append(half * ca.DM(s.rule.weights).T)
    return ca.vertcat(*defects), ca.horzcat(*weights)


def state_bounds(mission: Mission, at: MeshIterate) -> tuple[Array, Array]:
    """Of the scaled states (n, n_x): limits of the angles, entry state, target."""
    n, n_x = at.states.shape
    low, high = np.full((n, n_x), -np.inf), np.full((n, n_x), np.inf)
    low[:, BANK], high[:, BANK] = -mission.limits.bank_angle, mission.limits.bank_angle
    angle = mission.angle_of_attack
    if angle is not None and angle.over is None:
        low[:, ANGLE_OF_ATTACK], high[:, ANGLE_OF_ATTACK] = angle.lower[0], angle.upper[0]
    for k, name in enumerate(STEERED_STATES[:n_x]):
        first = getattr(mission.entry, name) if k >= BANK else at.states[0, k]
        if first is not None:
            low[0, k] = high[0, k] = first
        field = mission.target.held_by(name)
        if field is not None:
            wish = np.array(getattr(mission.target, field)) * np.ones(2) / scale_of(mission)[k]
            low[-1, k], high[-1, k] = max(low[-1, k], wish[0]), min(high[-1, k], wish[1])
    return low, high


def first_rates(mission: Mission, radau: bool, mesh: Mesh, u: Any) -> tuple[list[Any], list[float]]:
    """Rates (û) at the first node that are given, and what they are to be."""
    rule, row = mesh.segments[0].rule, ca.DM(np.eye(mesh.n_nodes)[0])
    if radau:
        row = ca.DM.zeros(mesh.n_nodes)
        row[1 : rule.degree + 1] = entry_row(rule.nodes[1:])
    given = [getattr(mission.entry, name) for name in RATES[: u.shape[0]]]
    known = [k for k, rate in enumerate(given) if rate is not None]
    return [u[k, :] @ row for k in known], [given[k] / rate_limits(mission)[k] for k in known]


def witness(mission: Mission, asked: Transcription, at: MeshIterate) -> Optimum:
    """Solve the transcription on the mesh of `at`, starting there."""
    (n, n_x), n_u = at.states.shape, at.controls.shape[1]
    node, weight, limits = node_functions(mission)
    x, u, period = ca.MX.sym("x", n_x, n), ca.MX.sym("u", n_u, n), ca.MX.sym("t_f")
    a = ca.MX.sym("a", len(weight), n)  # |c| = a with a ≥ ±c
    fixed, free = at.mesh.node_time
    times = ca.DM(fixed).T + ca.DM(free).T * SECONDS * period
    rates, g, inside, smooth = node.map(n)(x, u, times)
    defects, quadrature = (radau if asked.radau else trapezoid)(at.mesh, x, rates, times)
    first, given = first_rates(mission, asked.radau, at.mesh, u)
    cost = (ca.DM(weight).T @ a + smooth) @ quadrature.T
    cost += final_cost(mission, x[:, n - 1], SECONDS * period)
    start = np.concatenate([at.states.ravel(), at.controls.ravel(), [at.final / SECONDS]])
    found = node.map(n)(at.states.T, at.controls.T, at.mesh.times(at.final)[None])
    start = np.concatenate([start, np.abs(np.array(found[2])).T.ravel()])
    variables = ca.vertcat(ca.vec(x), ca.vec(u), period, ca.vec(a))
    there = ca.Function("cost", [variables], [cost])(start)
    worth = 100.0 * weight.sum() or abs(float(there))  # brings the cost to the order of one
    program = {
        "x": variables,
        "f": cost / worth * (at.final / (SECONDS * period) if asked.per_second else 1.0),
        "g": ca.vertcat(*first, defects, ca.vec(g), ca.vec(a - inside), ca.vec(a + inside)),
    }
    low, high = state_bounds(mission, at)
    shortest, longest = np.array(asked.final_bounds) / SECONDS
    none, most = np.zeros(n_x * (n - 1)), np.full(limits * n, 1.0 - asked.limit_margin)
    up, down = np.full(a.numel(), np.inf), np.zeros(2 * a.numel())
    box = np.ones(n_u * n)
    found = ipopt(
        program,
        IPOPT,
        start=start,
        low=np.concatenate([low.ravel(), -box, [shortest], -up]),
        high=np.concatenate([high.ravel(), box, [longest], up]),
        least=np.concatenate([given, none, np.full(limits * n, -np.inf), down]),
        most=np.concatenate([given, none, most, up, up]),
        expand=True,
    )
    values = found.values
    final_time = float(values[(n_x + n_u) * n]) * SECONDS
    return Optimum(
        status=found.status,
        cost=found.objective * worth * (final_time / at.final if asked.per_second else 1.0),
        states=values[: n_x * n].reshape(n, n_x) * scale_of(mission),
        final_time=final_time,
    )
