"""Independent witness over energy: one nonlinear program in the bank angle, by CasADi and IPOPT.

The trapezoid of Liu, Shen, Lu 2015, Eq. (61), on the same 201 nodes, but with σ as control, that is on
the circle u₁² + u₂² = 1 that the paper relaxes; no linearisation, no trust region, no elastic target,
no price on the heading. Limits are those of Eqs. (9)–(11), (71) and (73) themselves, not altitude
bounds. What remains common is the physics, the coast to the handover and the mesh.

IPOPT starts from the converged solution. From the guess of `liu2015` it ends at an infeasible point on
all three X-33 cases; the paper says the same of its own nonlinear program.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from ampi.missions import Mission
from ampi.papers.liu2015 import LIU_CASES, liu2015_case
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.scp.literature.methods import METHODS, Solution, solve_by
from ampi.trajectory import Status
from tests.support.witness import Found, ipopt, numpy_of_symbols, path_limits

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
SCALE = np.array([1e4, 1.0, 1.0, 1.0, 1.0])  # h, θ, φ, γ, ψ
IPOPT = {"max_iter": 600, "tol": 1e-7, "mu_init": 1e-3}


def physics(mission: Mission) -> ca.Function:
    """(x, σ, e) → (dx/de scaled, integrand of the objective over e, limits ≤ 1)."""
    model, objective = mission.flight_model, mission.objective
    planet = model.planet
    radius = planet.equatorial_radius
    unit = planet.gravitational_parameter / radius  # g₀ R₀
    x, bank, energy = ca.SX.sym("x", 5), ca.SX.sym("s"), ca.SX.sym("e")
    h, r = 1e4 * x[0], radius + 1e4 * x[0]
    speed = ca.sqrt(2.0 * unit * (radius / r - energy))
    state = [h, x[1], x[2], speed, x[3], x[4], bank]
    with numpy_of_symbols():
        rates = equations_of_motion(model, state, 0.0, 0.0)
    g, heat = path_limits(mission, state, 0.0)
    per_second = -radius / r**2 * rates[0] - speed * rates[3] / unit  # de/dt
    wanted = (
        objective.flight_time
        + objective.heat_load * heat / 1e6
        + objective.ground_range * speed * ca.cos(x[3]) * radius / r / 1e3
    )
    over_energy = ca.vertcat(*(rates[k] for k in (0, 1, 2, 4, 5))) / per_second / SCALE
    outputs = [over_energy, wanted / per_second, g]
    return ca.Function("physics", [x, bank, energy], outputs)


def nlp(mission: Mission, start: Solution, *, sides: bool = False) -> Found:
    """Solve the transcription, its objective over 100, from the states and bank angles of `start`.

    With `sides` every bank angle keeps its sign: where the lift exceeds what the course needs, the
    circle's own optimum changes sides at every node, and IPOPT does not come to an end.
    """
    form, at = start.formulation, start.iterate
    n, s = at.mesh.n_nodes, at.mesh.times(at.final)
    energy = s + form.first_energy  # type: ignore[attr-defined]
    x, bank = ca.MX.sym("x", 5, n), ca.MX.sym("s", 1, n)
    rates, running, path = physics(mission).map(n)(x, bank, ca.DM(energy).T)
    half = ca.DM(0.5 * np.diff(s)).T
    defect = x[:, 1:] - x[:, :-1] - ca.repmat(half, 5, 1) * (rates[:, 1:] + rates[:, :-1])
    objective = ca.dot(half, running[:, 1:] + running[:, :-1])
    least, most = mission.limits.bank_angle_minimum, mission.limits.bank_angle
    constraints = ca.vertcat(ca.vec(defect), ca.vec(path), ca.vec(ca.cos(bank)))
    low = [np.zeros(5 * (n - 1)), np.full(path.numel(), -np.inf), np.full(n, np.cos(most))]
    high = [np.zeros(5 * (n - 1)), np.ones(path.numel()), np.full(n, np.cos(least))]
    bounds = np.full((2, 6, n), np.inf) * np.array([-1.0, 1.0])[:, None, None]
    bounds[:, :5, 0] = form.entry
    for held in form.target:
        bounds[:, held.state, -1] = held.lower, held.upper
    angle = np.arctan2(at.controls[:, 1], at.controls[:, 0])
    if sides:
        bounds[:, 5] = np.where(angle > 0.0, [[least], [most]], [[-most], [-least]])
    bounds = [np.concatenate([b[:5].T.ravel(), b[5]]) for b in bounds]
    first = np.concatenate([at.states.ravel(), angle])
    problem = {"x": ca.vertcat(ca.vec(x), ca.vec(bank)), "f": objective / 100.0, "g": constraints}
    return ipopt(
        problem,
        IPOPT,
        start=first,
        low=bounds[0],
        high=bounds[1],
        least=np.concatenate(low),
        most=np.concatenate(high),
        expand=True,
    )


@pytest.mark.parametrize("case", LIU_CASES)
def test_the_convex_iterations_end_within_one_per_cent_of_the_optimum(case: str) -> None:
    mission = liu2015_case(case)
    found = solve_by(mission, METHODS["liu2015"])
    assert found is not None and found.trajectory.status is Status.SOLVED
    optimum = nlp(mission, found, sides=mission.name == "cavh_liu2015")
    assert optimum.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")
    assert found.trajectory.cost == pytest.approx(100.0 * optimum.objective, rel=0.01)
