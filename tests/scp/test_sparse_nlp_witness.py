"""Independent witness of the literature's methods over time: their transcriptions as one program.

The trapezoid and the flipped Radau rule, the limits and the terms of the objective are written down
here once more and handed to CasADi and IPOPT: no linearisation, no trust region, no elastic target, no
penalty. What remains common is the physics and the mesh. These problems have several optima: IPOPT
starts from the solution under test, with a small barrier, and names the optimum of its valley.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission, load_mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import ENTRY_STATES
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.literature.methods import METHODS, Solution, solve_by
from ampi.scp.literature.starts import Start, straight_line
from ampi.scp.literature.subproblem_builder import MeshIterate, StateTrustRegion
from ampi.scp.literature.successive import StateChange
from ampi.trajectory import Status
from tests.support.missions import SCALE
from tests.support.witness import ipopt, numpy_of_symbols, path_limits

pytestmark = pytest.mark.slow

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
    states: Array  # (n, 7), SI
    final_time: float  # s, of the optimised part of the flight


@dataclass(frozen=True, kw_only=True)
class Transcription:
    """What a method solves, besides the mission."""

    radau: bool
    per_second: bool = False  # the objective is divided by the flight time: Zhou 2021, Eq. (34)
    limit_margin: float = 0.0
    final_bounds: tuple[float, float] = (1.0, np.inf)  # s


def node_functions(mission: Mission) -> tuple[ca.Function, Array]:
    """(x, u, t) → rates, limits g ≤ 1 and the insides of the absolute terms, and their weights."""
    model, limits, objective = mission.flight_model, mission.limits, mission.objective
    x, u, t = ca.SX.sym("x", 7), ca.SX.sym("u"), ca.SX.sym("t")
    si = x * SCALE
    with numpy_of_symbols():
        rates = ca.vertcat(*equations_of_motion(model, si, u * limits.bank_rate, t))
    g, _ = path_limits(mission, si, t)
    inside, weight = [u], [objective.bank_rate_variation * np.degrees(limits.bank_rate)]
    if objective.descent_rate:
        inside.append((rates[0] - objective.desired_altitude_rate) / 100.0)
        weight.append(objective.descent_rate * 100.0)
    outputs = [rates / SCALE, g, ca.vertcat(*inside)]
    return ca.Function("node", [x, u, t], outputs), np.array(weight)


def trapezoid(mesh: Mesh, x: Any, f: Any, times: Any) -> tuple[Any, Any]:
    """Defects and quadrature weights (1, n)."""
    half = 0.5 * (times[1:] - times[:-1])
    defects = x[:, 1:] - x[:, :-1] - ca.repmat(half, 7, 1) * (f[:, 1:] + f[:, :-1])
    return ca.vec(defects), ca.horzcat(half, 0) + ca.horzcat(0, half)


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


def state_bounds(mission: Mission, entry: Array, n: int) -> tuple[Array, Array]:
    """Of the scaled states (n, 7): bank limit, entry state (scaled), target."""
    low, high = np.full((n, 7), -np.inf), np.full((n, 7), np.inf)
    low[:, 6], high[:, 6] = -mission.limits.bank_angle, mission.limits.bank_angle
    low[0, :6] = high[0, :6] = entry
    for k, name in enumerate(ENTRY_STATES):
        wish = getattr(mission.target, name)
        if wish is not None:
            low[-1, k], high[-1, k] = np.array(wish) * np.ones(2) / SCALE[k]
    return low, high


def witness(mission: Mission, asked: Transcription, at: MeshIterate) -> Optimum:
    """Solve the transcription on the mesh of `at`, starting there."""
    n = len(at.states)
    node, weight = node_functions(mission)
    x, u, period = ca.MX.sym("x", 7, n), ca.MX.sym("u", 1, n), ca.MX.sym("t_f")
    a = ca.MX.sym("a", len(weight), n)  # |c| = a with a ≥ ±c
    fixed, free = at.mesh.node_time
    times = ca.DM(fixed).T + ca.DM(free).T * SECONDS * period
    rates, g, inside = node.map(n)(x, u, times)
    defects, quadrature = (radau if asked.radau else trapezoid)(at.mesh, x, rates, times)
    worth = 100.0 * weight.sum()  # brings the cost to the order of one
    cost = ca.DM(weight).T @ a @ quadrature.T / worth
    program = {
        "x": ca.vertcat(ca.vec(x), u.T, period, ca.vec(a)),
        "f": cost * at.final / (SECONDS * period) if asked.per_second else cost,
        "g": ca.vertcat(defects, ca.vec(g), ca.vec(a - inside), ca.vec(a + inside)),
    }
    low, high = state_bounds(mission, at.states[0, :6], n)
    shortest, longest = np.array(asked.final_bounds) / SECONDS
    none, most = np.zeros(7 * (n - 1)), np.full(3 * n, 1.0 - asked.limit_margin)
    start = np.abs(
        np.array(node.map(n)(at.states.T, at.controls.T, at.mesh.times(at.final)[None])[2])
    )
    up, down = np.full(start.size, np.inf), np.zeros(2 * start.size)
    found = ipopt(
        program,
        IPOPT,
        start=np.concatenate(
            [at.states.ravel(), at.controls.ravel(), [at.final / SECONDS], start.T.ravel()]
        ),
        low=np.concatenate([low.ravel(), -np.ones(n), [shortest], -up]),
        high=np.concatenate([high.ravel(), np.ones(n), [longest], up]),
        least=np.concatenate([none, np.full(3 * n, -np.inf), down]),
        most=np.concatenate([none, most, up, up]),
        expand=True,
    )
    values = found.values
    final_time = float(values[8 * n]) * SECONDS
    return Optimum(
        status=found.status,
        cost=found.objective * worth * (final_time / at.final if asked.per_second else 1.0),
        states=values[: 7 * n].reshape(n, 7) * SCALE,
        final_time=final_time,
    )


RADAU_WITH_MARGIN = Transcription(radau=True, limit_margin=METHODS["liu2024"].limit_margin)
CASES = {
    "wang2020_scp": ("cavh_wang2020", Transcription(radau=False)),
    "wang2020": ("cavh_wang2020", Transcription(radau=True)),
    "liu2024": ("rlv_liu2024", RADAU_WITH_MARGIN),
    "liu2024_hp": ("rlv_liu2024", RADAU_WITH_MARGIN),
}
ZHOU = Transcription(radau=False, per_second=True, final_bounds=METHODS["zhou2021"].final_bounds)


def assert_the_same(solution: Solution, optimum: Optimum, tolerance: StateChange) -> None:
    """The objective to 1e-4, the states to the tolerance at which the method stopped."""
    assert solution.trajectory.status is Status.SOLVED
    assert optimum.status == "Solve_Succeeded"
    assert solution.trajectory.cost == pytest.approx(optimum.cost, rel=1e-4)
    assert solution.iterate.final == pytest.approx(optimum.final_time, rel=1e-4)
    error = np.abs(solution.iterate.states * SCALE - optimum.states).max(axis=0)
    assert np.all(error <= tolerance.tolerance)


@pytest.mark.parametrize("name", CASES)
def test_the_method_ends_at_an_optimum_of_its_transcription(name: str) -> None:
    mission, asked = load_mission(CASES[name][0]), CASES[name][1]
    method, tolerance = METHODS[name], METHODS[name].convergence
    assert isinstance(tolerance, StateChange)
    if name == "wang2020_scp":  # its last steps shrink slowly: one is no bound on what is left
        finer = StateChange(tuple(0.1 * t for t in tolerance.tolerance))
        method = replace(method, convergence=finer, max_iterations=80)
    solution = solve_by(mission, method)
    assert solution is not None
    assert_the_same(solution, witness(mission, asked, solution.iterate), tolerance)


@pytest.fixture(scope="module")
def as_printed() -> Solution:
    """Zhou's method on 101 points."""
    method = replace(METHODS["zhou2021_fixed"], start=straight_line(101, 1700.0))
    found = solve_by(load_mission("cavh_zhou2021"), method)
    assert found is not None
    return found


def test_a_fixed_trust_region_leads_zhou_to_the_optimum_of_the_trapezoid(
    as_printed: Solution,
) -> None:
    region = StateTrustRegion(METHODS["zhou2021"].trust_region.radius)
    tight = StateChange((5.0, 1e-5, 1e-5, 0.2, 1e-5, 1e-4, 1e-3))
    method = replace(
        METHODS["zhou2021_fixed"],
        start=lambda mission: Start(as_printed.formulation, as_printed.iterate),
        trust_region=region,
        convergence=tight,
    )
    mission = load_mission("cavh_zhou2021")
    solution = solve_by(mission, method)
    assert solution is not None
    assert_the_same(solution, witness(mission, ZHOU, solution.iterate), tight)


def test_the_price_of_its_trust_region_stops_zhou_short_of_an_optimum(
    as_printed: Solution,
) -> None:
    # c_η η is an exact penalty on the step: a step that gains less than it costs is not taken
    optimum = witness(load_mission("cavh_zhou2021"), ZHOU, as_printed.iterate)
    assert optimum.status == "Solve_Succeeded"
    assert as_printed.trajectory.status is Status.SOLVED
    assert as_printed.trajectory.cost > 2.0 * optimum.cost
