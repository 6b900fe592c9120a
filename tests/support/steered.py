"""SHEFEX-3 with its angle of attack as a second control, and a flight of it that nobody optimised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from ampi.missions.loading import parse_mission
from ampi.missions.mission import Mission
from ampi.physics.equations_of_motion import equations_of_motion
from ampi.physics.state import BANK
from ampi.trajectory import Status, Trajectory
from tests.support.missions import SMALL_GRID, text_on_grid

CONTROL = """[angle_of_attack]
lower_deg = 10.0
upper_deg = 42.0
rate_deg_per_s = 5.0
acceleration_deg_per_s2 = 4.0

"""


def steered_mission(control: str = CONTROL, grid: str = SMALL_GRID) -> Mission:
    """SHEFEX-3 with the section `control` in the place of its schedule."""
    before, _, after = text_on_grid(grid).partition("[vehicle.angle_of_attack]\n")
    text = before + control + after[after.index("\n[") + 1 :]
    text = text.replace(
        "bank_rate_effort = ", "angle_of_attack_effort = 1e-05\nbank_rate_effort = "
    )
    own = ("angle_of_attack_change_deg", "angle_of_attack_rate_deg_per_s")  # of a schedule's change
    lines = [line for line in text.splitlines() if not line.startswith(own)]
    return parse_mission("\n".join(lines))


def steered_flight(mission: Mission, *, guess: Trajectory | None = None) -> Trajectory:
    """A flight of ten minutes under angles of sines, by DOP853; for a solver's stand-in."""
    mesh, final_time = mission.pseudospectral_mesh, 600.0 + 0.1 * (mission.entry.speed - 4712.26)
    times = mesh.times(final_time)
    bank = np.radians(30.0 + 5.0 * np.sin(times / 90.0))
    angles = np.stack([bank, np.radians(28.0 - 8.0 * np.tanh((times - 250.0) / 150.0))])
    states = np.empty((BANK, mesh.n_nodes))
    states[:, 0] = mission.entry_state

    def rates(time: float, state: np.ndarray) -> list[float]:
        bank, angle = angles @ mesh.conversion(np.array([time]), final_time)[0]
        return list(equations_of_motion(mission.flight_model, [*state, bank, angle], 0.0, time))[:6]

    for s in mesh.segments:
        nodes, first = times[s.nodes], states[:, s.nodes.start]
        span = nodes[[0, -1]]
        flown = solve_ivp(rates, span, first, "DOP853", t_eval=nodes, rtol=1e-8, atol=1e-8)
        states[:, s.nodes] = flown.y
    steering = angles @ mesh.derivative(final_time).T
    states = np.concatenate([states, angles])
    flight = Trajectory(mesh, states, steering[0], final_time, 1.0, Status.SOLVED)
    return replace(flight, angle_of_attack_rate=steering[1])
