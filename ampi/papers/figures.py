"""One figure per optimiser paper, in the paper's axes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ampi.missions.loading import load_mission
from ampi.missions.mission import Mission
from ampi.papers.betts2010 import betts2010_case
from ampi.papers.liu2015 import liu2015_case
from ampi.papers.table import Reproduction
from ampi.physics.path_constraints import path_constraints
from ampi.physics.state import (
    ALTITUDE,
    ANGLE_OF_ATTACK,
    BANK,
    LATITUDE,
    LOADS,
    LONGITUDE,
    SPEED,
)
from ampi.propagation.reintegration import reintegrate
from ampi.report.figures.ground_track import in_degrees, zone_edges
from ampi.report.figures.style import INK, LIMIT_COLOUR, house_style, new_figure
from ampi.scp.literature.energy_domain import EnergyDomain
from ampi.scp.literature.methods import Solution
from ampi.trajectory import Trajectory

Array = NDArray[np.float64]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # Okabe and Ito
WIDTH = 10.0


def _trace(axes: Axes, x: Array, y: Array, label: str, k: int, *, dashed: bool = False) -> None:
    style = "--" if dashed else "-"
    axes.plot(x, y, style, color=COLOURS[k % len(COLOURS)], linewidth=1.3, label=label)


def _labels(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.legend(loc="best")


def _limit(axes: Axes, value: float) -> None:
    axes.axhline(value, color=LIMIT_COLOUR, linewidth=1.0, linestyle=":")


@house_style
def zhou2021(found: Reproduction) -> Figure:
    """Altitude, bank angle, points and global error over iterations [Figs. 5, 9, 12, 16]."""
    mission = load_mission("cavh_zhou2021")
    figure = new_figure(WIDTH, 7.0)
    (altitude, bank), (points, error) = figure.subplots(2, 2)
    flights = {
        "adaptive mesh": found.solutions["adaptive"].trajectory,
        "fixed mesh": found.solutions["fixed"].trajectory,
        "ours": found.ours["ours"],
    }
    for k, (label, t) in enumerate(flights.items()):
        _trace(altitude, t.times, t.states[ALTITUDE] / 1e3, label, k)
        _trace(bank, t.times, np.degrees(t.states[BANK]), label, k)
    flown = reintegrate(mission, flights["adaptive mesh"])
    altitude.plot(
        flown.fine_times[0], flown.fine_states[0, 0] / 1e3, ":", color=INK, label="re-integrated"
    )
    units = np.array([6378137.0, 1.0, 1.0, 7905.4, 1.0, 1.0])
    for k, name in enumerate(("adaptive", "fixed", "adaptive, condition 1")):
        log = found.solutions[name].log
        count = [row.iteration for row in log]
        norm = [np.linalg.norm(np.array(row.global_error)[:BANK] / units) for row in log]
        finite = [n if np.isfinite(n) and n < 1e3 else np.nan for n in norm]
        points.plot(count, [row.nodes for row in log], "o-", ms=3, color=COLOURS[k], label=name)
        error.semilogy(count, finite, "o-", ms=3, color=COLOURS[k], label=name)
    _labels(altitude, "time (s)", "altitude (km)")
    _labels(bank, "time (s)", "bank angle (deg)")
    _labels(points, "iteration", "mesh points")
    _labels(error, "iteration", "global error (normalised 2-norm)")
    return figure


@house_style
def liu2015(found: Reproduction) -> Figure:
    """X-33: altitude over speed, bank angle [Figs. 4–9]. CAV-H: track, bounds [Figs. 11, 14]."""
    figure = new_figure(WIDTH, 7.0)
    (altitude, bank), (track, corridor) = figure.subplots(2, 2)
    for k, case in enumerate(found.ours):
        t, own = found.solutions[case].trajectory, found.ours[case]
        _trace(altitude, t.states[SPEED], t.states[ALTITUDE] / 1e3, case, k)
        _trace(
            altitude, own.states[SPEED], own.states[ALTITUDE] / 1e3, f"{case}, ours", k, dashed=True
        )
        _trace(bank, t.times, np.degrees(t.states[BANK]), case, k)
    for k, case in enumerate(("no-fly zones", "without zones")):
        t = found.solutions[case].trajectory
        _trace(track, np.degrees(t.states[LONGITUDE]), np.degrees(t.states[LATITUDE]), case, k)
        _trace(corridor, t.states[SPEED], t.states[ALTITUDE] / 1e3, case, k)
    _zones(track, liu2015_case("no-fly zones"))
    _bounds(corridor, found.solutions["no-fly zones"])
    for axes in (altitude, corridor):
        axes.invert_xaxis()
        _labels(axes, "speed (m/s)", "altitude (km)")
    corridor.set_ylim(20.0, 80.0)
    _labels(bank, "time (s)", "bank angle (deg)")
    _labels(track, "longitude (deg)", "latitude (deg)")
    return figure


def _zones(axes: Axes, mission: Mission) -> None:
    for x, y in zone_edges(mission, mission.entry.longitude, in_degrees):
        axes.plot(x, y, color=LIMIT_COLOUR, linewidth=1.0)
    axes.set_aspect("equal")


def _bounds(axes: Axes, solution: Solution) -> None:
    """Lowest and highest altitude (km) over speed, Liu 2015, Eqs. (14) and (60)."""
    form, at = solution.formulation, solution.iterate
    assert isinstance(form, EnergyDomain)
    s = at.mesh.times(at.final)
    speed = form.speed(at.states[:, ALTITUDE] * form.state_scale[0], s + form.first_energy)
    bounds = [form.altitude_floors(s).max(axis=0), form.altitude_ceiling(s)]
    for bound in bounds:
        if bound is not None:
            axes.plot(speed, bound / 1e3, color=LIMIT_COLOUR, linewidth=1.0, linestyle=":")


@house_style
def wang2020(found: Reproduction) -> Figure:
    """Altitude over speed, ground track, bank angle of the three methods [Figs. 1–3]."""
    figure = new_figure(WIDTH, 7.0)
    (altitude, track), (bank, error) = figure.subplots(2, 2)
    flights = {label: s.trajectory for label, s in found.solutions.items()}
    flights["ours"] = found.ours["ours"]
    mission = load_mission("cavh_wang2020")
    for k, (label, t) in enumerate(flights.items()):
        _trace(altitude, t.states[SPEED], t.states[ALTITUDE] / 1e3, label, k)
        _trace(track, np.degrees(t.states[LONGITUDE]), np.degrees(t.states[LATITUDE]), label, k)
        _trace(bank, t.times, np.degrees(t.states[BANK]), label, k)
        gap = _distance(mission, t)
        error.semilogy(t.times[1:], np.maximum(gap[1:], 1e-2), color=COLOURS[k], label=label)
    altitude.invert_xaxis()
    _labels(altitude, "speed (m/s)", "altitude (km)")
    _labels(track, "longitude (deg)", "latitude (deg)")
    _labels(bank, "time (s)", "bank angle (deg)")
    _labels(error, "time (s)", "optimised – propagated position (m)")
    return figure


def _distance(mission: Mission, trajectory: Trajectory) -> Array:
    """Position error at the nodes (m)."""
    gap = reintegrate(mission, trajectory).states[0] - trajectory.states[:BANK]
    radius = mission.flight_model.planet.equatorial_radius
    east = radius * gap[1] * np.cos(trajectory.states[LATITUDE])
    return np.asarray(np.sqrt(gap[0] ** 2 + east**2 + (radius * gap[2]) ** 2))


@house_style
def liu2024(found: Reproduction) -> Figure:
    """Path constraints between the points, bank angle, points and objective [Section 5]."""
    mission = load_mission("rlv_liu2024")
    figure = new_figure(WIDTH, 7.0)
    (path, bank), (points, cost) = figure.subplots(2, 2)
    reduced = found.solutions["reduced"].trajectory
    flown = reintegrate(mission, reduced)
    for k, name in enumerate(LOADS):
        _trace(path, flown.fine_times[0], flown.fine_path[0, k], name.replace("_", " "), k)
    _limit(path, 1.0)
    ends = [s.start[0] + s.start[1] * reduced.final_time for s in reduced.mesh.segments]
    path.plot(ends, np.zeros(len(ends)), "|", color=INK, label="interval ends")
    for k, (label, t) in enumerate(
        {
            "reduced": reduced,
            "hp": found.solutions["hp"].trajectory,
            "ours": found.ours["ours"],
        }.items()
    ):
        times = np.linspace(0.0, t.final_time, 1200)
        _trace(bank, times, np.degrees(t.at(times)[0][6]), label, k)
    for k, label in enumerate(("reduced", "hp")):
        rounds = found.solutions[label].rounds
        count = np.arange(1, len(rounds) + 1)
        points.plot(count, [r.nodes for r in rounds], "o-", ms=4, color=COLOURS[k], label=label)
        log = found.solutions[label].log
        values = [row.cost * 100.0 for row in log]
        cost.plot(np.arange(1, len(log) + 1), values, "o-", ms=3, color=COLOURS[k], label=label)
    _labels(path, "time (s)", "use of the limit (–)")
    _labels(bank, "time (s)", "bank angle (deg)")
    _labels(points, "round", "points")
    _labels(cost, "iteration, all rounds", "∫ |dσ/dt| dt (deg)")
    return figure


@house_style
def betts2010(found: Reproduction) -> Figure:
    """Altitude over speed, angle of attack, bank angle, heat flux over time [Section 6.1]."""
    figure = new_figure(WIDTH, 7.0)
    (altitude, attack), (bank, heat) = figure.subplots(2, 2)
    limit = betts2010_case("heating limit").limits.heat_flux
    for k, (case, t) in enumerate(found.ours.items()):
        flown = path_constraints(betts2010_case(case).flight_model, t.states, t.times)
        _trace(altitude, t.states[SPEED], t.states[ALTITUDE] / 1e3, case, k)
        _trace(attack, t.times, np.degrees(t.states[ANGLE_OF_ATTACK]), case, k)
        _trace(bank, t.times, np.degrees(t.states[BANK]), case, k)
        _trace(heat, t.times, flown[1] / 1e6, case, k)
    _limit(heat, limit / 1e6)
    altitude.invert_xaxis()
    _labels(altitude, "speed (m/s)", "altitude (km)")
    _labels(attack, "time (s)", "angle of attack (deg)")
    _labels(bank, "time (s)", "bank angle (deg)")
    _labels(heat, "time (s)", "heat flux (MW/m²)")
    return figure


FIGURES: dict[str, Callable[[Reproduction], Figure]] = {
    "zhou2021": zhou2021,
    "liu2015": liu2015,
    "wang2020": wang2020,
    "liu2024": liu2024,
    "betts2010": betts2010,
}
