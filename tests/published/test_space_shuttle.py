"""The Space Shuttle's greatest cross-range: Betts (2010), Section 6.1, Table 6.1, no heating limit.

He steers angle of attack and bank angle; the optimum ends at 34.1412° of latitude after 2,008.6 s (both
controls of ours: test_shuttle_betts2010.py). Here a witness, his equations in his units by CasADi and
IPOPT, is first held against the printed optimum, then gives what the bank angle alone can reach at a
scheduled angle of attack, and that is what the optimiser is held against.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import ampi
from ampi.missions import Mission
from ampi.propagation.reintegration import reintegrate
from ampi.pseudospectral.mesh import Mesh
from ampi.scp.condensed.elastic_target import ElasticSettings
from ampi.scp.condensed.settings import SolverSettings
from ampi.trajectory import Status, Trajectory
from tests.support.witness import ipopt

pytestmark = pytest.mark.slow

LATITUDE, SECONDS = 34.1412, 2008.59  # as printed: degrees, s
FLIGHT_TIME = 1000.0  # s per unit of the witness's t_f
FIRST = np.array([2.6, 0.0, 0.0, 2.56, np.radians(-1.0), np.radians(90.0)])
LAST = np.array([0.8, np.nan, np.nan, 0.25, np.radians(-5.0), np.nan])

# A latitude out of reach pulls at the other final states. Their prices may grow until nothing is bought
# off any more: then the quadratic cost is minimised as it stands (elastic_target, Eq. (2)).
DEAR = SolverSettings(elastic=ElasticSettings(growths=4))


def rates() -> ca.Function:
    """Betts, Eqs. (6.1)–(6.6), in ft, slug, s; altitude over 1e5, speed over 1e4; α in degrees."""
    x, alpha, beta = ca.SX.sym("x", 6), ca.SX.sym("alpha"), ca.SX.sym("beta")
    h, _, theta, v, gamma, psi = 1e5 * x[0], x[1], x[2], 1e4 * x[3], x[4], x[5]
    r = 20902900.0 + h
    pressure = 0.5 * 0.002378 * ca.exp(-h / 23800.0) * v**2 * 2690.0 / (203000.0 / 32.174)
    lift = pressure * (-0.20704 + 0.029244 * alpha)
    drag = pressure * (0.07854 - 0.61592e-2 * alpha + 0.621408e-3 * alpha**2)
    g = 0.14076539e17 / r**2
    over_ground = v / r * ca.cos(gamma)
    dot = ca.vertcat(
        v * ca.sin(gamma) / 1e5,
        over_ground * ca.sin(psi) / ca.cos(theta),
        over_ground * ca.cos(psi),
        (-drag - g * ca.sin(gamma)) / 1e4,
        lift / v * ca.cos(beta) + ca.cos(gamma) * (v / r - g / v),
        lift * ca.sin(beta) / (v * ca.cos(gamma)) + over_ground * ca.sin(psi) * ca.tan(theta),
    )
    return ca.Function("rates", [x, alpha, beta], [dot])


@dataclass(frozen=True)
class Flight:
    """What the witness found."""

    status: str
    latitude: float  # degrees
    flight_time: float  # s


def farthest(mesh: Mesh, angle_of_attack: float | None) -> Flight:
    """Greatest final latitude on `mesh` at one angle of attack (degrees); None: it is a control too."""
    n = mesh.n_nodes
    x, u, t_f = ca.MX.sym("x", 6, n), ca.MX.sym("u", 2, n - 1), ca.MX.sym("t_f")
    dot = rates().map(n - 1)(x[:, 1:], u[0, :], u[1, :])
    defects = [
        x[:, s.nodes.start : s.nodes.stop] @ ca.DM(s.rule.derivative).T
        - s.half_length[1] * FLIGHT_TIME * t_f * dot[:, s.collocation.start : s.collocation.stop]
        for s in mesh.segments
    ]
    program = {
        "x": ca.vertcat(ca.vec(x), ca.vec(u), t_f),
        "f": -x[2, n - 1],
        "g": ca.vertcat(*[ca.vec(d) for d in defects]),
    }
    low = np.tile([0.0, -np.inf, -1.5, 0.01, -1.5, -np.inf], (n, 1))
    high = np.tile([np.inf, np.inf, 1.5, np.inf, 1.5, np.inf], (n, 1))
    low[0] = high[0] = FIRST
    held = np.isfinite(LAST)
    low[-1, held] = high[-1, held] = LAST[held]
    least, most = (0.0, 60.0) if angle_of_attack is None else (angle_of_attack, angle_of_attack)
    share = mesh.node_time[1][:, None]
    line = FIRST + (np.where(held, LAST, [0.0, 1.0, 0.5, 0.0, 0.0, 0.0]) - FIRST) * share
    found = ipopt(
        program,
        {},
        start=np.concatenate([line.ravel(), np.tile([17.4, -1.0], n - 1), [2.0]]),
        low=np.concatenate([low.ravel(), np.tile([least, -0.5 * np.pi], n - 1), [1.0]]),
        high=np.concatenate([high.ravel(), np.tile([most, 0.5 * np.pi], n - 1), [4.0]]),
        expand=True,
    )
    time = FLIGHT_TIME * float(found.values[-1])
    return Flight(found.status, float(np.degrees(-found.objective)), time)


@pytest.fixture(scope="module")
def mission() -> Mission:
    return ampi.load_mission(Path(__file__).with_name("space_shuttle.toml"))


@pytest.fixture(scope="module")
def ours(mission: Mission) -> Trajectory:
    return ampi.solve(mission, settings=DEAR)


def test_the_witness_finds_the_printed_optimum(mission: Mission) -> None:
    both = farthest(mission.pseudospectral_mesh, None)
    assert both.status == "Solve_Succeeded"
    assert both.latitude == pytest.approx(LATITUDE, abs=5e-5)
    assert both.flight_time == pytest.approx(SECONDS, abs=0.05)


def test_the_bank_angle_alone_reaches_what_the_witness_says(
    mission: Mission, ours: Trajectory
) -> None:
    alone = farthest(mission.pseudospectral_mesh, 17.4)
    assert alone.status == "Solve_Succeeded"
    assert np.degrees(ours.states[2, -1]) == pytest.approx(alone.latitude, rel=1e-4)
    assert ours.final_time == pytest.approx(alone.flight_time, rel=1e-3)


def test_one_control_ends_slightly_below_the_printed_latitude(ours: Trajectory) -> None:
    latitude = np.degrees(ours.states[2, -1])
    assert 0.995 * LATITUDE < latitude < LATITUDE
    assert ours.final_time == pytest.approx(SECONDS, rel=0.005)


def test_the_flight_ends_as_asked_and_says_that_the_target_was_out_of_reach(
    mission: Mission, ours: Trajectory
) -> None:
    assert ours.status is Status.TARGET_MISSED
    target, final = mission.target, ours.states[:, -1]
    assert abs(final[0] - target.altitude) < target.altitude_tolerance
    assert abs(final[3] - target.speed) < target.speed_tolerance
    assert np.degrees(final[4]) == pytest.approx(-5.0, abs=1e-6)


def test_the_flight_flies(mission: Mission, ours: Trajectory) -> None:
    flown = reintegrate(mission, ours)
    assert np.degrees(flown.states[0, 2, -1]) == pytest.approx(
        np.degrees(ours.states[2, -1]), rel=1e-4
    )
